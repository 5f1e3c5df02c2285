use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// Weights of the MPC's errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Speed along the path less what is allowed there, over that: a vehicle that stands has an error of 1.
    pub speed: f64,
    /// Position error across the path, 1/m^2.
    pub cross_per_m2: f64,
    /// Time from the begin of the horizon over which the weight across the path grows in proportion to its full value,
    /// s; 0 weighs all errors alike. Motors change their speeds too slowly to correct what is nearer.
    pub cross_ramp_s: f64,
    /// Heading error while driving, 1/rad^2. Small: the heading that keeps the path is not its
    /// tangent.
    pub heading_per_rad2: f64,
    /// Added to the heading's weight where the plan's heading is off the tangent by twice
    /// `heading_free_rad`, in proportion to the square of what is beyond it, 1/rad^2. No slide needs
    /// such headings: a wrong model causes them.
    pub heading_excess_per_rad2: f64,
    /// Heading error that a slide may need, rad.
    pub heading_free_rad: f64,
    /// Position error while turning on the spot, 1/m^2.
    pub pivot_position_per_m2: f64,
    /// Heading error while turning on the spot or standing at the end, 1/rad^2.
    pub pivot_heading_per_rad2: f64,
    /// Change of traction, s/(m/s)^2: divided by the duration of a stage.
    pub traction_change_s3_per_m2: f64,
    /// Change of steer, s/(m/s)^2.
    pub steer_change_s3_per_m2: f64,
    /// Factor on the errors at the end of the horizon.
    pub terminal_factor: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            speed: 0.15,
            cross_per_m2: 50.0,
            cross_ramp_s: 0.0,
            heading_per_rad2: 0.02,
            heading_excess_per_rad2: 10.0,
            heading_free_rad: 0.5,
            pivot_position_per_m2: 5.0,
            pivot_heading_per_rad2: 5.0,
            traction_change_s3_per_m2: 0.05,
            steer_change_s3_per_m2: 0.05,
            terminal_factor: 1.0,
        }
    }
}

/// How the MPC becomes more cautious where its model has shown errors: the weights of a change of steer and
/// of the heading rise from their own values to these with the square of the model's error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CautionConfig {
    /// Error of the predicted velocity at which caution is full, m/s; poses show it.
    pub error_m_s: f64,
    /// Weight of a change of steer at full caution, s/(m/s)^2.
    pub steer_change_s3_per_m2: f64,
    /// Weight of the heading error at full caution, 1/rad^2.
    pub heading_per_rad2: f64,
}

impl Default for CautionConfig {
    fn default() -> Self {
        Self {
            error_m_s: 0.01,
            steer_change_s3_per_m2: 0.2,
            heading_per_rad2: 0.4,
        }
    }
}

impl Weights {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub(super) fn validate(&self) -> Result<(), RangeError> {
        for (key, value) in [
            ("weights.speed", self.speed),
            ("weights.cross_per_m2", self.cross_per_m2),
            ("weights.heading_per_rad2", self.heading_per_rad2),
            (
                "weights.heading_excess_per_rad2",
                self.heading_excess_per_rad2,
            ),
            ("weights.pivot_position_per_m2", self.pivot_position_per_m2),
            (
                "weights.pivot_heading_per_rad2",
                self.pivot_heading_per_rad2,
            ),
            ("weights.terminal_factor", self.terminal_factor),
        ] {
            Bounds::new(0.0, 1e6, "").check(key, value)?;
        }
        Bounds::new(0.0, 10.0, "s").check("weights.cross_ramp_s", self.cross_ramp_s)?;
        Bounds::new(0.01, 3.2, "rad").check("weights.heading_free_rad", self.heading_free_rad)?;
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

impl CautionConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub(super) fn validate(&self) -> Result<(), RangeError> {
        for (key, value) in [
            ("caution.error_m_s", self.error_m_s),
            (
                "caution.steer_change_s3_per_m2",
                self.steer_change_s3_per_m2,
            ),
            ("caution.heading_per_rad2", self.heading_per_rad2),
        ] {
            Bounds::new(1e-6, 1e6, "").check(key, value)?;
        }
        Ok(())
    }
}
