//! What was learned is kept: gains over a disarming and, in the hands of the caller, over a restart; and
//! where to aim, by place, on a route that is driven again.
//!
//! What slides the same way each time leaves the same error from the path at the same place. Poses show it,
//! e(s), m to the right of the path at arc length s, and on visit j the horizon aims at a path moved by u_j(s):
//!
//! ```text
//! u_(j+1) = Q (kept_share u_j) - error_share e_j,   |u| <= aim_max_m
//! ```
//!
//! with Q a mean over neighbouring places. The MPC sees the moved path over its whole horizon, so it steers
//! before the slide begins. This is iterative learning control of the reference (D. A. Bristow, M. Tharayil
//! and A. G. Alleyne, "A survey of iterative learning control", IEEE Control Systems Magazine 26(3), 2006:
//! serial architecture, with a forgetting factor), indexed by place instead of time, so that a route that
//! joins another one uses what was learned on it.

mod places;
mod settings;

pub use places::{Cell, Key};
pub use settings::MemoryConfig;

use crate::estimator::LearnedGains;
use crate::path::Point2;
use places::PlaceMap;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;

/// Everything that was learned, to be kept.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Learned {
    /// Name and number of the vehicle and controller that it belongs to.
    pub owner: String,
    /// Gains or parameters, where any were learned.
    pub gains: Option<LearnedGains>,
    /// Edge of a cell of the map, m.
    pub cell_m: f64,
    /// Where to aim, by place.
    pub cells: Vec<Cell>,
}

impl Learned {
    /// Returns by how much the uncertainty of the gains has shrunk, 0 to 1.
    pub fn confidence(&self) -> f64 {
        self.gains.as_ref().map_or(0.0, LearnedGains::confidence)
    }
}

/// Why something learned is not taken over.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum RecallError {
    /// It was learned by another vehicle or controller.
    #[error("it was learned by {found}, this is {expected}")]
    Foreign {
        /// Who learned it.
        found: String,
        /// Who is to take it over.
        expected: String,
    },
    /// Nothing is kept here.
    #[error("memory is off in the controller's settings")]
    Off,
    /// Its numbers make no sense.
    #[error("its {0}")]
    Wrong(&'static str),
}

/// Time after a start in which nothing is learned by place: the vehicle converges to its path and the gains to
/// their values, which is not a property of the place, s.
const SETTLING_S: f64 = 10.0;

/// The map and how it is filled; nothing is allocated after [`Memory::new`].
#[derive(Debug)]
pub(crate) struct Memory {
    pub(crate) config: MemoryConfig,
    map: PlaceMap,
    /// When the drive began.
    since_s: Option<f64>,
}

impl Memory {
    pub(crate) fn new(config: MemoryConfig) -> Self {
        Self {
            config,
            map: PlaceMap::new(config),
            since_s: None,
        }
    }

    /// Begins a new drive.
    pub(crate) fn reset(&mut self) {
        self.since_s = None;
    }

    /// Takes in where the vehicle was seen at `time_s`, nearest to `place` of its path.
    pub(crate) fn observe(&mut self, time_s: f64, seen: &Point2, place: &PlanarPose) {
        let since_s = *self.since_s.get_or_insert(time_s);
        if self.config.by_place && time_s - since_s >= SETTLING_S {
            let (sin, cos) = place.yaw_rad.sin_cos();
            let right_m = cos * (seen.x_m - place.x_m) + sin * (seen.y_m - place.y_m);
            self.map.learn(place, right_m, time_s);
        }
    }

    /// Returns a target moved aside by what is known of `place` of the path.
    pub(crate) fn aim(&self, target: &PlanarPose, place: &PlanarPose, time_s: f64) -> PlanarPose {
        if !self.config.by_place {
            return *target;
        }
        let right_m = self.map.aim_right_m(place, time_s);
        let (sin, cos) = target.yaw_rad.sin_cos();
        PlanarPose {
            x_m: target.x_m + cos * right_m,
            y_m: target.y_m + sin * right_m,
            ..*target
        }
    }

    pub(crate) fn cells(&self) -> Vec<Cell> {
        self.map.cells()
    }

    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        self.map.recall(cells);
    }
}
