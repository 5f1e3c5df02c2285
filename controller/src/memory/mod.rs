//! What was learned is kept: gains over a disarming and, in the hands of the caller, over a restart; and
//! where to aim, by place, on a route that is driven again.
//!
//! What slides the same way each time is seen in the poses: over the last second they show a motion that the
//! model, driven by the same tread speeds, does not have. Per metre of way, and seen from the path's heading,
//!
//! ```text
//! slip(s) = (moved by poses - moved by the model without learned gains) / way,   terms(s) = integral of T dt / way
//! ```
//!
//! with T the terms of the learned gains G ([`sidehill_plant::slip_gains`]). On the next visit the prediction
//! at s has (slip(s) - G terms(s)) v more: what the gains of that moment lack there, whatever they were when
//! the place was seen. So the MPC steers before the slide begins. The fixed part of a prediction's error learned
//! along a path driven again follows C. J. Ostafew, A. P. Schoellig, T. D. Barfoot and J. Collier,
//! "Learning-based nonlinear model predictive control to improve vision-based mobile robot path tracking",
//! Journal of Field Robotics 33(1), 2016; here it is indexed by place instead of path, so that a route that
//! joins another one uses what was learned on it.
//!
//! What remains, e(s), m to the right of the path, moves the path that the horizon aims at by u(s):
//!
//! ```text
//! u_(j+1) = kept_share u_j - error_share w e_j,   |u| <= aim_max_m
//! ```
//!
//! with w the share to which the slip was known, and 1 far beside the path. This is iterative learning control
//! of the reference (D. A. Bristow, M. Tharayil and A. G. Alleyne, "A survey of iterative learning control",
//! IEEE Control Systems Magazine 26(3), 2006: serial architecture, with a forgetting factor).

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
use nalgebra::{Rotation3, Vector3};
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
    /// What was seen, by place.
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

/// What is known of a place ahead.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Known {
    /// How far to the right of the path to aim, m.
    pub(crate) aim_right_m: f64,
    /// Motion per metre that model and learned gains do not have, (x, y, yaw) in the world.
    pub(crate) slip_per_m: Vector3<f64>,
}

/// Distances from the path, m, up to which the motion tells of the slip on it, and from which on it tells
/// nothing: a vehicle that slid off steers unlike one that did not. There the error itself is aimed against.
const NEAR_M: (f64, f64) = (0.05, 0.12);

fn nearness(right_m: f64) -> f64 {
    let (near_m, far_m) = NEAR_M;
    ((far_m - right_m.abs()) / (far_m - near_m)).clamp(0.0, 1.0)
}

/// The map and how it is filled; nothing is allocated after [`Memory::new`].
#[derive(Debug, Clone)]
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

    /// Takes in what was seen of a place of the path, `right_m` to the right of it.
    pub(crate) fn learn_slip(
        &mut self,
        excess: &Excess,
        place: &PlanarPose,
        right_m: f64,
        time_s: f64,
    ) {
        if let Some(found) = excess.evidence(place.yaw_rad, &self.gains) {
            let mut evidence = Evidence::default();
            evidence.add(nearness(right_m), &found);
            self.map.learn(place, &evidence, time_s);
        }
    }

    /// Takes in that the vehicle was seen `right_m` to the right of `place` of its path, over `way_m`.
    pub(crate) fn learn_error(
        &mut self,
        time_s: f64,
        place: &PlanarPose,
        right_m: f64,
        way_m: f64,
    ) {
        let known = self.map.known(place, time_s);
        let near = nearness(right_m);
        let weight = near * known.share() + (1.0 - near);
        let evidence = Evidence {
            error_way_m: way_m,
            error_m2: weight * right_m * way_m,
            ..Evidence::default()
        };
        self.map.learn(place, &evidence, time_s);
    }

    /// Returns what is known of a place of the path.
    pub(crate) fn known(&self, place: &PlanarPose, time_s: f64) -> Known {
        let known = self.map.known(place, time_s);
        let slip = known.slip_per_m(&self.gains);
        Known {
            aim_right_m: known.aim_right_m(),
            slip_per_m: Rotation3::from_axis_angle(&Vector3::z_axis(), place.yaw_rad) * slip,
        }
    }

    pub(crate) fn cells(&self) -> impl Iterator<Item = Cell> + '_ {
        self.map.cells()
    }

    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        self.map.recall(cells);
    }
}
