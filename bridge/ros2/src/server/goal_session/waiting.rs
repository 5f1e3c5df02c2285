//! Phases in which the vehicle stands or comes to a halt: stopping, arming, ending.

use super::{AfterStop, FollowedPath, GoalSession, SessionPhase, SessionSettings};
use crate::node::message::action::code;
use crate::server::goal_context::{GoalContext, Request, StepRequests};
use crate::server::termination::{Termination, abort_cause};
use sidehill_bridge::safety::StopCause;
use sidehill_plant::frames::wrap_angle;

/// Longest time until the drives are armed, s.
const ARMING_S: f64 = 10.0;
/// Longest time for a stop, s; the safety's own ramp is far shorter.
const STOPPING_S: f64 = 10.0;

impl GoalSession {
    /// Sends the client the result once the vehicle has stopped, and returns whether it was sent.
    pub(super) fn step_ending(
        &mut self,
        since_s: f64,
        context: &GoalContext<'_>,
        requests: &mut StepRequests,
    ) -> bool {
        let stopped = context.has_stopped_since(since_s);
        if !stopped && context.now_s - since_s <= STOPPING_S {
            return false;
        }
        if let SessionPhase::Ending { end, outcome, .. } = &self.phase {
            let (client, end, outcome) = (self.client, *end, outcome.clone());
            requests.push(Request::Follow(None));
            requests.stop(requests.stop_cause().filter(|_| !stopped));
            requests.push(Request::Finish {
                client,
                end,
                outcome,
            });
        }
        true
    }

    pub(super) fn arm(&mut self, now_s: f64, requests: &mut StepRequests) {
        self.phase = SessionPhase::Arming {
            since_s: now_s,
            request: self.number,
        };
        requests.push(Request::Arm(self.number));
    }

    pub(super) fn step_stopping(
        &mut self,
        (since_s, then): (f64, AfterStop),
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) {
        let now_s = context.now_s;
        if let Some(termination) = abort_cause(context) {
            return self.terminate(now_s, termination, requests);
        }
        let estimate = context.decision.and_then(|decision| decision.estimate);
        if let Some(estimate) = estimate.filter(|_| context.has_stopped_since(since_s)) {
            let pose = estimate.pose;
            requests.stop(None);
            match then {
                AfterStop::PivotTo(heading_rad) => {
                    self.pivoted_at_start = true;
                    let angle_rad = wrap_angle(heading_rad - pose.yaw_rad);
                    let target = (FollowedPath::StartPivot(heading_rad), angle_rad);
                    self.pivot(target, &pose, context, settings, requests);
                }
                AfterStop::CheckGoal => self.check_goal(&estimate, context, settings, requests),
            }
        } else if now_s - since_s > STOPPING_S {
            let termination = Termination::abort(code::UNKNOWN, StopCause::NotArmed);
            self.terminate(now_s, termination, requests);
        }
    }

    pub(super) fn step_arming(
        &mut self,
        (since_s, request): (f64, u64),
        context: &GoalContext<'_>,
        requests: &mut StepRequests,
    ) {
        if let Some(termination) = abort_cause(context) {
            self.terminate(context.now_s, termination, requests);
        } else if Self::withdraw_stop(context, requests) {
            // The safety sees it in its next cycle.
        } else if context.armed >= request {
            self.phase = SessionPhase::Driving { tracked: false };
        } else if context.now_s - since_s > ARMING_S {
            let termination = Termination::abort(code::UNKNOWN, StopCause::NotArmed);
            self.terminate(context.now_s, termination, requests);
        }
    }

    /// Withdraws a stop that was requested for the path before, once the vehicle has stopped; returns whether
    /// there was one.
    pub(super) fn withdraw_stop(context: &GoalContext<'_>, requests: &mut StepRequests) -> bool {
        let withdraws = requests.stop_cause().is_some() && context.is_off();
        if withdraws {
            requests.stop(None);
        }
        withdraws
    }
}
