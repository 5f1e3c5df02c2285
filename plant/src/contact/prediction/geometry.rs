//! The wheels and the ground under them, in the form that the sums over wheels need.

use crate::bounds::{Bounds, RangeError};
use crate::contact::parameters::{PARAMETERS, Parameter, ParameterVector};
use crate::contact::vehicle::ContactVehicle;
use nalgebra::{Matrix3, SMatrix, Vector3};

/// Axles at most.
pub(in crate::contact) const AXLES_MAX: usize = 16;
/// Wheels at most.
pub(in crate::contact) const WHEELS_MAX: usize = 2 * AXLES_MAX;

/// Derivatives of (v_x, v_y, omega) by the parameters.
pub type ByParameters = SMatrix<f64, 3, { PARAMETERS }>;

/// Geometry of the wheels: what a tape measures.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::contact) struct Geometry {
    pub(in crate::contact) axles: usize,
    pub(in crate::contact) half_width_m: f64,
    pub(in crate::contact) half_length_m: f64,
    pub(in crate::contact) forward_m: [f64; AXLES_MAX],
    pub(in crate::contact) inner: [bool; AXLES_MAX],
    /// Part of its group's load (inner, outer axles) that an axle carries on level ground.
    pub(in crate::contact) part: [f64; AXLES_MAX],
}

/// The parameters in the form that the sums need.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::contact) struct Ground {
    pub(in crate::contact) friction: f64,
    pub(in crate::contact) lateral_squared: f64,
    pub(in crate::contact) slip_squared: f64,
    pub(in crate::contact) rolling_resistance: f64,
    pub(in crate::contact) patch_squared_m2: f64,
    pub(in crate::contact) centre: Vector3<f64>,
    /// Share of the weight on each wheel of an axle.
    pub(in crate::contact) wheel_share: [f64; AXLES_MAX],
    /// Sum over all wheels of arm times share; an arm is (1, x, y).
    pub(in crate::contact) carried: Vector3<f64>,
    /// Stiffness k of each wheel of an axle, over that of the outer axles'.
    pub(in crate::contact) stiffness: [f64; AXLES_MAX],
    /// Sum over all wheels of k arm arm', inverted.
    pub(in crate::contact) inverse_stiffness: Matrix3<f64>,
    pub(in crate::contact) has_inner: bool,
    /// Inertia over that of a box on the wheels.
    pub(in crate::contact) inertia: f64,
    /// Relaxation length of the tyres, m.
    pub(in crate::contact) relaxation_length_m: f64,
    /// Factors of the left and the right tread.
    pub(in crate::contact) tread_factors: [f64; 2],
}

impl Geometry {
    pub(in crate::contact) fn of(vehicle: &ContactVehicle) -> Result<Self, RangeError> {
        let axles = vehicle.axles.len();
        Bounds::new(2.0, AXLES_MAX as f64, "").check("axles", axles as f64)?;
        let mut geometry = Self {
            axles,
            half_width_m: vehicle.half_width_m,
            half_length_m: vehicle.half_length_m(),
            forward_m: [0.0; AXLES_MAX],
            inner: [false; AXLES_MAX],
            part: [0.0; AXLES_MAX],
        };
        let inner_share = vehicle.inner_share();
        let inner_axles = vehicle.axles.iter().filter(|a| vehicle.is_inner(a)).count();
        for (k, axle) in vehicle.axles.iter().enumerate() {
            let inner = vehicle.is_inner(axle);
            let (carried, count) = if inner {
                (inner_share, inner_axles)
            } else {
                (1.0 - inner_share, axles - inner_axles)
            };
            geometry.forward_m[k] = axle.forward_m;
            geometry.inner[k] = inner;
            geometry.part[k] = if carried > 1e-6 {
                axle.load_share / carried
            } else {
                1.0 / count as f64
            };
        }
        let length_m = vehicle.axles.iter().map(|a| a.forward_m);
        let length_m =
            length_m.clone().fold(f64::MIN, f64::max) - length_m.fold(f64::MAX, f64::min);
        Bounds::new(0.01, 100.0, "m").check("axles, first to last", length_m)?;
        Ok(geometry)
    }

    /// Returns the axle of a wheel; the left ones come first.
    pub(in crate::contact) fn axle(&self, wheel: usize) -> usize {
        if wheel < self.axles {
            wheel
        } else {
            wheel - self.axles
        }
    }

    /// Returns the position of a wheel.
    pub(in crate::contact) fn wheel(&self, index: usize) -> (f64, f64) {
        let right_m = if index < self.axles {
            -self.half_width_m
        } else {
            self.half_width_m
        };
        (right_m, self.forward_m[self.axle(index)])
    }

    pub(in crate::contact) fn arm(&self, index: usize) -> Vector3<f64> {
        let (x, y) = self.wheel(index);
        Vector3::new(1.0, x, y)
    }

    /// Returns how the load share of each wheel of an axle changes with the inner axles' share.
    pub(in crate::contact) fn share_by_inner(&self, axle: usize, has_inner: bool) -> f64 {
        if !has_inner {
            0.0
        } else if self.inner[axle] {
            0.5 * self.part[axle]
        } else {
            -0.5 * self.part[axle]
        }
    }
}

impl Ground {
    pub(in crate::contact) fn new(geometry: &Geometry, parameters: &ParameterVector) -> Self {
        let value = |parameter: Parameter| parameter.value(parameters[parameter.index()]);
        let has_inner = geometry.inner[..geometry.axles].contains(&true);
        let inner = if has_inner {
            value(Parameter::InnerShare)
        } else {
            0.0
        };
        let wheel_share: [f64; AXLES_MAX] = std::array::from_fn(|k| {
            let group = if geometry.inner[k] {
                inner
            } else {
                1.0 - inner
            };
            0.5 * geometry.part[k] * group
        });
        let carried = (0..2 * geometry.axles)
            .map(|i| geometry.arm(i) * wheel_share[geometry.axle(i)])
            .sum();
        let inner_stiffness = value(Parameter::InnerStiffness);
        let stiffness: [f64; AXLES_MAX] = geometry
            .inner
            .map(|inner| if inner { inner_stiffness } else { 1.0 });
        let whole: Matrix3<f64> = (0..2 * geometry.axles)
            .map(|i| {
                let arm = geometry.arm(i);
                stiffness[geometry.axle(i)] * arm * arm.transpose()
            })
            .sum();
        Self {
            friction: value(Parameter::Friction),
            lateral_squared: value(Parameter::LateralShare).powi(2),
            slip_squared: value(Parameter::SlipScale).powi(2),
            rolling_resistance: value(Parameter::RollingResistance),
            patch_squared_m2: value(Parameter::PatchRadius).powi(2),
            centre: Vector3::new(
                value(Parameter::CentreRight),
                value(Parameter::CentreForward),
                value(Parameter::CentreHeight),
            ),
            wheel_share,
            carried,
            stiffness,
            inverse_stiffness: whole.try_inverse().unwrap_or_default(),
            has_inner,
            inertia: value(Parameter::Inertia),
            relaxation_length_m: value(Parameter::RelaxationLength),
            tread_factors: [value(Parameter::LeftTread), value(Parameter::RightTread)],
        }
    }
}
