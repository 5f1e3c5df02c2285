//! `can.yaml`: which messages and signals of the database carry what.

mod cia402;
mod signals;

pub use cia402::{Cia402Config, Cia402Drive, CommandPdo, FeedbackPdo, ObjectType, ObjectValue};
pub use signals::{
    AttitudeConvention, Checksum, ChecksumAlgorithm, EnableSignal, Protection, ScaledSignal,
};

use serde::{Deserialize, Serialize};

/// The layout of the bus by names; [`super::layout::Layout`] finds them in the database.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CanConfig {
    /// DBC file.
    pub database: String,
    /// [Messages](#command-message) to the drives, sent every cycle. Traction and steer are in one message each, enable
    /// in at least one; a message with neither is a heartbeat.
    #[serde(default)]
    pub command: Vec<CommandMessage>,
    /// [Messages of the drives](#feedback).
    #[serde(default)]
    pub feedback: Option<Feedback>,
    /// [CiA 402 drives](#cia-402), in place of `command` and `feedback`.
    #[serde(default)]
    pub cia402: Option<Cia402Config>,
    /// [Message of the attitude sensor](#attitude-message).
    pub attitude: AttitudeMessage,
    /// [Message of a gyroscope](#yaw-rate-message).
    #[serde(default)]
    pub yaw_rate: Option<YawRateMessage>,
    /// [Messages of the pose source](#pose-messages).
    pub pose: PoseMessages,
    /// Number of missing counter values above which a frame is rejected.
    #[serde(default = "one")]
    pub counter_skip_max: u32,
}

/// A message from the controller to the drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandMessage {
    /// Name in the database.
    pub message: String,
    /// [Traction](#scaled-signal), in m/s.
    #[serde(default)]
    pub traction: Option<ScaledSignal>,
    /// [Steer](#scaled-signal), in m/s.
    #[serde(default)]
    pub steer: Option<ScaledSignal>,
    /// [Whether the drives should be on](#enable-signal).
    #[serde(default)]
    pub enable: Option<EnableSignal>,
    /// [Counter and checksum](#protection).
    #[serde(default)]
    pub protection: Protection,
}

/// What both drives report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Feedback {
    /// [Of the traction motor](#drive-message).
    pub traction: DriveMessage,
    /// [Of the steer motor](#drive-message).
    pub steer: DriveMessage,
}

/// What one motor's controller reports.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveMessage {
    /// Name in the database.
    pub message: String,
    /// [Speed](#scaled-signal), in m/s of the treads.
    pub speed: ScaledSignal,
    /// [State](#state-signal).
    pub state: StateSignal,
    /// [Counter and checksum](#protection).
    #[serde(default)]
    pub protection: Protection,
}

/// A signal with a drive's state. A value that is not listed is a fault.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct StateSignal {
    /// Name in the database.
    pub signal: String,
    /// Values for a drive that is off and can be switched on.
    pub disabled: Vec<f64>,
    /// Values for a drive that follows commands.
    pub enabled: Vec<f64>,
    /// Values for the emergency stop.
    pub emergency_stop: Vec<f64>,
    /// Values for a fault.
    pub fault: Vec<f64>,
}

/// Roll and pitch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AttitudeMessage {
    /// Name in the database.
    pub message: String,
    /// [Roll](#scaled-signal), in rad.
    pub roll: ScaledSignal,
    /// [Pitch](#scaled-signal), in rad.
    pub pitch: ScaledSignal,
    /// Convention of the angles: the paper's, REP-103, or aerospace (x forward, y right, z down).
    pub convention: AttitudeConvention,
    /// From the instant of a reading to its arrival.
    #[serde(default)]
    pub latency_s: f64,
    /// [Counter and checksum](#protection).
    #[serde(default)]
    pub protection: Protection,
}

/// Yaw rate about the body's upward axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YawRateMessage {
    /// Name in the database.
    pub message: String,
    /// [Yaw rate](#scaled-signal) about the vehicle's upward axis, counter-clockwise, in rad/s.
    pub rate: ScaledSignal,
    /// From the instant of a reading to its arrival.
    #[serde(default)]
    pub latency_s: f64,
    /// [Counter and checksum](#protection).
    #[serde(default)]
    pub protection: Protection,
}

/// The pose, in two messages that belong together where their counters agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseMessages {
    /// [First message](#position-message).
    pub position: PositionMessage,
    /// [Second message](#heading-message).
    pub heading: HeadingMessage,
    /// From the instant of a pose to the arrival of its second message.
    #[serde(default)]
    pub latency_s: f64,
}

/// Position in the horizontal plane of the world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionMessage {
    /// Name in the database.
    pub message: String,
    /// [X_g](#scaled-signal), in m.
    pub x: ScaledSignal,
    /// [Y_g](#scaled-signal), in m.
    pub y: ScaledSignal,
    /// [Counter and checksum](#protection). The counter is required.
    pub protection: Protection,
}

/// Heading and height.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadingMessage {
    /// Name in the database.
    pub message: String,
    /// [Z_g](#scaled-signal), in m.
    pub z: ScaledSignal,
    /// [Heading](#scaled-signal) psi, counter-clockwise from Y_g, in rad.
    pub yaw: ScaledSignal,
    /// [Counter and checksum](#protection). The counter is required.
    pub protection: Protection,
}

fn one() -> u32 {
    1
}
