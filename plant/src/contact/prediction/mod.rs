//! The balance of wheel friction as a prediction model: fast, without allocation, with analytic
//! derivatives by inputs, attitude and parameters.
//!
//! The velocity u = (v_x, v_y, omega) is the minimum of the potential P of the [module's
//! documentation](super), g(u, z) = dP/du = 0, with all forces over the weight m g, so that the mass
//! is nothing to it. By the implicit function theorem
//!
//! ```text
//! du/dz = -H^-1 dg/dz,    H = d^2 P/du^2
//! ```
//!
//! for z any of tread speeds, roll, pitch and the [`Parameter`](super::Parameter)s; H is there from
//! Newton's method. The search starts at the previous solution moved along its own derivatives, so that one
//! or two Newton steps do from stage to stage of a horizon.
//!
//! Everything has an answer. Where the vehicle would overturn, its wheels carry what they carry on level
//! ground; where friction does not hold it, so much of the weight's pull along the ground is left
//! out that it does. Either makes [`Predicted::holds`] false.

mod loads;
mod sums;
#[cfg(test)]
mod tests;

use super::parameters::{Parameter, ParameterVector};
use super::vehicle::ContactVehicle;
use crate::bounds::{Bounds, RangeError};
use crate::frames::{Attitude, BodyVelocity};
use crate::prediction::Linearised;
use crate::speeds::{MotorSpeeds, TreadSpeeds};

use loads::{Loads, Stance};
use nalgebra::{Matrix3, SMatrix, Vector3};
use sums::{Expansion, Sums};

/// Axles at most.
pub(super) const AXLES_MAX: usize = 16;
/// Wheels at most.
const WHEELS_MAX: usize = 2 * AXLES_MAX;

/// Force left over, as a share of the weight, at which the balance counts as solved: a velocity error
/// below 1e-9 m/s.
const TOLERANCE: f64 = 1e-9;
/// Newton steps at most; from where the previous solution leads two or three do.
const ITERATIONS_MAX: usize = 60;
/// Attempts with less and less of the pull along the ground where friction does not hold all of it.
const ATTEMPTS: usize = 6;
/// Share of the friction limit that the first of these attempts pulls with.
const HELD_SHARE: f64 = 0.9;
/// A speed beyond which a search has lost its hold, m/s or rad/s.
const SPEED_MAX: f64 = 20.0;

/// Derivatives of (v_x, v_y, omega) by the parameters.
pub type ByParameters = SMatrix<f64, 3, { super::PARAMETERS }>;

/// A velocity in balance with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// The velocity and its derivatives by inputs and attitude.
    pub linearised: Linearised,
    /// Its derivatives by the entries of the parameter vector.
    pub by_parameters: ByParameters,
    /// Whether friction holds the vehicle there and it stands on its wheels.
    pub holds: bool,
}

/// Geometry of the wheels: what a tape measures.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Geometry {
    axles: usize,
    half_width_m: f64,
    half_length_m: f64,
    patch_squared_m2: f64,
    forward_m: [f64; AXLES_MAX],
    inner: [bool; AXLES_MAX],
    /// Part of its group's load (inner, outer axles) that an axle carries on level ground.
    part: [f64; AXLES_MAX],
    /// Sum over all wheels of arm arm', inverted; an arm is (1, x, y).
    inverse_stiffness: Matrix3<f64>,
}

/// The parameters in the form that the sums need.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Ground {
    friction: f64,
    lateral_squared: f64,
    slip_squared: f64,
    rolling_resistance: f64,
    centre: Vector3<f64>,
    /// Share of the weight on each wheel of an axle.
    wheel_share: [f64; AXLES_MAX],
    has_inner: bool,
}

/// Motion of a contact vehicle in balance, for prediction and dead reckoning.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactPrediction {
    geometry: Geometry,
    parameters: ParameterVector,
    ground: Ground,
    previous: Option<Previous>,
}

