//! Settings of what is kept of what was learned.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// What the controller keeps: gains over a disarming, residual slip by place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MemoryConfig {
    /// Whether learned gains survive a disarming.
    pub keep_gains: bool,
    /// Whether residual slip is learned by place and predicted with where a place is driven over again.
    pub by_place: bool,
    /// Edge of a cell of the map, m.
    pub cell_m: f64,
    /// Time over which the residual is measured, s.
    pub window_s: f64,
    /// Share of a new visit in what a cell holds; the rest is of the visits before, which are so forgotten.
    pub new_share: f64,
    /// Largest residual slide that is kept, m/s.
    pub slide_max_m_s: f64,
    /// Largest residual yaw rate that is kept, rad/s.
    pub yaw_rate_max_rad_s: f64,
    /// Share of the residual that is predicted with.
    pub used_share: f64,
}

impl Default for MemoryConfig {
    fn default() -> Self {
        Self {
            keep_gains: true,
            by_place: true,
            cell_m: 0.3,
            window_s: 1.0,
            new_share: 0.5,
            slide_max_m_s: 0.1,
            yaw_rate_max_rad_s: 0.15,
            used_share: 1.0,
        }
    }
}

impl MemoryConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.05, 5.0, "m").check("memory.cell_m", self.cell_m)?;
        Bounds::new(0.2, 5.0, "s").check("memory.window_s", self.window_s)?;
        Bounds::new(0.05, 1.0, "").check("memory.new_share", self.new_share)?;
        Bounds::new(0.0, 2.0, "m/s").check("memory.slide_max_m_s", self.slide_max_m_s)?;
        Bounds::new(0.0, 2.0, "rad/s")
            .check("memory.yaw_rate_max_rad_s", self.yaw_rate_max_rad_s)?;
        Bounds::new(0.0, 1.0, "").check("memory.used_share", self.used_share)?;
        Ok(())
    }
}
