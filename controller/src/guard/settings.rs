//! Limits of the steepness guard as a configuration file gives them.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// When the guard slows the vehicle down, stops it before a place, and stops it at once.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct GuardConfig {
    /// Roll to either side beyond which the vehicle is stopped at once.
    pub roll_max_deg: f64,
    /// Pitch up or down beyond which the vehicle is stopped at once.
    pub pitch_max_deg: f64,
    /// Tip-over margin below which a place is not driven over. 1 stands level, 0 tips over.
    pub rollover_margin_min: f64,
    /// Use of friction above which a place is not driven over.
    #[serde(skip)]
    pub friction_use_max: f64,
    /// Use of friction above which the vehicle drives slower.
    #[serde(skip)]
    pub friction_use_slow: f64,
    /// Coefficient of friction of tyres and ground where none has been learned: the least to be expected.
    pub friction: f64,
    /// Share of the speed that a steep place leaves at least, as long as it may be driven over.
    #[serde(skip)]
    pub speed_share_min: f64,
    /// Distance before a place that may not be driven over at which the vehicle stops, m.
    #[serde(skip)]
    pub stop_before_m: f64,
    /// Time along the reference over which the guard looks ahead, s.
    #[serde(skip)]
    pub look_ahead_s: f64,
    /// Heading, to either side of the planned one, within which margins are judged, degrees.
    #[serde(skip)]
    pub heading_spread_deg: f64,
    /// Whether a route over known ground that crosses a limit is refused before it is driven. With `false` it is driven
    /// up to that place.
    pub refuse_route: bool,
}

/// How much more than the least tip-over margin there is where the vehicle begins to drive slower.
const SLOWER: f64 = 0.15;

impl Default for GuardConfig {
    fn default() -> Self {
        Self {
            roll_max_deg: 35.0,
            pitch_max_deg: 35.0,
            rollover_margin_min: 0.25,
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
        Bounds::new(0.05, 2.0, "").check("guard.friction", self.friction)?;
        Ok(())
    }

    /// Returns the tip-over margin below which the vehicle drives slower.
    pub fn rollover_margin_slow(&self) -> f64 {
        (self.rollover_margin_min + SLOWER).min(1.0)
    }
}