/// Where the last search ended.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Previous {
    attitude: Attitude,
    motors: MotorSpeeds,
    linearised: Linearised,
}

/// A search's end.
struct Solution {
    velocity: Vector3<f64>,
    inverse_hessian: Matrix3<f64>,
    loads: Loads,
    pull_share: f64,
    holds: bool,
}

impl ContactPrediction {
    /// Returns the model of a vehicle with the vehicle's own parameters.
    ///
    /// # Errors
    /// [`RangeError`] where the axles do not carry the vehicle: all at one place.
    pub fn new(vehicle: &ContactVehicle) -> Result<Self, RangeError> {
        let geometry = Geometry::of(vehicle)?;
        let parameters = vehicle.parameters();
        Ok(Self {
            ground: Ground::new(&geometry, &parameters),
            geometry,
            parameters,
            previous: None,
        })
    }

    /// Returns the parameters it predicts with.
    pub fn parameters(&self) -> &ParameterVector {
        &self.parameters
    }

    /// Replaces the parameters, as online learning does; they are put within their ranges first.
    pub fn set_parameters(&mut self, parameters: &ParameterVector) {
        if *parameters != self.parameters {
            self.parameters = self.within_ranges(parameters);
            self.ground = Ground::new(&self.geometry, &self.parameters);
        }
    }

    /// Returns the parameters within the ranges that a vehicle of this geometry may have; what is not finite
    /// becomes the nearer end, or the lower where there is none.
    pub fn within_ranges(&self, parameters: &ParameterVector) -> ParameterVector {
        ParameterVector::from_fn(|i, _| {
            let parameter = Parameter::ALL[i];
            let (low, high) =
                parameter.range(self.geometry.half_width_m, self.geometry.half_length_m);
            let low = parameter.entry(low);
            if parameters[i].is_nan() {
                low
            } else {
                parameters[i].clamp(low, parameter.entry(high))
            }
        })
    }

    /// Returns the velocity at an attitude and motor speeds with its derivatives by these.
    pub fn body_velocity(&mut self, attitude: Attitude, motors: MotorSpeeds) -> Linearised {
        self.balance(attitude, motors).0
    }

    /// Returns the velocity at an attitude and motor speeds with all its derivatives.
    pub fn predict(&mut self, attitude: Attitude, motors: MotorSpeeds) -> Predicted {
        let (linearised, solution) = self.balance(attitude, motors);
        let sums = Sums {
            geometry: &self.geometry,
            ground: &self.ground,
            treads: motors.into(),
        };
        let by_parameters = -solution.inverse_hessian
            * sums.gradient_by_parameters(
                &solution.velocity,
                &solution.loads,
                &attitude,
                solution.pull_share,
            );
        Predicted {
            linearised,
            by_parameters,
            holds: solution.holds,
        }
    }

    fn balance(&mut self, attitude: Attitude, motors: MotorSpeeds) -> (Linearised, Solution) {
        let sums = Sums {
            geometry: &self.geometry,
            ground: &self.ground,
            treads: motors.into(),
        };
        let stance = Stance::at(&attitude);
        let loads = Loads::of(&self.geometry, &self.ground, &stance);
        let start = self.previous.map_or_else(
            || Vector3::new(0.0, motors.traction_m_s, 0.0),
            |previous| previous.leads_to(attitude, motors),
        );
        let solution = sums.settle(start, loads, &stance);
        let by = -solution.inverse_hessian
            * sums.gradient_by_inputs(
                &solution.velocity,
                &solution.loads,
                &attitude,
                solution.pull_share,
            );
        let (left, right) = (by.column(2), by.column(3));
        let velocity = &solution.velocity;
        let linearised = Linearised {
            velocity: BodyVelocity {
                right_m_s: velocity.x,
                forward_m_s: velocity.y,
                yaw_rate_rad_s: velocity.z,
            },
            by_roll: by.column(0).into(),
            by_pitch: by.column(1).into(),
            by_traction: left + right,
            by_steer: right - left,
        };
        self.previous = Some(Previous {
            attitude,
            motors,
            linearised,
        });
        (linearised, solution)
    }
}

