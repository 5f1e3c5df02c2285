//! What a client is told of a drive that has ended.

use super::vocabulary::Seen;
use super::{Outcome, Reason, StopCause, code};
use sidehill_controller::controller::StopReason;

/// What ends a drive, and what is told of it: the same.
pub(super) fn doubt(code: u16, cause: StopCause) -> (StopCause, Outcome) {
    (cause, Outcome::new(code, cause.to_string()))
}

/// What forbids to drive on, whatever the safety does.
pub(super) fn refusal(seen: &Seen<'_>) -> Option<(StopCause, Outcome)> {
    if let Some(cause) = seen.emergency_stop {
        return Some(doubt(code::UNKNOWN, cause));
    }
    seen.clock_jumped
        .then(|| doubt(code::TF_ERROR, StopCause::ClockJumped))
}

/// Returns what a client is told of a drive that the safety has ended.
pub(super) fn explained(seen: &Seen<'_>) -> Outcome {
    let Some(reason) = seen.stopped_by else {
        return Outcome::new(code::UNKNOWN, "the drive has ended");
    };
    if let Some(cause) = seen.emergency_stop {
        return Outcome::new(code::UNKNOWN, cause.to_string());
    }
    let code = match reason {
        Reason::CommandTimeout { .. } => code::CONTROLLER_TIMED_OUT,
        Reason::CommandNotFinite => code::NO_VALID_CONTROL,
        Reason::FeedbackTimeout { .. } | Reason::Clock { .. } => code::TF_ERROR,
        Reason::ControllerStopped { why } => return stopped(&why),
        _ => code::UNKNOWN,
    };
    Outcome::new(code, reason.to_string())
}

/// Returns what a client is told of a controller that has stopped: without a pose Nav2's transforms
/// fail too.
fn stopped(why: &StopReason) -> Outcome {
    let code = match why {
        StopReason::PoseStale { .. } | StopReason::ClockJump { .. } => code::TF_ERROR,
        StopReason::Requested => code::UNKNOWN,
        _ => code::NO_VALID_CONTROL,
    };
    Outcome::new(code, why.to_string())
}
