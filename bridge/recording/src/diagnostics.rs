//! States of controller, safety and recording as ROS 2 diagnostics.

use super::mcap_file::RecordingStatus;
use sidehill_bridge::drives::LinkState;
use sidehill_bridge::ros2::message::{DiagnosticStatus, KeyValue};
use sidehill_bridge::safety::SafetyState;
use sidehill_controller::controller::{Decision, DriveResponse, Status};
use sidehill_controller::estimator::ContactEstimate;
use sidehill_plant::contact::Parameter;
use sidehill_plant::frames::wrap_angle;

// Levels of diagnostic_msgs/DiagnosticStatus.
const OK: u8 = 0;
const WARN: u8 = 1;
const ERROR: u8 = 2;
const STALE: u8 = 3;

/// What the cycles themselves do not show.
#[derive(Debug, Clone, Default)]
pub struct GeneralState<'a> {
    /// State of the recording, if there is one.
    pub recording: Option<&'a RecordingStatus>,
    /// Records dropped because their ring was full.
    pub lost: u64,
}

/// Returns the state of the controller after its newest decision.
pub(super) fn controller_status(decision: &Decision, drives: &DriveResponse) -> DiagnosticStatus {
    let level = match decision.status {
        Status::Tracking | Status::Finished => OK,
        Status::Fallback { .. } | Status::Stopping(_) => WARN,
        Status::Waiting => STALE,
    };
    let estimate = decision.estimate.as_ref();
    let values = [
        (
            "model_error_m_s",
            estimate.map(|estimate| estimate.model_error_m_s),
        ),
        (
            "gyro_bias_rad_s",
            estimate.and_then(|estimate| estimate.gyro_bias_rad_s),
        ),
        ("pose_age_s", estimate.map(|estimate| estimate.pose_age_s)),
        (
            "attitude_age_s",
            estimate.map(|estimate| estimate.attitude_age_s),
        ),
        (
            "cross_track_m",
            decision.progress.map(|progress| progress.cross_track_m),
        ),
        ("cross_track_bound_m", decision.cross_track_bound_m()),
        (
            "cross_track_ahead_m",
            decision.ahead.map(|ahead| ahead.cross_track_m),
        ),
        (
            "cross_track_ahead_bound_m",
            decision.ahead.map(|ahead| ahead.bound_m),
        ),
        (
            "heading_error_rad",
            estimate.zip(decision.progress).map(|(estimate, progress)| {
                wrap_angle(estimate.pose.yaw_rad - progress.point.heading_rad)
            }),
        ),
        (
            "solve_us",
            decision.solve.map(|solve| 1e6 * solve.solve_time_s),
        ),
    ]
    .map(|(key, value)| (key, value.unwrap_or(f64::NAN).to_string()));
    let mut status = entry(level, "controller", &decision.status.to_string(), &values);
    status.values.extend(drive_values(drives));
    let contact = estimate.and_then(|estimate| estimate.contact.as_ref());
    status
        .values
        .extend(contact.into_iter().flat_map(learned_values));
    status
}

/// Returns how the drives respond: in words, empty where they do as they are told, and in figures.
pub fn drive_values(drives: &DriveResponse) -> [KeyValue; 9] {
    let number = |value: f64| format!("{value:.3}");
    let (traction, steer) = (&drives.traction, &drives.steer);
    [
        ("drives", drives.to_string()),
        ("traction_reached_m_s", number(traction.speed_max_m_s)),
        ("steer_reached_m_s", number(steer.speed_max_m_s)),
        (
            "traction_acceleration_m_s2",
            number(traction.acceleration_max_m_s2),
        ),
        (
            "steer_acceleration_m_s2",
            number(steer.acceleration_max_m_s2),
        ),
        ("traction_gain", number(traction.gain)),
        ("steer_gain", number(steer.gain)),
        ("command_share", number(drives.share)),
        ("drive_delay_s", number(drives.delay_s)),
    ]
    .map(|(key, value)| KeyValue {
        key: key.to_owned(),
        value,
    })
}

/// Returns the learned parameters of a contact vehicle with their 95 % intervals, and which of them the drive
/// has not excited.
pub fn learned_values(contact: &ContactEstimate) -> impl Iterator<Item = KeyValue> + '_ {
    Parameter::ALL.into_iter().map(|parameter| {
        let (value, (low, high)) = contact.interval(parameter);
        let prior = if contact.observed(parameter) {
            ""
        } else {
            ", not excited: prior"
        };
        KeyValue {
            key: format!("learned_{}", parameter.key()),
            value: format!("{value:.4} ({low:.4} to {high:.4}{prior})"),
        }
    })
}

/// Returns the state of the safety state machine and of the link to the drives.
pub(super) fn safety_status(state: SafetyState, link: LinkState) -> DiagnosticStatus {
    let level = if link.carries() { OK } else { WARN };
    let values = [("link", format!("{link:?}").to_lowercase())];
    entry(
        level,
        "safety",
        &format!("{state:?}").to_lowercase(),
        &values,
    )
}

/// Returns the state of the recording, if there is one.
pub(super) fn recording_status(general: &GeneralState<'_>) -> Option<DiagnosticStatus> {
    let recording = general.recording?;
    let level = match (&recording.ended, general.lost) {
        (Some(_), _) => ERROR,
        (None, 0) => OK,
        (None, _) => WARN,
    };
    let values = [
        ("file", recording.file.display().to_string()),
        ("bytes", recording.bytes.to_string()),
        ("lost", general.lost.to_string()),
    ];
    let text = recording.ended.as_deref().unwrap_or("records");
    Some(entry(level, "recording", text, &values))
}

fn entry(level: u8, name: &str, message: &str, values: &[(&str, String)]) -> DiagnosticStatus {
    let values = values.iter().map(|(key, value)| KeyValue {
        key: (*key).to_owned(),
        value: value.clone(),
    });
    DiagnosticStatus {
        level,
        name: format!("sidehill: {name}"),
        message: message.to_owned(),
        hardware_id: String::new(),
        values: values.collect(),
    }
}