impl Previous {
    /// Returns the velocity that its derivatives lead to at another attitude and input.
    fn leads_to(&self, attitude: Attitude, motors: MotorSpeeds) -> Vector3<f64> {
        let before = &self.linearised;
        let velocity = Vector3::new(
            before.velocity.right_m_s,
            before.velocity.forward_m_s,
            before.velocity.yaw_rate_rad_s,
        );
        velocity
            + before.by_roll * (attitude.roll_rad - self.attitude.roll_rad)
            + before.by_pitch * (attitude.pitch_rad - self.attitude.pitch_rad)
            + before.by_traction * (motors.traction_m_s - self.motors.traction_m_s)
            + before.by_steer * (motors.steer_m_s - self.motors.steer_m_s)
    }
}

impl Geometry {
    fn of(vehicle: &ContactVehicle) -> Result<Self, RangeError> {
        let axles = vehicle.axles.len();
        Bounds::new(2.0, AXLES_MAX as f64, "").check("axles", axles as f64)?;
        let mut geometry = Self {
            axles,
            half_width_m: vehicle.half_width_m,
            half_length_m: vehicle.half_length_m(),
            patch_squared_m2: vehicle.friction.patch_radius_m.powi(2),
            forward_m: [0.0; AXLES_MAX],
            inner: [false; AXLES_MAX],
            part: [0.0; AXLES_MAX],
            inverse_stiffness: Matrix3::zeros(),
        };
        let inner_share = vehicle.inner_share();
        let inner_axles = vehicle.axles.iter().filter(|a| vehicle.is_inner(a)).count();
        let mut stiffness = Matrix3::zeros();
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
            for x in [-vehicle.half_width_m, vehicle.half_width_m] {
                let arm = Vector3::new(1.0, x, axle.forward_m);
                stiffness += arm * arm.transpose();
            }
        }
        let length_m = vehicle.axles.iter().map(|a| a.forward_m);
        let length_m =
            length_m.clone().fold(f64::MIN, f64::max) - length_m.fold(f64::MAX, f64::min);
        Bounds::new(0.01, 100.0, "m").check("axles, first to last", length_m)?;
        if let Some(inverse) = stiffness.try_inverse() {
            geometry.inverse_stiffness = inverse;
        }
        Ok(geometry)
    }

    /// Returns the position of a wheel: the left ones first.
    fn wheel(&self, index: usize) -> (f64, f64) {
        if index < self.axles {
            (-self.half_width_m, self.forward_m[index])
        } else {
            (self.half_width_m, self.forward_m[index - self.axles])
        }
    }

    fn arm(&self, index: usize) -> Vector3<f64> {
        let (x, y) = self.wheel(index);
        Vector3::new(1.0, x, y)
    }

    /// Returns how the load share of each wheel of an axle changes with the inner axles' share.
    fn share_by_inner(&self, axle: usize, has_inner: bool) -> f64 {
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
    fn new(geometry: &Geometry, parameters: &ParameterVector) -> Self {
        let value = |parameter: Parameter| parameter.value(parameters[parameter.index()]);
        let has_inner = geometry.inner[..geometry.axles].contains(&true);
        let inner = if has_inner {
            value(Parameter::InnerShare)
        } else {
            0.0
        };
        Self {
            friction: value(Parameter::Friction),
            lateral_squared: value(Parameter::LateralShare).powi(2),
            slip_squared: value(Parameter::SlipScale).powi(2),
            rolling_resistance: value(Parameter::RollingResistance),
            centre: Vector3::new(
                value(Parameter::CentreRight),
                value(Parameter::CentreForward),
                value(Parameter::CentreHeight),
            ),
            wheel_share: std::array::from_fn(|k| {
                let group = if geometry.inner[k] {
                    inner
                } else {
                    1.0 - inner
                };
                0.5 * geometry.part[k] * group
            }),
            has_inner,
        }
    }
}

