//! The status of the controller for `/diagnostics`.

use super::goal_session::TrackingState;
use crate::node::goals::GoalEnd;
use sidehill_bridge::control_loop::channel::LoopStatus;
use sidehill_bridge::drives::Input;
use sidehill_bridge::ros2::message::{DiagnosticStatus, KeyValue};
use sidehill_bridge::safety::{Reason, SafetyState, StopCause};
use sidehill_controller::controller::{Ahead, Decision, DriveResponse, Status};
use sidehill_controller::estimator::Estimate;
use sidehill_controller::mpc::QpFailure;
use sidehill_plant::statistics::quantile;
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::{drive_values, learned_values};
use std::collections::VecDeque;
use std::fmt::Display;

/// Solve times of which quantiles are taken: 20 s at 20 Hz.
const SOLVES: usize = 400;

/// Levels of diagnostic_msgs/DiagnosticStatus.
mod level {
    pub(super) const OK: u8 = 0;
    pub(super) const WARN: u8 = 1;
    pub(super) const ERROR: u8 = 2;
    pub(super) const STALE: u8 = 3;
}

/// What the server knows besides the control loop and the controller.
pub(crate) struct ServerStatus<'a> {
    /// Lifecycle state.
    pub(crate) lifecycle: &'a str,
    /// Messages that were rejected, and topic and reason of the last.
    pub(crate) rejected: u64,
    pub(crate) last_rejection: &'a str,
    /// The topics that are waited for.
    pub(crate) inputs: &'a [Input],
    /// Whether the emergency stop is pressed or silent.
    pub(crate) emergency_stop: Option<StopCause>,
    /// What keeps the vehicle from driving on; none where nothing does.
    pub(crate) blocked_by: Option<&'a str>,
    /// Where the vehicle is on its path; none without a route.
    pub(crate) tracking: Option<TrackingState>,
    /// Goals that were accepted.
    pub(crate) goals: u64,
    /// How the last goal ended, and why.
    pub(crate) last_end: Option<(GoalEnd, &'a str)>,
    /// Whether the drive is recorded.
    pub(crate) recording: RecordingState<'a>,
    /// How the drives respond, as learned.
    pub(crate) drives: Option<DriveResponse>,
}

/// Whether a drive is recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum RecordingState<'a> {
    /// Not requested.
    Off,
    /// It is.
    On,
    /// It no longer is.
    Ended(&'a str),
}

/// Counts and solve times of the decisions.
#[derive(Debug, Default)]
pub(crate) struct SolveStats {
    newest_s: f64,
    solves_us: VecDeque<f64>,
    fallbacks: u64,
    deadlines: u64,
}

impl SolveStats {
    /// Takes a decision, and returns whether it is a new one.
    pub(crate) fn take(&mut self, decision: &Decision) -> bool {
        if decision.time_s == self.newest_s {
            return false;
        }
        self.newest_s = decision.time_s;
        if let Some(solve) = &decision.solve {
            if self.solves_us.len() == SOLVES {
                self.solves_us.pop_front();
            }
            self.solves_us.push_back(1e6 * solve.solve_time_s);
        }
        if let Status::Fallback { reason, .. } = decision.status {
            self.fallbacks += 1;
            self.deadlines += u64::from(matches!(reason, QpFailure::Deadline { .. }));
        }
        true
    }

    /// Returns the median, the 99 % quantile and the largest solve time, us; NaN without one.
    fn quantiles_us(&self) -> [f64; 3] {
        let mut sorted: Vec<f64> = self.solves_us.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        [0.5, 0.99, 1.0].map(|share| quantile(&sorted, share).unwrap_or(f64::NAN))
    }
}

