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

mod geometry;
mod loads;
mod sums;
#[cfg(test)]
mod tests;

use super::parameters::{Parameter, ParameterVector};
use super::vehicle::ContactVehicle;
use crate::bounds::RangeError;
use crate::frames::{Attitude, BodyVelocity};
use crate::prediction::Linearised;
use crate::speeds::{MotorSpeeds, TreadSpeeds};

pub use geometry::ByParameters;
use geometry::{Geometry, Ground};
use loads::{Loads, Stance};
use nalgebra::{Matrix3, Vector3};
use sums::{Expansion, Sums};

/// Force left over, as a share of the weight, below which the balance counts as solved ...
const TOLERANCE: f64 = 1e-9;
/// ... if Newton's step is shorter than this, too, m/s or rad/s.
const STEP_TOLERANCE: f64 = 1e-9;
/// Rounding of the potential over the weight, m/s.
const ROUNDING: f64 = 1e-14;
/// Steps of a search at most; from where the previous solution leads two or three do, and from far away
/// at the end of grip about forty.
const ITERATIONS_MAX: usize = 150;
/// Damping of a search's step after the first that did not descend, and factor for each further one.
const DAMPING: (f64, f64) = (1e-3, 10.0);
/// Attempts with less and less of the pull along the ground where friction does not hold all of it.
const ATTEMPTS: usize = 6;
/// Share of the friction limit that the first of these attempts pulls with.
const HELD_SHARE: f64 = 0.9;
/// Largest speed at which a vehicle counts as held, m/s or rad/s.
const SPEED_MAX: f64 = 20.0;
/// Speed up to which a search may pass on its way, m/s or rad/s.
const SEARCHED_MAX: f64 = 100.0;

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

    /// Searches the balance; none where there is none within [`SPEED_MAX`].
    ///
    /// Each step goes to the minimum of a parabola of curvature H + d M, with H the Hessian and M the
    /// [majorant](Self::majorant). With d = 0 it is Newton's step, which ends the search within a few
    /// steps but leads anywhere where wheels slip by much more than the slip scale. With d = 1 it
    /// descends from everywhere, but slowly near the end of grip. d grows where a step does not descend
    /// and shrinks where it does (Levenberg-Marquardt), so that the minimum is found from any start.
    fn search(
        &self,
        start: Vector3<f64>,
        loads: &Loads,
        pull: &Vector3<f64>,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let mut velocity = start;
        let mut here = self.expand(&velocity, loads, pull);
        let mut damping = 0.0;
        for _ in 0..ITERATIONS_MAX {
            let Some(inverse) = self
                .curvature(&velocity, &here, loads, damping)
                .try_inverse()
            else {
                damping = more(damping)?;
                continue;
            };
            let step = -inverse * here.gradient;
            if damping == 0.0 && here.gradient.norm() < TOLERANCE && step.norm() < STEP_TOLERANCE {
                velocity += step;
                return (velocity.norm() <= SPEED_MAX).then_some((velocity, inverse));
            }
            let candidate = velocity + step;
            if candidate.norm() > SEARCHED_MAX {
                damping = more(damping)?;
                continue;
            }
            let there = self.expand(&candidate, loads, pull);
            let descends = there.value < here.value + 1e-4 * here.gradient.dot(&step);
            // Near the minimum, rounding hides the descent of the potential, not of its gradient.
            let flattens = there.value < here.value + ROUNDING
                && there.gradient.norm() < 0.7 * here.gradient.norm();
            if descends || flattens {
                (velocity, here) = (candidate, there);
                damping = less(damping);
            } else if damping == 0.0 && here.gradient.norm() < TOLERANCE {
                // Rounding ends the search where the balance is so flat that it hides the step.
                return (velocity.norm() <= SPEED_MAX).then_some((velocity, inverse));
            } else {
                damping = more(damping)?;
            }
        }
        None
    }

    fn curvature(
        &self,
        velocity: &Vector3<f64>,
        here: &Expansion,
        loads: &Loads,
        damping: f64,
    ) -> Matrix3<f64> {
        if damping > 0.0 {
            here.hessian + damping * self.majorant(velocity, loads)
        } else {
            here.hessian
        }
    }

    fn mean_tread_m_s(&self) -> f64 {
        let TreadSpeeds {
            left_m_s,
            right_m_s,
        } = self.treads;
        0.5 * (left_m_s + right_m_s)
    }
}

/// Returns the next larger damping; none beyond the one that always descends, so that there is no balance
/// or its potential is not finite.
fn more(damping: f64) -> Option<f64> {
    let (first, factor) = DAMPING;
    let next = if damping > 0.0 {
        factor * damping
    } else {
        first
    };
    (next < 2.0 * factor).then_some(next)
}

fn less(damping: f64) -> f64 {
    let (first, factor) = DAMPING;
    if damping > first {
        damping / factor
    } else {
        0.0
    }
}
