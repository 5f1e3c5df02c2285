//! Limits of the steepness guard as a configuration file gives them.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// When the guard slows the vehicle down, stops it before a place, and stops it at once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GuardConfig {
    /// Roll to either side beyond which the vehicle is stopped at once, degrees.
    pub roll_max_deg: f64,
    /// Pitch up or down beyond which the vehicle is stopped at once, degrees.
    pub pitch_max_deg: f64,
    /// Tip-over margin below which a place is not driven over; 1 stands level, 0 tips over.
    pub rollover_margin_min: f64,
    /// Tip-over margin below which the vehicle drives slower.
    pub rollover_margin_slow: f64,
    /// Use of friction above which a place is not driven over.
    pub friction_use_max: f64,
    /// Use of friction above which the vehicle drives slower.
    pub friction_use_slow: f64,
    /// Coefficient of friction of tyres and ground where none has been learned.
    pub friction: f64,
    /// Share of the speed that a steep place leaves at least, as long as it may be driven over.
    pub speed_share_min: f64,
    /// Distance before a place that may not be driven over at which the vehicle stops, m.
    pub stop_before_m: f64,
    /// Time along the reference over which the guard looks ahead, s.
    pub look_ahead_s: f64,
    /// Heading, to either side of the planned one, within which margins are judged, degrees.
    pub heading_spread_deg: f64,
    /// Whether a route known to cross a limit is refused before it is driven; else it is driven up to that
    /// place.
    pub refuse_route: bool,
}

impl Default for GuardConfig {
    fn default() -> Self {
        Self {
            roll_max_deg: 35.0,
            pitch_max_deg: 35.0,
            rollover_margin_min: 0.25,
            rollover_margin_slow: 0.4,
            friction_use_max: 0.8,
            friction_use_slow: 0.65,
            friction: 0.7,
            speed_share_min: 0.4,
            stop_before_m: 0.5,
            look_ahead_s: 9.0,
            heading_spread_deg: 10.0,
            refuse_route: true,
        }
    }
}

impl GuardConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let tilt = Bounds::new(1.0, 80.0, "deg");
        tilt.check("guard.roll_max_deg", self.roll_max_deg)?;
        tilt.check("guard.pitch_max_deg", self.pitch_max_deg)?;
        Bounds::new(0.0, 1.0, "").check("guard.rollover_margin_min", self.rollover_margin_min)?;
        Bounds::new(self.rollover_margin_min, 1.0, "")
            .with_note("at least rollover_margin_min")
            .check("guard.rollover_margin_slow", self.rollover_margin_slow)?;
        Bounds::new(0.05, 10.0, "").check("guard.friction_use_max", self.friction_use_max)?;
        Bounds::new(0.0, self.friction_use_max, "")
            .with_note("at most friction_use_max")
            .check("guard.friction_use_slow", self.friction_use_slow)?;
        Bounds::new(0.05, 2.0, "").check("guard.friction", self.friction)?;
        Bounds::new(0.05, 1.0, "").check("guard.speed_share_min", self.speed_share_min)?;
        Bounds::new(0.0, 20.0, "m").check("guard.stop_before_m", self.stop_before_m)?;
        Bounds::new(2.0, 60.0, "s").check("guard.look_ahead_s", self.look_ahead_s)?;
        Bounds::new(0.0, 90.0, "deg").check("guard.heading_spread_deg", self.heading_spread_deg)?;
        Ok(())
    }
}
