//! What was learned is kept: gains over a disarming and, in the hands of the caller, over a restart; residual
//! slip by place, for a route that is driven again.
//!
//! The residual is what the poses show and the model, with its learned gains and treads as measured, does not:
//! over a window of about a second
//!
//! ```text
//! r = ((p(t) - p(t - T)) - integral of the model's velocity) / T
//! ```
//!
//! in the axes of the vehicle in the middle of the window, where it is put into a map of cells. The
//! horizon's prediction adds what the map holds at the places ahead, so that a slide is met before it
//! begins. Learning from one pass to the next follows C. J. Ostafew, A. P. Schoellig and T. D. Barfoot,
//! "Robust constrained learning-based NMPC enabling reliable mobile robot path tracking", IJRR 2016, with a
//! map of means in place of a Gaussian process.

mod places;
mod settings;

pub use places::{Cell, Key};
pub use settings::MemoryConfig;

use crate::estimator::LearnedGains;
use nalgebra::Vector3;
use places::PlaceMap;
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use std::collections::VecDeque;

/// Least share of the window that has to be covered.
const COVERED: f64 = 0.9;
/// Least way within the window, m: who stands learns nothing.
const WAY_MIN_M: f64 = 0.1;

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
    /// Residual slip by place.
    pub cells: Vec<Cell>,
}

impl Learned {
    /// Returns how much of the uncertainty of the gains has gone, 0 to 1.
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

/// A cycle within the window.
#[derive(Debug, Clone, Copy)]
struct Moment {
    time_s: f64,
    pose: PlanarPose,
    /// Sum of the model's increments since the window began to be filled.
    modelled: Vector3<f64>,
}

/// The map and the window by which it is filled; nothing is allocated after [`Memory::new`].
#[derive(Debug)]
pub(crate) struct Memory {
    pub(crate) config: MemoryConfig,
    map: PlaceMap,
    window: VecDeque<Moment>,
}

impl Memory {
    pub(crate) fn new(config: MemoryConfig, period_s: f64) -> Self {
        let cycles = (2.0 * config.window_s / period_s).ceil() as usize + 2;
        Self {
            config,
            map: PlaceMap::new(config),
            window: VecDeque::with_capacity(cycles),
        }
    }

    /// Begins a new window, as after a stop.
    pub(crate) fn reset(&mut self) {
        self.window.clear();
    }

    /// Takes in the pose of a cycle and the increment (x, y, yaw) that the model has for the time since the
    /// cycle before.
    pub(crate) fn observe(&mut self, time_s: f64, pose: &PlanarPose, increment: &Vector3<f64>) {
        if !self.config.by_place {
            return;
        }
        let modelled = self
            .window
            .back()
            .map_or_else(Vector3::zeros, |moment| moment.modelled + increment);
        if self.window.len() == self.window.capacity() {
            self.window.pop_front();
        }
        self.window.push_back(Moment {
            time_s,
            pose: *pose,
            modelled,
        });
        while self
            .window
            .get(1)
            .is_some_and(|second| time_s - second.time_s >= self.config.window_s)
        {
            self.window.pop_front();
        }
        let (Some(first), Some(last)) = (self.window.front(), self.window.back()) else {
            return;
        };
        let span_s = last.time_s - first.time_s;
        if span_s < COVERED * self.config.window_s {
            return;
        }
        let moved = Vector3::new(
            last.pose.x_m - first.pose.x_m,
            last.pose.y_m - first.pose.y_m,
            wrap_angle(last.pose.yaw_rad - first.pose.yaw_rad),
        );
        if moved.xy().norm() < WAY_MIN_M {
            return;
        }
        let residual = (moved - (last.modelled - first.modelled)) / span_s;
        let middle = self.window[self.window.len() / 2].pose;
        let (sin, cos) = middle.yaw_rad.sin_cos();
        let in_body = Vector3::new(
            cos * residual.x + sin * residual.y,
            -sin * residual.x + cos * residual.y,
            residual.z,
        );
        self.map.learn(&middle, &in_body, time_s);
    }

    /// Returns the residual velocity at a place, world frame: m/s, m/s, rad/s.
    pub(crate) fn residual_in_world(&self, place: &PlanarPose) -> Vector3<f64> {
        if !self.config.by_place {
            return Vector3::zeros();
        }
        let r = self.map.at(place);
        let (sin, cos) = place.yaw_rad.sin_cos();
        Vector3::new(cos * r.x - sin * r.y, sin * r.x + cos * r.y, r.z)
    }

    pub(crate) fn cells(&self) -> Vec<Cell> {
        self.map.cells()
    }

    pub(crate) fn recall(&mut self, cells: &[Cell]) {
        self.map.recall(cells);
    }
}
