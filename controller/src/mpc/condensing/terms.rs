//! A stage's terms in the QP without condensing.

use super::Stage;
use crate::mpc::stage_terms::{MOTORS, StageTerms};

impl Stage {
    /// Returns the terms of the stage, whose planned inputs differ by `change` from those before, with all
    /// costs multiplied by `scale`.
    pub(in crate::mpc) fn terms(&self, change: [f64; MOTORS], scale: f64) -> StageTerms {
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
            damping: scale * self.damping,
            speed_row: self.speed_row,
            speed_weight: scale * weights.speed_s2_per_m2,
            speed_error: self.speed_error,
            ..StageTerms::default()
        };
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
