//! The way ahead, pose by pose, until something is in the way.

use super::footprint::Footprint;
use super::{Blockage, Surroundings};
use sidehill_plant::frames::{PlanarPose, wrap_angle};

/// Largest distance between two poses that are checked, m.
const STEP_M: f64 = 0.025;
/// Largest turn between two of them, rad.
const STEP_RAD: f64 = 0.02;
/// Most poses that are checked at once: 10 m ahead.
const POSES_MAX: usize = 800;

/// A pose that will be driven through, in the frame of the odometry, and the way to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Ahead {
    /// The pose.
    pub(crate) pose: PlanarPose,
    /// Way from the vehicle to it, m.
    pub(crate) distance_m: f64,
}

/// What is in the way first.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Clearance {
    /// What it is; none where the way that was looked at is free.
    pub(crate) blockage: Option<Blockage>,
    /// Way until it, or the way that was looked at, m.
    pub(crate) free_m: f64,
}

impl Surroundings<'_> {
    /// Returns how far the vehicle can go through poses in order, of which it is at the first.
    ///
    /// Between two poses it is taken to go straight, and to turn evenly. A way of more poses than are
    /// checked at once is free only as far as it was checked.
    pub(crate) fn clearance(&self, ahead: impl IntoIterator<Item = Ahead>) -> Clearance {
        let mut checked = 0;
        let mut last: Option<Ahead> = None;
        let mut free_m = 0.0;
        for next in ahead {
            let steps = last.map_or(1, |last| steps(&last.pose, &next.pose));
            for step in 1..=steps {
                let share = step as f64 / steps as f64;
                let at = last.map_or(next, |last| between(&last, &next, share));
                if let Some(blockage) = self.blockage(&at.pose) {
                    return Clearance {
                        blockage: Some(blockage),
                        free_m,
                    };
                }
                free_m = at.distance_m;
                checked += 1;
                if checked == POSES_MAX {
                    return Clearance {
                        blockage: None,
                        free_m,
                    };
                }
            }
            last = Some(next);
        }
        Clearance {
            blockage: None,
            free_m,
        }
    }

    /// Returns whether a vehicle that passes at a pose leaves room to every obstacle that is known.
    pub(crate) fn is_passable(&self, pose: &PlanarPose) -> bool {
        !self.is_hit(&self.settings.passing_footprint, pose)
    }

    /// Returns whether a vehicle at a pose has so little room that tracking errors may stop it.
    pub(crate) fn is_tight(&self, pose: &PlanarPose) -> bool {
        self.is_hit(&self.settings.tight_footprint, pose)
    }

    fn is_hit(&self, footprint: &Footprint, pose: &PlanarPose) -> bool {
        let costmap = self.costmap;
        costmap.is_hit(footprint, &self.map_from_odometry, pose)
    }

    fn blockage(&self, pose: &PlanarPose) -> Option<Blockage> {
        let footprint = &self.settings.footprint;
        self.costmap
            .blockage(footprint, &self.map_from_odometry, pose)
    }
}

fn steps(from: &PlanarPose, to: &PlanarPose) -> usize {
    let way_m = (to.x_m - from.x_m).hypot(to.y_m - from.y_m);
    let turn_rad = wrap_angle(to.yaw_rad - from.yaw_rad).abs();
    let steps = (way_m / STEP_M).max(turn_rad / STEP_RAD).ceil();
    (steps as usize).clamp(1, POSES_MAX)
}

fn between(from: &Ahead, to: &Ahead, share: f64) -> Ahead {
    let turn_rad = wrap_angle(to.pose.yaw_rad - from.pose.yaw_rad);
    Ahead {
        pose: PlanarPose {
            x_m: from.pose.x_m + share * (to.pose.x_m - from.pose.x_m),
            y_m: from.pose.y_m + share * (to.pose.y_m - from.pose.y_m),
            yaw_rad: from.pose.yaw_rad + share * turn_rad,
        },
        distance_m: from.distance_m + share * (to.distance_m - from.distance_m),
    }
}
