use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// Settings of contact-mpc where they differ from those of the other MPCs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContactMpcConfig {
    /// Duration of the horizon's last stage, s.
    pub last_step_s: f64,
    /// Time over which the weight across the path grows to its full value, s, in place of that of the weights.
    pub cross_ramp_s: f64,
    /// Factor on the weight of a change of steer on the path, where poses' noise is most of what steer would answer.
    pub steer_change_on_path: f64,
    /// The same far beside the path.
    pub steer_change_off_path: f64,
    /// Distance from the path at which these factors are half way to those far beside it, m.
    pub off_path_m: f64,
}

impl Default for ContactMpcConfig {
    fn default() -> Self {
        Self {
            last_step_s: 0.22,
            cross_ramp_s: 0.6,
            steer_change_on_path: 1.5,
            steer_change_off_path: 0.25,
            off_path_m: 0.05,
        }
    }
}

impl ContactMpcConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub(super) fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.005, 10.0, "s").check("contact.last_step_s", self.last_step_s)?;
        Bounds::new(0.0, 10.0, "s").check("contact.cross_ramp_s", self.cross_ramp_s)?;
        for (key, factor) in [
            ("contact.steer_change_on_path", self.steer_change_on_path),
            ("contact.steer_change_off_path", self.steer_change_off_path),
        ] {
            Bounds::new(0.01, 100.0, "").check(key, factor)?;
        }
        Bounds::new(0.001, 10.0, "m").check("contact.off_path_m", self.off_path_m)?;
        Ok(())
    }

    /// Returns the factor on the weight of a change of steer at a distance from the path.
    pub(crate) fn steer_change(&self, cross_track_m: f64) -> f64 {
        let squared = (cross_track_m / self.off_path_m).powi(2);
        let off_path = squared / (1.0 + squared);
        self.steer_change_on_path
            + off_path * (self.steer_change_off_path - self.steer_change_on_path)
    }
}
