//! What an MPC predicts with.

use nalgebra::Vector3;
use sidehill_plant::contact::ContactPrediction;
use sidehill_plant::prediction::{LinearisedStep, PredictionModel, step_on_plane};
use sidehill_plant::speeds::MotorSpeeds;

/// A model of the motion on a plane.
#[derive(Debug, Clone, PartialEq)]
pub enum Model {
    /// ICRIK with a learned correction, or one of the models that are special cases of it.
    Icr(Box<PredictionModel>),
    /// The balance of wheel friction.
    Contact(Box<ContactPrediction>),
}

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
            Self::Contact(model) => step_on_plane(normal_in_world, yaw_rad, step_s, |attitude| {
                model.body_velocity(attitude, motors)
            }),
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