impl Sums<'_> {
    /// Returns the balance nearest to what is asked for: with all of the pull along the ground where
    /// friction holds it, otherwise with less.
    fn settle(&self, start: Vector3<f64>, loads: Loads, stance: &Stance) -> Solution {
        let pull = stance.pull(&self.ground.centre);
        let along = stance.weight.xy().norm();
        // Friction forces of all wheels together never exceed this.
        let lateral = self.ground.lateral_squared.sqrt().max(1.0);
        let limit = self.ground.friction * lateral * -stance.weight.z;
        let mut pull_share = 1.0;
        if along > limit {
            pull_share = HELD_SHARE * limit / along;
        }
        let mut begin = if start.norm() < SPEED_MAX {
            start
        } else {
            Vector3::zeros()
        };
        for attempt in 0..=ATTEMPTS {
            if attempt > 0 {
                let held = self.ground.friction * self.ground.lateral_squared.sqrt().min(1.0);
                let less = HELD_SHARE * held * -stance.weight.z / along.max(1e-9);
                pull_share = if attempt == 1 {
                    less.min(HELD_SHARE * pull_share)
                } else {
                    0.5 * pull_share
                };
                begin = Vector3::new(0.0, self.mean_tread_m_s(), 0.0);
            }
            if let Some((velocity, inverse_hessian)) =
                self.search(begin, &loads, &(pull_share * pull))
            {
                return Solution {
                    velocity,
                    inverse_hessian,
                    holds: pull_share >= 1.0 && loads.stands,
                    loads,
                    pull_share,
                };
            }
        }
        // Not reached but by values that are not finite: stand still, insensitive to everything.
        Solution {
            velocity: Vector3::zeros(),
            inverse_hessian: Matrix3::zeros(),
            loads,
            pull_share: 0.0,
            holds: false,
        }
    }

    /// Searches the balance by a safeguarded Newton method; none where it does not settle.
    fn search(
        &self,
        start: Vector3<f64>,
        loads: &Loads,
        pull: &Vector3<f64>,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let mut velocity = start;
        let mut here = self.expand(&velocity, loads, pull);
        for _ in 0..ITERATIONS_MAX {
            if here.gradient.norm() < TOLERANCE {
                break;
            }
            (velocity, here) = self.improve(&velocity, &here, loads, pull)?;
            if velocity.norm().is_nan() || velocity.norm() > SPEED_MAX {
                return None;
            }
        }
        if here.gradient.norm() < TOLERANCE {
            Some((velocity, here.hessian.try_inverse()?))
        } else {
            None
        }
    }

    fn improve(
        &self,
        velocity: &Vector3<f64>,
        here: &Expansion,
        loads: &Loads,
        pull: &Vector3<f64>,
    ) -> Option<(Vector3<f64>, Expansion)> {
        let inverse = here.hessian.try_inverse()?;
        let step = -inverse * here.gradient;
        let candidate = velocity + step;
        let there = self.expand(&candidate, loads, pull);
        let descends = there.value < here.value + 1e-4 * here.gradient.dot(&step);
        // Near the minimum, rounding hides the descent of the potential, not of its gradient.
        let flattens = there.gradient.norm() < 0.7 * here.gradient.norm();
        if descends || flattens {
            return Some((candidate, there));
        }
        let majorant = self.majorant(velocity, loads).try_inverse()?;
        let candidate = velocity - majorant * here.gradient;
        let there = self.expand(&candidate, loads, pull);
        Some((candidate, there))
    }

    fn mean_tread_m_s(&self) -> f64 {
        let TreadSpeeds {
            left_m_s,
            right_m_s,
        } = self.treads;
        0.5 * (left_m_s + right_m_s)
    }
}
