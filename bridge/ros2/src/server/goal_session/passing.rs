//! An obstacle ahead is passed within the corridor, where there is room.

use super::ahead::{Mount, REFERENCE_STEP_M, along};
use super::{FollowedPath, GoalSession, SessionSettings};
use crate::server::goal_context::{GoalContext, ObstacleContext, Request, StepRequests};
use crate::server::obstacles::Blockage;

/// Least time between two looks for a course, s.
const PASSING_PERIOD_S: f64 = 0.2;
/// Time from a look until the controller follows the new course, s.
const CHANGE_S: f64 = 0.3;

impl GoalSession {
    /// Moves the route past an obstacle on it, where there is a free course within the corridor. Whether the
    /// way is free is checked afterwards as on every other route.
    pub(super) fn pass_obstacle(
        &mut self,
        context: &GoalContext<'_>,
        obstacles: &ObstacleContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) {
        let corridor_m = obstacles.settings.config.corridor_m;
        // The clock may have jumped back.
        let recent = (0.0..PASSING_PERIOD_S).contains(&(context.now_s - self.passing_tried_s));
        let (FollowedPath::Route(placed), Ok(surroundings), Some(decision)) =
            (&mut self.following, &obstacles.seen, context.decision)
        else {
            return;
        };
        let Some(estimate) = decision.estimate.filter(|_| corridor_m > 0.0 && !recent) else {
            return;
        };
        self.passing_tried_s = context.now_s;
        let mount = Mount {
            point: settings.route.tracked_point,
            normal_in_world: estimate.normal_in_world,
        };
        let look_m = placed.route.passing_look_m(corridor_m, &settings.route);
        let change_m = CHANGE_S * decision.command_effective.traction_m_s.abs();
        // What is beside the vehicle now is not passed by another course.
        let reference = || {
            placed
                .poses_ahead(self.reached_m, look_m, mount)
                .filter(|ahead| ahead.distance_m > change_m + REFERENCE_STEP_M)
        };
        let own = decision.reference == self.number;
        let plan = context.plan.iter().filter(|_| own);
        let predicted = surroundings.clearance(along(&estimate.pose, plan));
        let blocked = predicted.blockage == Some(Blockage::Obstacle)
            || reference().any(|ahead| surroundings.is_tight(&ahead.pose));
        let Some(ahead_m) = reference()
            .find(|ahead| blocked && !surroundings.is_passable(&ahead.pose))
            .map(|ahead| ahead.distance_m)
        else {
            return;
        };
        let (from_m, blocked_m) = (self.reached_m + change_m, self.reached_m + ahead_m);
        let route =
            placed
                .route
                .passing((from_m, blocked_m), corridor_m, &settings.route, |point| {
                    surroundings.is_passable(&placed.pose(&point.pose(), mount))
                });
        if let Some(route) = route {
            let left_m = route.aside_m(blocked_m);
            let side = if left_m < 0.0 { "right" } else { "left" };
            requests.push(Request::Warn(format!(
                "an obstacle {ahead_m:.2} m ahead is passed {:.2} m to the {side} of the path",
                left_m.abs()
            )));
            placed.route = route;
            placed.changed = true;
        }
    }
}
