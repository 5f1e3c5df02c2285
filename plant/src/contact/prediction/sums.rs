//! Sums over the wheels: the potential, its derivatives by the velocity, and those of its gradient.

use super::geometry::{ByParameters, Geometry, Ground};
use super::loads::{LoadCase, Loads, demand_of, pull_of};
use crate::speeds::TreadSpeeds;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// What the sums are over, and the tread speeds, their factors included.
pub(super) struct ForceSums<'a> {
    pub(super) geometry: &'a Geometry,
    pub(super) ground: &'a Ground,
    pub(super) treads: TreadSpeeds,
}

/// Value, gradient and Hessian of the potential over the weight.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expansion {
    pub(super) value: f64,
    pub(super) gradient: Vector3<f64>,
    pub(super) hessian: Matrix3<f64>,
}

/// Sums over the wheels on the ground that lead from loads and tread speeds to the gradient.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct GradientParts {
    /// Of k (force for each unit of load) arm'.
    by_constants: Matrix3<f64>,
    /// Derivative of the gradient by the left and the right tread speed.
    by_tread: [Vector3<f64>; 2],
}

/// A side's wheels: what they have in common.
#[derive(Clone, Copy)]
struct Side {
    /// Lateral position x, m.
    x: f64,
    /// First of its wheels.
    first: usize,
    /// Speed along the ground v_y + omega x, m/s.
    rolling: f64,
    /// Slip along the ground, m/s.
    slip: f64,
    /// Part of q^2 that all its wheels have.
    common: f64,
    /// sqrt(rolling^2 + eps^2), m/s.
    rolling_root: f64,
    /// What slip along the ground and the turning patch contribute to the moment of q times the unit force, m^2/s.
    turning: f64,
}

impl Side {
    /// Returns force and moment about the origin of a unit of force along the ground at the side's wheels.
    fn along(&self) -> Vector3<f64> {
        Vector3::new(0.0, 1.0, self.x)
    }
}

/// One wheel's unit friction force, q and their ingredients.
#[derive(Clone, Copy)]
struct WheelSums {
    y: f64,
    load: f64,
    /// a^2 s_x^2.
    lateral: f64,
    q: f64,
    /// 1 / q.
    inverse: f64,
    /// Unit force: along x, along y, and the moment about the origin, the patch's own included.
    force: Vector3<f64>,
}

