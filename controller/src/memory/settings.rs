//! Settings of what is kept of what was learned.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// What the controller keeps: gains over a disarming, where to aim by place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MemoryConfig {
    /// Whether learned gains survive a disarming.
    pub keep_gains: bool,
    /// Whether slip and error are learned by place, and reckoned with where a place is driven over again.
    pub by_place: bool,
    /// Edge of a cell of the map, m.
    pub cell_m: f64,
    /// Share of a visit's error by which the aim of the next visit is moved against it.
    pub error_share: f64,
    /// Share of the aim that the next visit begins with; the rest is forgotten.
    pub kept_share: f64,
    /// Largest offset from the path that is aimed at, m.
    pub aim_max_m: f64,
}

impl Default for MemoryConfig {
    fn default() -> Self {
        Self {
            keep_gains: true,
            by_place: true,
            cell_m: 0.2,
            error_share: 0.8,
            kept_share: 0.95,
            aim_max_m: 0.1,
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
        Bounds::new(0.0, 1.0, "").check("memory.error_share", self.error_share)?;
        Bounds::new(0.0, 1.0, "").check("memory.kept_share", self.kept_share)?;
        Bounds::new(0.0, 1.0, "m").check("memory.aim_max_m", self.aim_max_m)?;
        Ok(())
    }
}
