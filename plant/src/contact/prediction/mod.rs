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
//! Newton's method. The search starts at a solution nearby moved along its own derivatives, so that one or two
//! Newton steps do from stage to stage of a horizon, or from cycle to cycle.
//!
//! Everything has an answer. Where the vehicle would overturn, its wheels carry what they carry on level
//! ground; where friction does not hold it, so much of the weight's pull along the ground is left
//! out that it does. Either makes [`Predicted::holds`] false.

mod following;
mod geometry;
mod loads;
mod search;
mod sums;
#[cfg(test)]
mod tests;

use super::parameters::{Parameter, ParameterVector};
use super::vehicle::ContactVehicle;
use crate::bounds::RangeError;
use crate::frames::{Attitude, BodyVelocity, Tilt};
use crate::linearised::Linearised;
use crate::speeds::{MotorSpeeds, TreadSpeeds};

pub use following::{BodyState, Followed, Following, Lag};
pub use geometry::ByParameters;
use geometry::{Geometry, Ground};
use loads::{LoadCase, Loads};
use nalgebra::Vector3;
use search::{BalanceSolution, TOLERANCE, TOLERANCE_OF_ROLL_OUT};
use sums::{ForceSums, GradientParts};

/// A velocity in balance with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Predicted {
    /// The velocity and its derivatives by inputs and attitude.
    pub linearised: Linearised,
    /// Its derivatives by the entries of the parameter vector; by inertia and relaxation
    /// length, which steady motion does not depend on, 0.
    pub by_parameters: ByParameters,
    /// How late inertia and tyres let the vehicle follow.
    pub lag: Lag,
    /// Whether friction holds the vehicle there and it stands on its wheels.
    pub holds: bool,
}

/// Least friction of a vehicle that stands on a slope, over the slope's tangent. Below 1 the ground does not hold
/// it, and just above it slides downhill faster than any vehicle that is driven.
const HELD: f64 = 1.25;

/// Motion of a contact vehicle in balance, for prediction and dead reckoning.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactPrediction {
    geometry: Geometry,
    parameters: ParameterVector,
    ground: Ground,
    last: Option<FoundBalance>,
}