impl ForceSums<'_> {
    fn sides(&self, velocity: &Vector3<f64>) -> [Side; 2] {
        let turning = self.ground.patch_squared_m2 * velocity.z * velocity.z;
        [(-1.0, self.treads.left_m_s), (1.0, self.treads.right_m_s)].map(|(sign, tread)| {
            let x = sign * self.geometry.half_width_m;
            let rolling = velocity.y + velocity.z * x;
            let slip = rolling - tread;
            Side {
                x,
                first: if sign < 0.0 { 0 } else { self.geometry.axles },
                rolling,
                slip,
                common: slip * slip + turning + self.ground.slip_squared,
                rolling_root: (rolling * rolling + self.ground.slip_squared).sqrt(),
                turning: x * slip + self.ground.patch_squared_m2 * velocity.z,
            }
        })
    }

    #[inline]
    fn wheel(&self, side: &Side, axle: usize, velocity: &Vector3<f64>, loads: &Loads) -> WheelSums {
        let y = self.geometry.forward_m[axle];
        let s_x = velocity.x - velocity.z * y;
        let across = self.ground.lateral_squared * s_x;
        let lateral = across * s_x;
        let q = (side.common + lateral).sqrt();
        let inverse = 1.0 / q;
        WheelSums {
            y,
            load: loads.of_wheel[side.first + axle],
            lateral,
            q,
            inverse,
            force: inverse * Vector3::new(across, side.slip, side.turning - y * across),
        }
    }

    /// Returns the potential with its derivatives; `pull` is force and moment of the weight.
    pub(super) fn expand(
        &self,
        velocity: &Vector3<f64>,
        loads: &Loads,
        pull: &Vector3<f64>,
    ) -> Expansion {
        let (a2, r2) = (self.ground.lateral_squared, self.ground.patch_squared_m2);
        let mu = self.ground.friction;
        let (mut value, mut gradient) = (-pull.dot(velocity), -pull);
        let (mut h_xx, mut h_xy, mut h_xz) = (0.0, 0.0, 0.0);
        let (mut h_yy, mut h_yz, mut h_zz) = (0.0, 0.0, 0.0);
        for side in self.sides(velocity) {
            let x = side.x;
            let mut load = 0.0;
            // Sums of limit / q, of it times y, and of it times y^2.
            let (mut stiff, mut stiff_y, mut stiff_yy) = (0.0, 0.0, 0.0);
            for axle in 0..self.geometry.axles {
                let wheel = self.wheel(&side, axle, velocity, loads);
                let f = &wheel.force;
                let limit = mu * wheel.load;
                let weight = limit * wheel.inverse;
                let weight_y = weight * wheel.y;
                let bend = weight * f;
                load += wheel.load;
                value += limit * wheel.q;
                gradient += limit * f;
                stiff += weight;
                stiff_y += weight_y;
                stiff_yy += weight_y * wheel.y;
                h_xx -= bend.x * f.x;
                h_xy -= bend.x * f.y;
                h_xz -= bend.x * f.z;
                h_yy -= bend.y * f.y;
                h_yz -= bend.y * f.z;
                h_zz -= bend.z * f.z;
            }
            let resistance = self.ground.rolling_resistance * load;
            let root = side.rolling_root;
            value += resistance * root;
            gradient += resistance * side.rolling / root * side.along();
            let along = stiff + resistance * self.ground.slip_squared / (root * root * root);
            h_xx += a2 * stiff;
            h_xz -= a2 * stiff_y;
            h_yy += along;
            h_yz += x * along;
            h_zz += x * x * along + a2 * stiff_yy + r2 * stiff;
        }
        Expansion {
            value,
            gradient,
            hessian: Matrix3::new(h_xx, h_xy, h_xz, h_xy, h_yy, h_yz, h_xz, h_yz, h_zz),
        }
    }

    /// Returns the curvature of a parabola that touches the potential at `velocity` and lies above it elsewhere.
    pub(super) fn majorant(&self, velocity: &Vector3<f64>, loads: &Loads) -> Matrix3<f64> {
        let (a2, r2) = (self.ground.lateral_squared, self.ground.patch_squared_m2);
        let mut sum = Matrix3::zeros();
        for side in self.sides(velocity) {
            let x = side.x;
            for axle in 0..self.geometry.axles {
                let wheel = self.wheel(&side, axle, velocity, loads);
                let y = wheel.y;
                let weight = self.ground.friction * wheel.load * wheel.inverse;
                let along =
                    weight + self.ground.rolling_resistance * wheel.load / side.rolling_root;
                let (across, turning) = (a2 * weight, r2 * weight);
                sum += Matrix3::new(
                    across,
                    0.0,
                    -y * across,
                    0.0,
                    along,
                    x * along,
                    -y * across,
                    x * along,
                    y * y * across + x * x * along + turning,
                );
            }
        }
        sum
    }

    /// Returns what the derivatives of the gradient by loads and treads are made of.
    pub(super) fn gradient_parts(&self, velocity: &Vector3<f64>, loads: &Loads) -> GradientParts {
        let mut parts = GradientParts::default();
        let mu = self.ground.friction;
        for (side, by_tread) in self.sides(velocity).iter().zip(&mut parts.by_tread) {
            let rolling = self.ground.rolling_resistance * side.rolling / side.rolling_root;
            let (mut units, mut units_by_forward) = (Vector3::zeros(), Vector3::zeros());
            for axle in 0..self.geometry.axles {
                let wheel = self.wheel(side, axle, velocity, loads);
                if wheel.load <= 0.0 {
                    continue;
                }
                let f = &wheel.force;
                *by_tread += mu * wheel.load * wheel.inverse * (f.y * f - side.along());
                let stiffness = self.ground.stiffness[axle];
                let unit = stiffness * (mu * f + rolling * side.along());
                units += unit;
                units_by_forward += wheel.y * unit;
            }
            parts.by_constants += Matrix3::from_columns(&[units, side.x * units, units_by_forward]);
        }
        parts
    }

    /// Returns dg/d(roll, pitch, left tread, right tread).
    pub(super) fn gradient_by_inputs(
        &self,
        parts: &GradientParts,
        loads: &Loads,
        stance: &LoadCase,
        pull_share: f64,
    ) -> SMatrix<f64, 3, 4> {
        let centre = &self.ground.centre;
        let by_demand = parts.by_constants * loads.inverse_stiffness;
        let by = |weight: &Vector3<f64>| {
            by_demand * demand_of(weight, centre) - pull_share * pull_of(weight, centre)
        };
        SMatrix::from_columns(&[
            by(&stance.by_roll),
            by(&stance.by_pitch),
            parts.by_tread[0],
            parts.by_tread[1],
        ])
    }

    /// Returns dg/d(entries of the parameter vector).
    pub(super) fn gradient_by_parameters(
        &self,
        parts: &GradientParts,
        velocity: &Vector3<f64>,
        loads: &Loads,
        stance: &LoadCase,
        pull_share: f64,
    ) -> ByParameters {
        let weight = stance.weight;
        let by_demand = parts.by_constants * loads.inverse_stiffness;
        let (mut by_friction, mut by_lateral) = (Vector3::zeros(), Vector3::zeros());
        let (mut by_slip, mut by_rolling) = (Vector3::zeros(), Vector3::zeros());
        let mut by_patch = Vector3::zeros();
        let omega = velocity.z;
        // Of (force for each unit of load) times the change of a wheel's share with the inner axles' share, and of
        // these changes times the arms.
        let (mut by_share, mut shared_arms) = (Vector3::zeros(), Vector3::zeros());
        // The same of the change of what inner wheels' springs press with the logarithm of their stiffness.
        let (mut by_stiffness, mut stiffer_arms) = (Vector3::zeros(), Vector3::zeros());
        let e2 = self.ground.slip_squared;
        for side in self.sides(velocity) {
            let root = side.rolling_root;
            let rolling = self.ground.rolling_resistance * side.rolling / root;
            let mut load = 0.0;
            for axle in 0..self.geometry.axles {
                let wheel = self.wheel(&side, axle, velocity, loads);
                if wheel.load <= 0.0 {
                    continue;
                }
                load += wheel.load;
                let limit = self.ground.friction * wheel.load;
                let force = limit * wheel.force;
                let inverse = wheel.inverse * wheel.inverse;
                by_friction += force;
                by_slip -= e2 * inverse * force;
                by_patch.z += omega * limit * wheel.inverse;
                by_patch -= 0.5 * omega * omega * inverse * force;
                let across = 2.0 * force.x * Vector3::new(1.0, 0.0, -wheel.y);
                by_lateral += across - wheel.lateral * inverse * force;
                let share = self.geometry.share_by_inner(axle, self.ground.has_inner);
                let unit = self.ground.friction * wheel.force + rolling * side.along();
                let arm = Vector3::new(1.0, side.x, wheel.y);
                by_share += share * unit;
                shared_arms += share * arm;
                if self.geometry.inner[axle] {
                    let pressed = self.ground.stiffness[axle] * loads.constants.dot(&arm);
                    by_stiffness += pressed * unit;
                    stiffer_arms += pressed * arm;
                }
            }
            let resisting = load * side.rolling / root;
            by_rolling += resisting * side.along();
            let slower = -self.ground.rolling_resistance * resisting * e2 / (root * root);
            by_slip += slower * side.along();
        }
        let pressing = -weight.z;
        let centre_right = by_demand * Vector3::new(0.0, pressing, 0.0)
            - pull_share * Vector3::new(0.0, 0.0, weight.y);
        let centre_forward = by_demand * Vector3::new(0.0, 0.0, pressing)
            + pull_share * Vector3::new(0.0, 0.0, weight.x);
        let centre_height = by_demand * Vector3::new(0.0, weight.x, weight.y);
        let inner = if loads.stands {
            by_share - by_demand * shared_arms
        } else {
            pressing.max(0.1) * by_share
        };
        ByParameters::from_columns(&[
            by_friction,
            centre_right,
            centre_forward,
            centre_height,
            inner,
            by_stiffness - by_demand * stiffer_arms,
            by_lateral,
            by_slip,
            by_rolling,
            by_patch,
            Vector3::zeros(),
            Vector3::zeros(),
            self.treads.left_m_s * parts.by_tread[0],
            self.treads.right_m_s * parts.by_tread[1],
        ])
    }
}