/// Returns the status of a node for `/diagnostics`.
pub(crate) fn diagnostic_status(
    node: &str,
    vehicle: &Vehicle,
    status: &LoopStatus,
    decision: &Decision,
    solves: &SolveStats,
    server: &ServerStatus<'_>,
) -> DiagnosticStatus {
    let (level, message) = summary(status, decision, server);
    let [solve_p50, solve_p99, solve_max] = solves.quantiles_us();
    let (row, timing) = (&status.row, &status.timing);
    let estimate = decision.estimate.as_ref();
    let number = |value: f64| format!("{value:.6}");
    let of = |field: fn(&Estimate) -> f64| number(estimate.map_or(f64::NAN, field));
    let slide = estimate.map(|estimate| {
        let sliding = vehicle.body_velocity(estimate.attitude, estimate.treads);
        let level = vehicle.icrhk().body_velocity(estimate.treads);
        [
            sliding.right_m_s - level.right_m_s,
            sliding.forward_m_s - level.forward_m_s,
        ]
    });
    let [slide_right, slide_forward] = slide.unwrap_or([f64::NAN; 2]);
    let last_end = server.last_end.map_or_else(String::new, |(end, reason)| {
        format!("{end:?}: {reason}")
            .trim_end_matches(": ")
            .to_owned()
    });
    let stopped_by = status.stopped_by.map(|reason| reason.to_string());
    let on_path =
        |field: fn(&TrackingState) -> f64| number(server.tracking.as_ref().map_or(f64::NAN, field));
    let cross_track_m = decision.progress.map(|progress| progress.cross_track_m);
    let ahead = |field: fn(Ahead) -> f64| number(decision.ahead.map_or(f64::NAN, field));
    let mut values = vec![
        ("lifecycle", server.lifecycle.to_owned()),
        ("safety", format!("{:?}", row.state).to_lowercase()),
        ("stopped_by", stopped_by.unwrap_or_default()),
        ("controller", decision.status.to_string()),
        (
            "emergency_stop",
            server.emergency_stop.is_some().to_string(),
        ),
        (
            "blocked_by",
            server.blocked_by.unwrap_or_default().to_owned(),
        ),
        ("goals", server.goals.to_string()),
        ("last_goal", last_end),
        ("solve_p50_us", number(solve_p50)),
        ("solve_p99_us", number(solve_p99)),
        ("solve_max_us", number(solve_max)),
        ("fallbacks", solves.fallbacks.to_string()),
        ("deadline_misses", solves.deadlines.to_string()),
        ("cycles", timing.cycles.to_string()),
        ("cycles_skipped", timing.skipped.to_string()),
        ("commands_unsent", timing.unsent.to_string()),
        ("lateness_p99_s", number(timing.lateness_p99_s)),
        ("feedback_age_s", number(row.feedback_age_s)),
        ("pose_age_s", of(|estimate| estimate.pose_age_s)),
        ("attitude_age_s", of(|estimate| estimate.attitude_age_s)),
        (
            "poses_gated",
            estimate.map_or(0, |e| e.poses_gated).to_string(),
        ),
        (
            "poses_late",
            estimate.map_or(0, |e| e.poses_late).to_string(),
        ),
        ("refused", server.rejected.to_string()),
        ("last_refusal", server.last_rejection.to_owned()),
        ("waits_for", waits_for(server.inputs)),
        (
            "recording",
            match server.recording {
                RecordingState::Off => "off".to_owned(),
                RecordingState::On => "on".to_owned(),
                RecordingState::Ended(reason) => format!("ended: {reason}"),
            },
        ),
        ("cross_track_m", number(cross_track_m.unwrap_or(f64::NAN))),
        (
            "cross_track_bound_m",
            number(decision.cross_track_bound_m().unwrap_or(f64::NAN)),
        ),
        ("cross_track_ahead_m", ahead(|ahead| ahead.cross_track_m)),
        ("cross_track_ahead_bound_m", ahead(|ahead| ahead.bound_m)),
        ("aside_m", on_path(|at| at.aside_m)),
        ("heading_error_rad", on_path(|at| at.heading_error_rad)),
        ("distance_to_goal_m", on_path(|at| at.distance_to_goal_m)),
        ("remaining_path_length_m", on_path(|at| at.left_m)),
        ("slide_right_m_s", number(slide_right)),
        ("slide_forward_m_s", number(slide_forward)),
        ("model_error_m_s", of(|estimate| estimate.model_error_m_s)),
        (
            "gyro_bias_rad_s",
            of(|estimate| estimate.gyro_bias_rad_s.unwrap_or(f64::NAN)),
        ),
    ];
    if let Some(guard) = &decision.guard {
        let ahead = guard
            .ahead
            .map_or_else(String::new, |place| place.to_string());
        values.extend([
            ("rollover_margin", number(guard.rollover_margin)),
            ("friction_use", number(guard.friction_use)),
            ("friction", number(guard.friction)),
            ("speed_share", number(guard.speed_share)),
            ("steep_ahead", ahead),
        ]);
    }
    DiagnosticStatus {
        level,
        name: format!("{node}: path tracking"),
        message,
        hardware_id: vehicle.name.clone(),
        values: values
            .into_iter()
            .map(|(key, value)| KeyValue {
                key: key.to_owned(),
                value,
            })
            .chain(server.drives.as_ref().into_iter().flat_map(drive_values))
            .chain(
                estimate
                    .and_then(|e| e.contact.as_ref())
                    .into_iter()
                    .flat_map(learned_values),
            )
            .collect(),
    }
}

