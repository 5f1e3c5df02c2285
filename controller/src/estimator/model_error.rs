//! How far poses are from what the model predicts.

use super::Innovation;

/// Mean square of the error of the predicted velocity, as poses show it.
#[derive(Debug, Clone, Copy)]
pub(super) struct ModelError {
    pose_time_s: f64,
    mean_square_m2_s2: f64,
}

impl Default for ModelError {
    fn default() -> Self {
        Self {
            pose_time_s: f64::NEG_INFINITY,
            mean_square_m2_s2: 0.0,
        }
    }
}

impl ModelError {
    pub(super) fn root_mean_square_m_s(&self) -> f64 {
        self.mean_square_m2_s2.sqrt()
    }

    /// Adds an innovation; `noise_m2` is the part of its square that is noise of the pose, not an error
    /// of the model.
    pub(super) fn absorb(&mut self, innovation: &Innovation, noise_m2: f64, averaging_s: f64) {
        let time_s = innovation.time_s - self.pose_time_s;
        self.pose_time_s = innovation.time_s;
        if time_s > 0.0 && time_s <= averaging_s {
            let square = innovation.difference.xy().norm_squared() - noise_m2;
            let share = time_s / averaging_s;
            let found = (square / (time_s * time_s)).max(0.0);
            self.mean_square_m2_s2 += share * (found - self.mean_square_m2_s2);
        }
    }
}