/// A balance that was found, near which another search may begin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FoundBalance {
    tilt: Tilt,
    motors: MotorSpeeds,
    linearised: Linearised,
    lag: Lag,
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
            last: None,
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

    /// Forgets the balance found last, so that what follows does not depend on it, not even in its last digits.
    pub fn forget_found(&mut self) {
        self.last = None;
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

    /// Returns the parameters within their ranges, with enough friction to hold a vehicle at this attitude: at least
    /// 1.25 times the tangent of the slope, lengthways and sideways.
    pub fn holding(&self, parameters: &ParameterVector, attitude: &Attitude) -> ParameterVector {
        let normal = attitude.plane_normal(0.0);
        let slope = normal.xy().norm() / normal.z.max(f64::MIN_POSITIVE);
        let mut held = *parameters;
        let weaker = held[Parameter::LateralShare.index()].min(0.0);
        let friction = &mut held[Parameter::Friction.index()];
        *friction = friction.max(Parameter::Friction.entry(HELD * slope) - weaker);
        self.within_ranges(&held)
    }

    /// Returns the velocity at an attitude and motor speeds with its derivatives by these.
    pub fn body_velocity(&mut self, tilt: impl Into<Tilt>, motors: MotorSpeeds) -> Linearised {
        let tilt = tilt.into();
        let start = self.start(None, tilt, motors);
        self.balance(start, &self.loads(&tilt), tilt, motors)
            .0
            .linearised
    }

    /// Returns the same and how late the vehicle follows it; the search begins at `near`, where that was found closer by
    /// than what this model found last, and what is found becomes the new `near`.
    pub fn body_velocity_near(
        &mut self,
        near: &mut Option<FoundBalance>,
        tilt: impl Into<Tilt>,
        motors: MotorSpeeds,
    ) -> (Linearised, Lag) {
        let tilt = tilt.into();
        let start = self.start(near.as_ref(), tilt, motors);
        let found = self.balance(start, &self.loads(&tilt), tilt, motors).0;
        *near = Some(found);
        (found.linearised, found.lag)
    }

    /// Returns the velocity alone, to 1e-6 m/s and rad/s, by a search that begins at `near`.
    pub fn velocity_near(
        &self,
        near: Option<&FoundBalance>,
        tilt: impl Into<Tilt>,
        motors: MotorSpeeds,
    ) -> BodyVelocity {
        let tilt = tilt.into();
        let start = self.start(near, tilt, motors);
        let (loads, stance) = (self.loads(&tilt), LoadCase::at(&tilt));
        let sums = self.sums(motors);
        let velocity = sums
            .settle(start, &loads, &stance, TOLERANCE_OF_ROLL_OUT)
            .velocity;
        BodyVelocity::from_vector(&velocity)
    }

    /// Returns the velocity at an attitude and motor speeds with all its derivatives.
    pub fn predict(&mut self, tilt: impl Into<Tilt>, motors: MotorSpeeds) -> Predicted {
        let tilt = tilt.into();
        let start = self.start(None, tilt, motors);
        let loads = self.loads(&tilt);
        let (found, solution, parts) = self.balance(start, &loads, tilt, motors);
        let by_parameters = -solution.inverse_hessian
            * self.sums(motors).gradient_by_parameters(
                &parts,
                &solution.velocity,
                &loads,
                &LoadCase::at(&tilt),
                solution.pull_share,
            );
        Predicted {
            linearised: found.linearised,
            by_parameters,
            lag: found.lag,
            holds: solution.holds,
        }
    }

    fn loads(&self, tilt: &Tilt) -> Loads {
        Loads::of(&self.geometry, &self.ground, &LoadCase::at(tilt))
    }

    fn sums(&self, motors: MotorSpeeds) -> ForceSums<'_> {
        let treads = TreadSpeeds::from(motors);
        let [left, right] = self.ground.tread_factors;
        ForceSums {
            geometry: &self.geometry,
            ground: &self.ground,
            treads: TreadSpeeds {
                left_m_s: left * treads.left_m_s,
                right_m_s: right * treads.right_m_s,
            },
        }
    }

    /// Returns where a search begins: where the nearer of `near` and of what was found last leads.
    fn start(&self, near: Option<&FoundBalance>, tilt: Tilt, motors: MotorSpeeds) -> Vector3<f64> {
        let nearer = match (near, &self.last) {
            (Some(near), Some(last)) => {
                let further = near.distance(tilt, motors) > last.distance(tilt, motors);
                Some(if further { last } else { near })
            }
            (near, last) => near.or(last.as_ref()),
        };
        nearer.map_or_else(
            || Vector3::new(0.0, motors.traction_m_s, 0.0),
            |found| found.leads_to(tilt, motors),
        )
    }

    fn balance(
        &mut self,
        start: Vector3<f64>,
        loads: &Loads,
        tilt: Tilt,
        motors: MotorSpeeds,
    ) -> (FoundBalance, BalanceSolution, GradientParts) {
        let stance = LoadCase::at(&tilt);
        let sums = self.sums(motors);
        let solution = sums.settle(start, loads, &stance, TOLERANCE);
        let parts = sums.gradient_parts(&solution.velocity, loads);
        let by = -solution.inverse_hessian
            * sums.gradient_by_inputs(&parts, loads, &stance, solution.pull_share);
        let factors = &self.ground.tread_factors;
        let (left, right) = (factors[0] * by.column(2), factors[1] * by.column(3));
        let linearised = Linearised {
            velocity: BodyVelocity::from_vector(&solution.velocity),
            by_roll: by.column(0).into(),
            by_pitch: by.column(1).into(),
            by_traction: left + right,
            by_steer: right - left,
        };
        let found = FoundBalance {
            tilt,
            motors,
            linearised,
            lag: Lag::new(
                &self.geometry,
                &self.ground,
                sums.treads,
                &stance,
                &solution,
            ),
        };
        self.last = Some(found);
        (found, solution, parts)
    }
}

impl FoundBalance {
    /// Returns how far it was found from an attitude and input; only comparable with others.
    fn distance(&self, tilt: Tilt, motors: MotorSpeeds) -> f64 {
        let (roll, pitch) = tilt.less(&self.tilt);
        roll * roll
            + pitch * pitch
            + (motors.traction_m_s - self.motors.traction_m_s).powi(2)
            + (motors.steer_m_s - self.motors.steer_m_s).powi(2)
    }

    /// Returns the velocity that its derivatives lead to at another attitude and input.
    fn leads_to(&self, tilt: Tilt, motors: MotorSpeeds) -> Vector3<f64> {
        let before = &self.linearised;
        let (roll, pitch) = tilt.less(&self.tilt);
        before.velocity.vector()
            + before.by_roll * roll
            + before.by_pitch * pitch
            + before.by_traction * (motors.traction_m_s - self.motors.traction_m_s)
            + before.by_steer * (motors.steer_m_s - self.motors.steer_m_s)
    }
}
