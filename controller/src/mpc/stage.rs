//! The stages of a horizon, linearised about a plan.

use super::limits::Change;
use super::settings::ChangeWeights;
use super::stage_qp::{MOTORS, STATES, StageTerms, VARIABLES};
use nalgebra::Vector3;
use sidehill_plant::prediction::LinearisedStep;
use sidehill_plant::speeds::MotorSpeeds;

/// What one stage contributes: its linearised dynamics and the cost at its end.
#[derive(Debug, Clone, Copy)]
pub struct Stage {
    /// Increment and sensitivities of the stage's step about the plan.
    pub step: LinearisedStep,
    /// Plan's next tracked point less the reference, x and y in m, and heading less the one asked for there, rad.
    pub error: Vector3<f64>,
    /// Derivative of the tracked point's (x, y) by the heading, m/rad; zero of the origin.
    pub point_by_yaw_m: (f64, f64),
    /// Unit vector along the reference, (x, y).
    pub along: (f64, f64),
    /// How the asked heading turns along the reference, rad/m.
    pub curvature_per_m: f64,
    /// Weights at the end of this stage.
    pub weights: StageWeights,
    /// Derivatives of the speed along the reference by the yaw before, traction and steer, in m/s per rad and 1.
    pub speed_row: [f64; 3],
    /// Planned speed along the reference less that of the target, m/s.
    pub speed_error: f64,
    /// Planned input of the stage.
    pub input: MotorSpeeds,
    /// Weights r of a change of traction and steer from the stage before, 1/(m/s)^2.
    pub change_weights: ChangeWeights,
    /// Weight d of the correction of each planned input, 1/(m/s)^2.
    pub damping: f64,
    /// How far traction may change from the stage before.
    pub traction_change: Change,
    /// How far steer may change from the stage before.
    pub steer_change: Change,
}

impl Stage {
    /// Returns the weights of its cost.
    pub fn weights(&self) -> CostWeights {
        CostWeights {
            errors: self.weights,
            changes: self.change_weights,
        }
    }
}

/// The weights of a stage's cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CostWeights {
    /// Of its errors.
    pub errors: StageWeights,
    /// Of the changes of its inputs, 1/(m/s)^2.
    pub changes: ChangeWeights,
}

/// Weights of the errors at the end of a stage.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StageWeights {
    /// Of the position error along the reference, 1/m^2.
    pub along_per_m2: f64,
    /// Of the position error across it, 1/m^2.
    pub cross_per_m2: f64,
    /// Of the heading error, 1/rad^2.
    pub heading_per_rad2: f64,
    /// Of the speed along the reference, 1/(m/s)^2.
    pub speed_s2_per_m2: f64,
}

impl StageWeights {
    /// Returns all weights times `factor`.
    pub(crate) fn scaled(self, factor: f64) -> Self {
        Self {
            along_per_m2: factor * self.along_per_m2,
            cross_per_m2: factor * self.cross_per_m2,
            heading_per_rad2: factor * self.heading_per_rad2,
            speed_s2_per_m2: factor * self.speed_s2_per_m2,
        }
    }
}

impl Stage {
    /// Returns the terms of the stage, whose planned inputs differ by `change` from those before, with all
    /// costs multiplied by `scale`.
    pub fn terms(&self, change: [f64; MOTORS], scale: f64) -> StageTerms {
        let (x, y) = self.along;
        let (point_x, point_y) = self.point_by_yaw_m;
        let error = &self.error;
        let weights = &self.weights;
        let along = [x, y, x * point_x + y * point_y];
        let turn = along.map(|by| -self.curvature_per_m * by);
        let lines = [
            (weights.along_per_m2, along, x * error.x + y * error.y),
            (
                weights.cross_per_m2,
                [-y, x, x * point_y - y * point_x],
                x * error.y - y * error.x,
            ),
            (
                weights.heading_per_rad2,
                [turn[0], turn[1], 1.0 + turn[2]],
                error.z,
            ),
        ];
        let step = &self.step;
        let mut terms = StageTerms {
            by_yaw: step.by_yaw.into(),
            by_input: [step.by_traction.into(), step.by_steer.into()],
            change_weight: [
                scale * self.change_weights.traction,
                scale * self.change_weights.steer,
            ],
            change,
            speed_row: self.speed_row,
            speed_weight: scale * weights.speed_s2_per_m2,
            speed_error: self.speed_error,
            ..StageTerms::default()
        };
        for input in STATES..VARIABLES {
            terms.weight[input][input] = scale * self.damping;
        }
        for (weight, line, error) in lines {
            for i in 0..3 {
                let scaled = scale * weight * line[i];
                terms.force[i] += scaled * error;
                for (entry, other) in terms.weight[i].iter_mut().zip(&line) {
                    *entry += scaled * other;
                }
            }
        }
        terms
    }
}
