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

mod evidence;
mod places;
mod settings;
mod trace;

pub use evidence::Evidence;
pub(crate) use places::CELLS;
pub use places::{Cell, Key};
pub use settings::MemoryConfig;
pub(crate) use trace::Step;

use crate::estimator::LearnedGains;
use crate::path::Point2;
use nalgebra::Vector3;
use places::PlaceMap;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::slip_gains::SlipGains;
use trace::{Excess, Trace};

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

pub(crate) fn knob(name: &str, default: f64) -> f64 {
    use std::collections::HashMap;
    use std::sync::OnceLock;
    static KNOBS: OnceLock<HashMap<String, f64>> = OnceLock::new();
    let knobs = KNOBS.get_or_init(|| std::env::vars().filter_map(|(k, v)| Some((k, v.parse().ok()?))).collect());
    knobs.get(name).copied().unwrap_or(default)
}

/// What is known of a place ahead.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// How far to the right of the path to aim, m.
    pub(crate) aim_right_m: f64,
    /// Motion per metre that model and learned gains do not have, (x, y, yaw) in the world.
    pub(crate) slip_per_m: Vector3<f64>,
}

/// The map and how it is filled; nothing is allocated after [`Memory::new`].
#[derive(Debug)]
pub(crate) struct Memory {
    pub(crate) config: MemoryConfig,
    map: PlaceMap,
    trace: Trace,
    /// Gains with which the model predicts.
    pub(crate) gains: SlipGains,
}

impl Memory {
    pub(crate) fn new(config: MemoryConfig) -> Self {
        Self {
            config,
            map: PlaceMap::new(config),
            trace: Trace::new(),
            gains: SlipGains::zeros(),
        }
    }

    /// Begins a new drive.
    pub(crate) fn reset(&mut self) {
        self.trace.clear();
    }

    /// Takes in a cycle of driving.
    pub(crate) fn step(&mut self, step: &Step) {
        self.trace.step(step);
    }

    /// Takes in a pose; returns the motion over the last second up to it by poses less by the model.
    pub(crate) fn pose(&mut self, time_s: f64, pose: PlanarPose) -> Option<Excess> {
        self.trace.pose(time_s, pose)
    }

    /// Takes in what was seen of a place of the path.
    pub(crate) fn learn_slip(&mut self, excess: &Excess, place: &PlanarPose, time_s: f64) {
        if let Some(evidence) = excess.evidence(place.yaw_rad, &self.gains) {
            self.map.learn(place, &evidence, time_s);
        }
    }

    /// Takes in where the vehicle was seen, nearest to `place` of its path, after `way_m`.
    pub(crate) fn learn_error(&mut self, time_s: f64, seen: &Point2, place: &PlanarPose, way_m: f64) {
        let known = self.map.known(place, time_s);
        if known.way_m <= 0.0 {
            return;
        }
        let (sin, cos) = place.yaw_rad.sin_cos();
        let right_m = cos * (seen.x_m - place.x_m) + sin * (seen.y_m - place.y_m);
        let evidence = Evidence {
            error_m2: known.share() * right_m * way_m,
            ..Evidence::default()
        };
        self.map.learn(place, &evidence, time_s);
    }

    /// Returns what is known of a place of the path.
    pub(crate) fn known(&self, place: &PlanarPose, time_s: f64) -> Known {
        let known = self.map.known(place, time_s);
        let slip = known.slip_per_m(&self.gains);
        let (sin, cos) = place.yaw_rad.sin_cos();
        Known {
            aim_right_m: known.aim_right_m(),
            slip_per_m: Vector3::new(
                cos * slip.x - sin * slip.y,
                sin * slip.x + cos * slip.y,
                slip.z,
            ),
        }
    }

    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.map.cells()
    }

    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        self.map.recall(cells);
    }
}
