//! A drive and its end: supervision, the goal, pivots.

use super::{FollowedPath, GoalSession, SessionPhase, SessionSettings};
use crate::node::goals::GoalEnd;
use crate::node::message::action::code;
use crate::server::checkers::GoalError;
use crate::server::goal_context::{GoalContext, Request, StepRequests};
use crate::server::outcome::Outcome;
use crate::server::pivot_slide::pivot_slide_m;
use crate::server::route::{pivot, pivot_rate_rad_s};
use crate::server::termination::{Termination, abort_cause, ended_by_safety};
use sidehill_bridge::control_loop::channel::PathCommand;
use sidehill_bridge::safety::{Reason, SafetyState, StopCause};
use sidehill_controller::controller::{Decision, Status};
use sidehill_controller::estimator::Estimate;
use sidehill_plant::frames::PlanarPose;

impl GoalSession {
    pub(super) fn step_driving(&mut self, context: &GoalContext<'_>, requests: &mut StepRequests) {
        let own = context
            .decision
            .filter(|decision| decision.reference == self.number);
        let tracking = own.is_some_and(|decision| {
            matches!(
                decision.status,
                Status::Tracking | Status::Fallback { .. } | Status::Finished
            )
        });
        if let SessionPhase::Driving { tracked } = &mut self.phase {
            *tracked |= tracking;
        }
        if context.state != SafetyState::Stopping
            && let Some(termination) = self.supervise(context, own)
        {
            self.terminate(context.now_s, termination, requests);
        }
    }

    /// Returns why a drive is aborted, if it is.
    fn supervise(
        &mut self,
        context: &GoalContext<'_>,
        own: Option<&Decision>,
    ) -> Option<Termination> {
        let (now_s, tolerances) = (context.now_s, context.tolerances);
        if let Some(termination) = abort_cause(context) {
            return Some(termination);
        }
        if context.estop_unknown_driving {
            let cause = StopCause::EmergencyStopUnheard;
            return Some(Termination::abort(code::UNKNOWN, cause));
        }
        if self.client_lost {
            return Some(Termination::abort(code::UNKNOWN, StopCause::ClientLeft));
        }
        let lasts = |since_s: &mut Option<f64>, holds: bool| {
            if !holds {
                *since_s = None;
                return false;
            }
            now_s - *since_s.get_or_insert(now_s) > tolerances.failure_s
        };
        if lasts(&mut self.without_frame_since_s, self.frame_error.is_some()) {
            let reason = self.frame_error.clone().unwrap_or_default();
            let outcome = Outcome::new(code::TF_ERROR, reason);
            return Some(Termination::abort_with(StopCause::FrameLost, outcome));
        }
        let failure = match own.map(|decision| decision.status) {
            Some(Status::Fallback { reason, .. }) => Some(reason),
            _ => None,
        };
        if lasts(&mut self.without_plan_since_s, failure.is_some()) {
            let reason = failure.map_or_else(String::new, |reason| format!(": {reason}"));
            let message = format!("{}{reason}", StopCause::NoPlan);
            let outcome = Outcome::new(code::PATIENCE_EXCEEDED, message);
            return Some(Termination::abort_with(StopCause::NoPlan, outcome));
        }
        let estimate = own.and_then(|decision| decision.estimate)?;
        if context.state != SafetyState::Driving
            || !matches!(self.following, FollowedPath::Route(_))
        {
            return None;
        }
        let (radius_m, time_s) = (tolerances.progress_m, tolerances.progress_time_s);
        let progress = &mut self.progress;
        if progress.made_progress(now_s, &estimate.pose, radius_m, time_s) {
            return None;
        }
        let message = format!("no progress of {radius_m} m within {time_s} s");
        let outcome = Outcome::new(code::FAILED_TO_MAKE_PROGRESS, message);
        Some(Termination::abort_with(StopCause::NoProgress, outcome))
    }

