//! Normal loads over the weight, linear in what they carry.

use super::geometry::{Geometry, Ground, WHEELS_MAX};
use crate::contact::loads::inverse_of;
use crate::frames::Tilt;
use nalgebra::{Matrix3, Vector3};

/// Weight in body axes over m g at an attitude, and its derivatives.
#[derive(Debug, Clone, Copy)]
pub(super) struct LoadCase {
    pub(super) weight: Vector3<f64>,
    pub(super) by_roll: Vector3<f64>,
    pub(super) by_pitch: Vector3<f64>,
}

impl LoadCase {
    pub(super) fn at(tilt: &Tilt) -> Self {
        let Tilt {
            s_alpha,
            c_alpha,
            s_phi,
            c_phi,
        } = *tilt;
        Self {
            weight: Vector3::new(s_alpha, -s_phi * c_alpha, -c_phi * c_alpha),
            by_roll: Vector3::new(c_alpha, s_phi * s_alpha, c_phi * s_alpha),
            by_pitch: Vector3::new(0.0, -c_phi * c_alpha, s_phi * c_alpha),
        }
    }

    /// Returns force to the right and forward and moment about the origin of the weight, which acts at
    /// `centre`.
    pub(super) fn pull(&self, centre: &Vector3<f64>) -> Vector3<f64> {
        pull_of(&self.weight, centre)
    }
}

/// Returns force and moment along the ground of `weight` at `centre`.
pub(super) fn pull_of(weight: &Vector3<f64>, centre: &Vector3<f64>) -> Vector3<f64> {
    Vector3::new(
        weight.x,
        weight.y,
        centre.x * weight.y - centre.y * weight.x,
    )
}

/// Returns what the wheels have to carry together: sum N, sum N x, sum N y.
pub(super) fn demand_of(weight: &Vector3<f64>, centre: &Vector3<f64>) -> Vector3<f64> {
    let pressing = -weight.z;
    Vector3::new(
        pressing,
        pressing * centre.x + weight.x * centre.z,
        pressing * centre.y + weight.y * centre.z,
    )
}

/// Loads of all wheels, the left ones first, over the weight.
#[derive(Debug, Clone, Copy)]
pub(super) struct Loads {
    pub(super) of_wheel: [f64; WHEELS_MAX],
    /// c, by which each wheel's springs press: k (c_0 + c_x x + c_y y).
    pub(super) constants: Vector3<f64>,
    /// d(constants)/d(demand): inverse of the stiffness of the wheels on the ground; 0 where the loads
    /// do not follow the demand.
    pub(super) inverse_stiffness: Matrix3<f64>,
    pub(super) stands: bool,
}

impl Loads {
    /// Returns the loads as of [`write_wheel_loads`](super::super::loads::write_wheel_loads); those
    /// of level ground where the vehicle does not stand.
    pub(super) fn of(geometry: &Geometry, ground: &Ground, stance: &LoadCase) -> Self {
        let demand = demand_of(&stance.weight, &ground.centre);
        let wheels = 2 * geometry.axles;
        let mut lifted = [false; WHEELS_MAX];
        let mut of_wheel = [0.0; WHEELS_MAX];
        let mut inverse = Some(ground.inverse_stiffness);
        let mut missing = demand - ground.carried;
        // Each pass lifts at least one more wheel or ends.
        for _ in 0..wheels {
            let Some(inverse_stiffness) = inverse else {
                break;
            };
            let constants = inverse_stiffness * missing;
            let mut again = false;
            for i in 0..wheels {
                if lifted[i] {
                    continue;
                }
                let axle = geometry.axle(i);
                let pressed = ground.stiffness[axle] * constants.dot(&geometry.arm(i));
                let load = ground.wheel_share[axle] + pressed;
                of_wheel[i] = load.max(0.0);
                lifted[i] = load <= 0.0;
                again |= lifted[i];
            }
            if !again {
                return Self {
                    of_wheel,
                    constants,
                    inverse_stiffness,
                    stands: true,
                };
            }
            let mut stiffness = Matrix3::zeros();
            missing = demand;
            for i in (0..wheels).filter(|&i| !lifted[i]) {
                let (arm, axle) = (geometry.arm(i), geometry.axle(i));
                missing -= arm * ground.wheel_share[axle];
                stiffness += ground.stiffness[axle] * arm * arm.transpose();
            }
            inverse = inverse_of(&stiffness);
        }
        for (i, load) in of_wheel.iter_mut().enumerate().take(wheels) {
            *load = demand.x.max(0.1) * ground.wheel_share[geometry.axle(i)];
        }
        Self {
            of_wheel,
            constants: Vector3::zeros(),
            inverse_stiffness: Matrix3::zeros(),
            stands: false,
        }
    }
}
