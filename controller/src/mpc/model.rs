//! The prediction models of the MPC.

use nalgebra::Vector3;
use sidehill_plant::contact::{ContactPrediction, FoundBalance};
use sidehill_plant::prediction::{
    LinearisedStep, PredictionModel, increment_on_plane, step_on_plane,
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

/// What was found for a step in the cycle before: the balances at its start and its middle.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct StepStart([Option<FoundBalance>; 2]);

impl Model {
    /// Returns one step of `step_s` with constant motor speeds; see
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

    /// Returns the same of a step whose balances are searched near those of `start`, which become those
    /// that are found.
    pub(super) fn step_near(
        &mut self,
        start: &mut StepStart,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
        step_s: f64,
    ) -> LinearisedStep {
        let Self::Contact(model) = self else {
            return self.step_on_plane(normal_in_world, yaw_rad, motors, step_s);
        };
        let mut place = 0;
        step_on_plane(normal_in_world, yaw_rad, step_s, |placed| {
            let near = &mut start.0[place];
            place = 1;
            model.body_velocity_near(near, placed.tilt(), motors)
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
    ) -> Vector3<f64> {
        match self {
            Self::Icr(model) => model.increment_on_plane(normal_in_world, yaw_rad, motors, step_s),
            Self::Contact(model) => {
                let mut place = 0;
                increment_on_plane(normal_in_world, yaw_rad, step_s, |placed| {
                    let near = start.0[place].as_ref();
                    place = 1;
                    model.velocity_near(near, placed.tilt(), motors)
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
