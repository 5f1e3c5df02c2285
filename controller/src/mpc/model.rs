//! The prediction models of the MPC.

use nalgebra::Vector3;
use sidehill_plant::contact::{BodyState, ContactPrediction, Following, FoundBalance};
use sidehill_plant::frames::{Attitude, BodyVelocity};
use sidehill_plant::prediction::{
    Linearised, LinearisedStep, PredictionModel, increment_on_plane, step_on_plane,
};
use sidehill_plant::speeds::MotorSpeeds;

/// A model of the motion on a plane.
#[derive(Debug, Clone, PartialEq)]
pub enum Model {
    /// ICRIK with a learned correction, or one of the models that are special cases of it.
    Icr(Box<PredictionModel>),
    /// The balance of wheel friction.
    Contact(Box<ContactPrediction>),
}

/// What was found for a step in the cycle before: the balances at its start and its middle, and how the vehicle
/// follows them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct StepStart([Place; 2]);

#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    near: Option<FoundBalance>,
    following: Following,
}

impl Default for StepStart {
    fn default() -> Self {
        Self(
            [Place {
                near: None,
                following: Following::AT_ONCE,
            }; 2],
        )
    }
}

impl Model {
    /// Returns the body velocity in steady motion with its derivatives. It does not depend on what was asked before.
    pub fn body_velocity(&mut self, attitude: Attitude, motors: MotorSpeeds) -> Linearised {
        match self {
            Self::Icr(model) => model.body_velocity(attitude, motors),
            Self::Contact(model) => {
                model.forget_found();
                model.body_velocity(attitude, motors)
            }
        }
    }

    /// Returns one step of `step_s` with constant motor speeds in steady motion; see
    /// [`step_on_plane`](sidehill_plant::prediction::step_on_plane).
    pub fn step_on_plane(
        &mut self,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
        step_s: f64,
    ) -> LinearisedStep {
        match self {
            Self::Icr(model) => model.step_on_plane(normal_in_world, yaw_rad, motors, step_s),
            Self::Contact(model) => step_on_plane(normal_in_world, yaw_rad, step_s, |placed| {
                model.body_velocity(placed.tilt(), motors)
            }),
        }
    }

    /// Returns the same of a vehicle that moved as `moving`, which becomes that at the end of the step. Balances are
    /// searched near those of `start`, which become those that are found.
    ///
    /// The derivatives are those of steady motion: what an input changes comes late, but comes.
    pub(crate) fn step_near(
        &mut self,
        start: &mut StepStart,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
        step_s: f64,
        moving: &mut BodyState,
    ) -> LinearisedStep {
        let Self::Contact(model) = self else {
            return self.step_on_plane(normal_in_world, yaw_rad, motors, step_s);
        };
        let before = *moving;
        let mut halves = start.0.iter_mut().zip([0.5 * step_s, step_s]);
        step_on_plane(normal_in_world, yaw_rad, step_s, |placed| {
            let Some((place, time_s)) = halves.next() else {
                return model.body_velocity(placed.tilt(), motors);
            };
            let (mut found, lag) = model.body_velocity_near(&mut place.near, placed.tilt(), motors);
            place.following = lag.over(time_s);
            let followed = place.following.from(&before, &found.velocity.vector());
            *moving = followed.end;
            found.velocity = BodyVelocity::from_vector(&followed.mean);
            found
        })
    }

    /// Returns the increment of (x, y, yaw) of such a step alone.
    pub(super) fn increment_near(
        &self,
        start: &StepStart,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
        step_s: f64,
        moving: &mut BodyState,
    ) -> Vector3<f64> {
        match self {
            Self::Icr(model) => model.increment_on_plane(normal_in_world, yaw_rad, motors, step_s),
            Self::Contact(model) => {
                let before = *moving;
                let mut places = start.0.iter();
                increment_on_plane(normal_in_world, yaw_rad, step_s, |placed| {
                    let place = places.next();
                    let near = place.and_then(|place| place.near.as_ref());
                    let settled = model.velocity_near(near, placed.tilt(), motors);
                    let Some(place) = place else { return settled };
                    let followed = place.following.from(&before, &settled.vector());
                    *moving = followed.end;
                    BodyVelocity::from_vector(&followed.mean)
                })
            }
        }
    }
}

impl From<PredictionModel> for Model {
    fn from(model: PredictionModel) -> Self {
        Self::Icr(Box::new(model))
    }
}

impl From<ContactPrediction> for Model {
    fn from(model: ContactPrediction) -> Self {
        Self::Contact(Box::new(model))
    }
}
