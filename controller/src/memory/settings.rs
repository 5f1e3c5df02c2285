//! Settings of what is kept of what was learned.

use serde::{Deserialize, Serialize};

/// What the controller keeps: gains over a disarming, where to aim by place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct MemoryConfig {
    /// Whether learned gains survive a disarming.
    #[serde(skip)]
    pub keep_gains: bool,
    /// Whether slip and error are learned by place, and reckoned with where a place is driven over again.
    #[serde(skip)]
    pub by_place: bool,
    /// Edge of a cell of the map, m.
    #[serde(skip)]
    pub cell_m: f64,
    /// Share of a visit's error by which the aim of the next visit is moved against it.
    #[serde(skip)]
    pub error_share: f64,
    /// Share of the aim that the next visit begins with; the rest is forgotten.
    #[serde(skip)]
    pub kept_share: f64,
    /// Largest offset from the path that is aimed at, m.
    #[serde(skip)]
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
