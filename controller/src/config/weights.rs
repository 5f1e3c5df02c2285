use crate::mpc::ChangeWeights;
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// Weights of the MPC's errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Speed along the path less the speed allowed there, over that: a vehicle that stands has an error of 1. There is
    /// no weight of a position along the path but at the end of a drive.
    pub speed: f64,
    /// Position error across the path.
    pub cross_per_m2: f64,
    /// Heading error while driving. Keep it small: on a slope the heading that keeps the path is not its tangent.
    pub heading_per_rad2: f64,
    /// Change of traction, divided by the duration of a stage.
    pub traction_change_s3_per_m2: f64,
    /// Change of steer, divided by the duration of a stage, where positions have noise of 1 cm and more. The controller
    /// lowers it with the variance of the noise that it finds, to a sixteenth.
    pub steer_change_s3_per_m2: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            speed: 0.05,
            cross_per_m2: 50.0,
            heading_per_rad2: 0.02,
            traction_change_s3_per_m2: 0.05,
            steer_change_s3_per_m2: 0.8,
        }
    }
}

impl Weights {
    /// Returns the weights of changes of the inputs.
    pub fn changes(&self) -> ChangeWeights {
        ChangeWeights {
            traction: self.traction_change_s3_per_m2,
            steer: self.steer_change_s3_per_m2,
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub(super) fn validate(&self) -> Result<(), RangeError> {
        for (key, value) in [
            ("weights.speed", self.speed),
            ("weights.cross_per_m2", self.cross_per_m2),
            ("weights.heading_per_rad2", self.heading_per_rad2),
        ] {
            Bounds::new(0.0, 1e6, "").check(key, value)?;
        }
        // Without a price on changes the QP would not be strictly convex.
        for (key, value) in [
            (
                "weights.traction_change_s3_per_m2",
                self.traction_change_s3_per_m2,
            ),
            (
                "weights.steer_change_s3_per_m2",
                self.steer_change_s3_per_m2,
            ),
        ] {
            Bounds::new(1e-6, 1e6, "").check(key, value)?;
        }
        Ok(())
    }
}