/// Returns level and message.
fn summary(status: &LoopStatus, decision: &Decision, server: &ServerStatus<'_>) -> (u8, String) {
    let with = |level, message: &dyn Display| (level, message.to_string());
    if let Some(cause) = server.emergency_stop {
        return with(level::ERROR, &cause);
    }
    if let Some(reason) = server.blocked_by {
        return with(level::WARN, &reason);
    }
    if let (RecordingState::Ended(reason), SafetyState::Driving) =
        (server.recording, status.row.state)
    {
        return with(
            level::WARN,
            &format!("drives, but is not recorded: {reason}"),
        );
    }
    match (status.row.state, decision.status) {
        (_, Status::Waiting) => {
            let waits_for = waits_for(server.inputs);
            let colon = if waits_for.is_empty() { "" } else { ": " };
            let message = format!("there is no attitude and no pose yet{colon}{waits_for}");
            (level::STALE, message)
        }
        (SafetyState::Driving, Status::Fallback { reason, .. }) => with(level::WARN, &reason),
        (SafetyState::Driving, _) => match decision.guard.and_then(|guard| guard.ahead) {
            Some(place) => with(level::WARN, &place),
            None => match server.drives.map(|drives| drives.to_string()) {
                Some(short) if !short.is_empty() => (level::WARN, format!("drives; {short}")),
                _ => with(level::OK, &"drives"),
            },
        },
        (SafetyState::Zeroing | SafetyState::Enabling, _) => with(level::OK, &"is being armed"),
        (SafetyState::Stopping, _) => with(level::WARN, &"stops"),
        (SafetyState::Disarmed | SafetyState::Latched, _) => {
            match status.stopped_by.filter(Reason::is_fault) {
                Some(reason) if status.row.state == SafetyState::Latched => {
                    with(level::ERROR, &reason)
                }
                _ if server.inputs.iter().any(|input| input.missing.is_some()) => {
                    let message = format!("waits for {}", waits_for(server.inputs));
                    (level::WARN, message)
                }
                _ => with(level::OK, &"waits for a path"),
            }
        }
    }
}

/// Returns which inputs are missing, and why.
fn waits_for(inputs: &[Input]) -> String {
    let missing = inputs.iter().filter(|input| input.missing.is_some());
    let missing: Vec<String> = missing.map(Input::to_string).collect();
    missing.join("; ")
}

#[cfg(test)]
mod tests;
