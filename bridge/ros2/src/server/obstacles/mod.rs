//! Obstacles ahead: a costmap, the footprint of the vehicle, and where it has to slow down and stop.
//!
//! ```text
//! costmap -> CostmapReader -> Costmap --.
//!                                        +-> Surroundings::clearance -> Clearance -> GoalSession
//! plan and reference ahead, braking -----'
//! ```
//!
//! The check runs in the thread of the server. Its work is bounded by the look-ahead, the footprint and the
//! resolution; neither the control loop nor the controller waits for it. With a corridor, `Passing` looks for
//! a detour past the obstacle, and the route is moved aside.

mod braking;
mod costmap;
mod footprint;
mod look_ahead;
mod passing;
mod reader;

pub use braking::StoppingSettings;
pub(crate) use braking::{ApproachSpeed, Braking};
pub(crate) use costmap::{Blockage, Costmap};
pub(crate) use look_ahead::{Ahead, Clearance};
pub(crate) use passing::{Detour, Passing};
pub(crate) use reader::CostmapReader;

use costmap::{CellRule, level};
use footprint::Footprint;
use nalgebra::Isometry2;
use sidehill_bridge::ros2::settings::costmap::CostmapConfig;
use sidehill_bridge::ros2::transforms::Transforms;
use sidehill_plant::frames::Attitude;
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::Obstacles;

/// Room that a detour past an obstacle leaves beside the padded footprint, m: for the error of tracking, and so that
/// noise in the costmap does not change the detour.
const PASSING_M: f64 = 0.1;

/// Room below which a route is moved aside, m. Less than a detour leaves: the map may show more of an obstacle later,
/// and tracking errors would stop a vehicle that just fits.
const TIGHT_M: f64 = 0.05;

/// What of the vehicle and the configuration the check depends on.
#[derive(Debug, Clone)]
pub(crate) struct ObstacleSettings {
    pub(crate) config: CostmapConfig,
    footprint: Footprint,
    /// The footprint that a detour past an obstacle leaves free.
    passing_footprint: Footprint,
    /// The footprint that a route leaves free which is not moved aside.
    tight_footprint: Footprint,
    stopping: StoppingSettings,
}

impl ObstacleSettings {
    /// Returns the settings of a vehicle.
    pub(crate) fn new(
        config: CostmapConfig,
        stopping: StoppingSettings,
        vehicle: &Vehicle,
    ) -> Self {
        let footprint = |padding_m| {
            Footprint::new(
                &config.footprint,
                config.footprint_padding_m + padding_m,
                vehicle,
            )
        };
        Self {
            footprint: footprint(0.0),
            passing_footprint: footprint(PASSING_M),
            tight_footprint: footprint(TIGHT_M),
            config,
            stopping,
        }
    }

    /// Returns which cells of a costmap block.
    pub(crate) fn rule(&self) -> CellRule {
        CellRule {
            lethal_cost: self.config.lethal_cost,
            unknown_is_lethal: self.config.unknown_is_lethal,
        }
    }

    /// Returns how the vehicle brakes at an attitude.
    pub(crate) fn braking(&self, attitude: &Attitude, reverse: bool) -> Braking {
        Braking::on_slope(&self.stopping, self.config.friction, attitude, reverse)
    }
}

/// Why nothing is known of obstacles.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Doubt {
    /// None has arrived, or none that can be used.
    #[error("there is no costmap yet")]
    NoCostmap,
    /// It is too old, or from the future.
    #[error("the costmap is {age_s:.2} s old")]
    Stale { age_s: f64 },
    /// Its place is unknown.
    #[error("the costmap cannot be located: {0}")]
    NoTransform(String),
}

/// A fresh costmap as seen from the frame of the odometry, with the settings of the check.
#[derive(Clone, Copy)]
pub(crate) struct Surroundings<'a> {
    costmap: &'a Costmap,
    map_from_odometry: Isometry2<f64>,
    settings: &'a ObstacleSettings,
}

impl<'a> Surroundings<'a> {
    /// Returns what is known at `now_s` of a costmap with the stamp `stamp_s`.
    ///
    /// The map is placed by the transform of its stamp: a map that moves with the vehicle is seen where
    /// the vehicle was then.
    pub(crate) fn new(
        costmap: &'a Costmap,
        (stamp_s, now_s): (f64, f64),
        (transforms, odometry, tolerance_s): (&Transforms, &str, f64),
        settings: &'a ObstacleSettings,
    ) -> Result<Self, Doubt> {
        let age_s = now_s - stamp_s;
        if !(-tolerance_s..=settings.config.timeout_s).contains(&age_s) {
            return Err(Doubt::Stale { age_s });
        }
        let map_from_odometry = transforms
            .look_up(&costmap.frame, odometry, stamp_s, tolerance_s)
            .map_err(|error| Doubt::NoTransform(error.to_string()))?;
        Ok(Self {
            costmap,
            map_from_odometry: level(&map_from_odometry),
            settings,
        })
    }

    /// Returns the cells that block, in the frame of the odometry.
    pub(crate) fn obstacles(&self) -> Obstacles {
        self.costmap.obstacles(&self.map_from_odometry.inverse())
    }
}
