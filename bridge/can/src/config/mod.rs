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
    /// The DBC file, relative to this one.
    pub database: String,
    /// What the controller's side sends every cycle. Traction and steer are in one message each,
    /// enable in at least one; a message with neither is a heartbeat.
    #[serde(default)]
    pub command: Vec<CommandMessage>,
    /// What the drives report.
    #[serde(default)]
    pub feedback: Option<Feedback>,
    /// Instead of both: drives that speak CANopen.
    #[serde(default)]
    pub cia402: Option<Cia402Config>,
    /// What the attitude sensor reports.
    pub attitude: AttitudeMessage,
    /// What a gyroscope reports, where there is one.
    #[serde(default)]
    pub yaw_rate: Option<YawRateMessage>,
    /// What the pose source reports.
    pub pose: PoseMessages,
    /// Largest number of counts that may be missing before a frame is refused once, from 1.
    #[serde(default = "one")]
    pub counter_skip_max: u32,
}

/// A message from the controller to the drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandMessage {
    /// Name in the database.
    pub message: String,
    /// Traction, in m/s.
    #[serde(default)]
    pub traction: Option<ScaledSignal>,
    /// Steer, in m/s.
    #[serde(default)]
    pub steer: Option<ScaledSignal>,
    /// Whether the drives are to be on.
    #[serde(default)]
    pub enable: Option<EnableSignal>,
    /// Counter and checksum.
    #[serde(default)]
    pub protection: Protection,
}

/// What both drives report.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Feedback {
    /// Of the traction motor.
    pub traction: DriveMessage,
    /// Of the steer motor.
    pub steer: DriveMessage,
}

/// What one motor's controller reports.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DriveMessage {
    /// Name in the database.
    pub message: String,
    /// Speed, in m/s of the treads.
    pub speed: ScaledSignal,
    /// State.
    pub state: StateSignal,
    /// Counter and checksum.
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
    /// Roll, in rad.
    pub roll: ScaledSignal,
    /// Pitch, in rad.
    pub pitch: ScaledSignal,
    /// What the two angles mean.
    pub convention: AttitudeConvention,
    /// From the instant of a reading to its arrival, s.
    #[serde(default)]
    pub latency_s: f64,
    /// Counter and checksum.
    #[serde(default)]
    pub protection: Protection,
}

/// Yaw rate about the body's upward axis.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct YawRateMessage {
    /// Name in the database.
    pub message: String,
    /// Yaw rate, counter-clockwise, in rad/s.
    pub rate: ScaledSignal,
    /// From the instant of a reading to its arrival, s.
    #[serde(default)]
    pub latency_s: f64,
    /// Counter and checksum.
    #[serde(default)]
    pub protection: Protection,
}

/// The pose, in two messages that belong together where their counters agree.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PoseMessages {
    /// The first of the two.
    pub position: PositionMessage,
    /// The second.
    pub heading: HeadingMessage,
    /// From the instant of a pose to the arrival of its second message, s.
    #[serde(default)]
    pub latency_s: f64,
}

/// Position in the horizontal plane of the world.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PositionMessage {
    /// Name in the database.
    pub message: String,
    /// X_g, in m.
    pub x: ScaledSignal,
    /// Y_g, in m.
    pub y: ScaledSignal,
    /// Counter, which this message must have, and checksum.
    pub protection: Protection,
}

/// Heading and height.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadingMessage {
    /// Name in the database.
    pub message: String,
    /// Z_g, in m.
    pub z: ScaledSignal,
    /// Heading psi, counter-clockwise from Y_g, in rad.
    pub yaw: ScaledSignal,
    /// Counter, which this message must have, and checksum.
    pub protection: Protection,
}

fn one() -> u32 {
    1
}