    /// The safety has ended the drive.
    pub(super) fn step_stopped(
        &mut self,
        tracked: bool,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) {
        let estimate = context.decision.and_then(|decision| decision.estimate);
        match estimate {
            _ if context.stopped_by != Some(Reason::Finished) => {}
            // The drive before ended as this path came.
            _ if !tracked => return self.arm(context.now_s, requests),
            _ if matches!(self.following, FollowedPath::StartPivot(_)) => {
                self.following = FollowedPath::Nothing;
                self.number = requests.next_number();
                self.phase = SessionPhase::Locating {
                    since_s: context.now_s,
                };
                return;
            }
            Some(estimate) => {
                return self.check_goal(&estimate, context, settings, requests);
            }
            None => {}
        }
        let outcome = ended_by_safety(context);
        let termination = Termination::abort_with(StopCause::DriveEnded, outcome);
        self.terminate(context.now_s, termination, requests);
    }

    /// The vehicle stands at the end of the path: succeeds, pivots to the heading of the goal, or aborts. A
    /// pivot during which the slope would take the vehicle off the goal is not begun.
    pub(super) fn check_goal(
        &mut self,
        estimate: &Estimate,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) {
        let tolerances = context.tolerances;
        let point = settings.route.tracked_point;
        let tracked = point.of(&estimate.pose, &estimate.normal_in_world);
        let error = GoalError::of(&tracked, &self.goal);
        let succeeded = Termination {
            end: GoalEnd::Succeeded,
            cause: StopCause::DriveEnded,
            outcome: Outcome::default(),
        };
        if error.within(tolerances.goal_xy_m, tolerances.goal_yaw_rad) {
            return self.terminate(context.now_s, succeeded, requests);
        }
        let mut message = format!(
            "the path has ended {:.2} m and {:.2} rad off the goal",
            error.distance_m, error.heading_rad
        );
        let pivoted = matches!(self.following, FollowedPath::GoalPivot(_));
        if settings.pivots.at_goal && !pivoted && error.distance_m <= tolerances.goal_xy_m {
            let (attitude, yaw_rad) = (estimate.attitude, estimate.pose.yaw_rad);
            let rate_rad_s = pivot_rate_rad_s(&settings.route.limits);
            let (vehicle, angle_rad) = (&settings.vehicle, -error.heading_rad);
            let swing_m =
                2.0 * point.right_m.hypot(point.forward_m) * (0.5 * angle_rad).sin().abs();
            let slide_m =
                swing_m + pivot_slide_m(vehicle, attitude, yaw_rad, angle_rad, rate_rad_s);
            if error.distance_m + slide_m <= tolerances.goal_xy_m {
                let target = (FollowedPath::GoalPivot(self.goal.yaw_rad), angle_rad);
                return self.pivot(target, &estimate.pose, context, settings, requests);
            }
            message += &format!("; a pivot would slide {slide_m:.2} m on this slope");
        }
        let outcome = Outcome::new(code::NO_VALID_CONTROL, message);
        let missed = Termination::abort_with(StopCause::DriveEnded, outcome);
        self.terminate(context.now_s, missed, requests);
    }

    /// Arms a standing vehicle for a pivot.
    pub(super) fn pivot(
        &mut self,
        (following, angle_rad): (FollowedPath, f64),
        pose: &PlanarPose,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) {
        self.frame_error = None;
        match pivot(pose, angle_rad, &settings.route.limits) {
            Ok(trajectory) => {
                self.number = requests.next_number();
                self.following = following;
                requests.push(Request::Follow(Some(PathCommand {
                    number: self.number,
                    trajectory,
                    from_m: 0.0,
                })));
                self.arm(context.now_s, requests);
            }
            Err(outcome) => {
                let refused = Termination::abort_with(StopCause::PathRefused, outcome);
                self.terminate(context.now_s, refused, requests);
            }
        }
    }
}
