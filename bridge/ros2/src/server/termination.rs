//! Why goals end: for the client a code and a message, for the safety a cause to stop.

use super::goal_context::GoalContext;
use super::outcome::Outcome;
use crate::node::goals::GoalEnd;
use crate::node::message::action::code;
use sidehill_bridge::safety::{Reason, StopCause};
use sidehill_controller::controller::StopReason;

/// The end of a goal, and the cause for which the vehicle stops.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Termination {
    pub(crate) end: GoalEnd,
    pub(crate) cause: StopCause,
    pub(crate) outcome: Outcome,
}

impl Termination {
    /// Returns an abort that tells the client the cause of the stop.
    pub(crate) fn abort(code: u16, cause: StopCause) -> Self {
        Self::abort_with(cause, Outcome::new(code, cause.to_string()))
    }

    /// Returns an abort with a given outcome.
    pub(crate) fn abort_with(cause: StopCause, outcome: Outcome) -> Self {
        Self {
            end: GoalEnd::Aborted,
            cause,
            outcome,
        }
    }

    /// Returns the end that a client has requested.
    pub(crate) fn cancel() -> Self {
        let cause = StopCause::Cancelled;
        Self {
            end: GoalEnd::Canceled,
            cause,
            outcome: Outcome::new(code::NONE, cause.to_string()),
        }
    }
}

/// Returns why a goal is aborted in any of its phases: the emergency stop, pressed or not to be heard, or a jump
/// of the clock.
pub(crate) fn abort_cause(context: &GoalContext<'_>) -> Option<Termination> {
    if let Some(cause) = context.emergency_stop {
        return Some(Termination::abort(code::UNKNOWN, cause));
    }
    if let Some(reason) = context.estop_incompatible {
        let cause = StopCause::EmergencyStopIncompatible;
        let outcome = Outcome::new(code::UNKNOWN, format!("{cause}: {reason}"));
        return Some(Termination::abort_with(cause, outcome));
    }
    let jumped = Termination::abort(code::TF_ERROR, StopCause::ClockJumped);
    context.clock_jumped.then_some(jumped)
}

/// Returns the outcome of a drive that the safety state machine has ended.
pub(crate) fn ended_by_safety(context: &GoalContext<'_>) -> Outcome {
    let Some(reason) = context.stopped_by else {
        return Outcome::new(code::UNKNOWN, "the drive has ended");
    };
    if let Some(cause) = context.emergency_stop {
        return Outcome::new(code::UNKNOWN, cause.to_string());
    }
    let code = match reason {
        Reason::CommandTimeout { .. } => code::CONTROLLER_TIMED_OUT,
        Reason::CommandNotFinite | Reason::Geofence => code::NO_VALID_CONTROL,
        Reason::FeedbackTimeout { .. } | Reason::Clock { .. } => code::TF_ERROR,
        Reason::ControllerStopped { why } => return controller_stopped(&why),
        _ => code::UNKNOWN,
    };
    Outcome::new(code, reason.to_string())
}

/// Returns the outcome after the controller has stopped; a missing pose is reported as Nav2 reports a
/// missing transform.
fn controller_stopped(why: &StopReason) -> Outcome {
    let code = match why {
        StopReason::PoseStale { .. }
        | StopReason::PoseFrozen { .. }
        | StopReason::PoseUncertain { .. }
        | StopReason::ClockJump { .. } => code::TF_ERROR,
        StopReason::Stalled { .. } => code::FAILED_TO_MAKE_PROGRESS,
        StopReason::TooSteep { .. } => code::INVALID_PATH,
        StopReason::Requested => code::UNKNOWN,
        _ => code::NO_VALID_CONTROL,
    };
    Outcome::new(code, why.to_string())
}
