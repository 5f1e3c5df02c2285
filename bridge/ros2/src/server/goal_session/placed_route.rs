//! The route of a session where the odometry has it.

use crate::server::route::ProfiledRoute;
use sidehill_bridge::control_loop::channel::PathCommand;
use sidehill_plant::frames::PlanarPose;

/// A route and the frame of its path in that of the odometry, as the controller has them.
pub(super) struct PlacedRoute {
    pub(super) route: ProfiledRoute,
    pub(super) frame: PlanarPose,
    /// The controller does not have the newest speeds or frame yet.
    pub(super) changed: bool,
}

impl PlacedRoute {
    /// Returns the command to follow it from an arc length on.
    pub(super) fn command(&self, number: u64, from_m: f64) -> PathCommand {
        PathCommand {
            number,
            trajectory: self.route.trajectory.clone().seen_from(&self.frame),
            from_m,
        }
    }
}
