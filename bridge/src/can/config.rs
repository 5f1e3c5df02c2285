//! `can.yaml`: which messages and signals of the database carry what.

use super::cia402::Cia402Config;
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
    /// Whether the drives shall be on.
    #[serde(default)]
    pub enable: Option<EnableSignal>,
    /// Counter and checksum.
    #[serde(default)]
    pub protection: Protection,
}

/// A signal and how its unit relates to ours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaledSignal {
    /// Name in the database.
    pub signal: String,
    /// Signal units in 1 m/s, m or rad; negative where the directions are opposite.
    #[serde(default = "one_f64")]
    pub per_unit: f64,
}

/// A signal that switches the drives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnableSignal {
    /// Name in the database.
    pub signal: String,
    /// Value for off.
    pub off: f64,
    /// Value for on.
    pub on: f64,
}

/// What protects a message against loss, repetition and corruption.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Protection {
    /// Signal that counts up by one with each message, through all its values.
    #[serde(default)]
    pub counter: Option<String>,
    /// Checksum over the other bytes.
    #[serde(default)]
    pub checksum: Option<Checksum>,
}

/// A checksum of 8 bits that fills one byte.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checksum {
    /// Signal.
    pub signal: String,
    /// Kind.
    pub algorithm: ChecksumAlgorithm,
    /// Bytes that are summed before those of the frame, so that messages cannot be confused.
    #[serde(default)]
    pub data_id: Vec<u8>,
}

/// Checksums by their names in the CRC catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum ChecksumAlgorithm {
    /// Polynomial 0x1D, as SAE J1850 and AUTOSAR's profile 1.
    #[serde(rename = "CRC-8/SAE-J1850")]
    SaeJ1850,
    /// Polynomial 0x2F.
    #[serde(rename = "CRC-8/AUTOSAR")]
    Autosar,
    /// Polynomial 0x07.
    #[serde(rename = "CRC-8/SMBUS")]
    Smbus,
    /// Polynomial 0x31, reflected.
    #[serde(rename = "CRC-8/MAXIM-DOW")]
    MaximDow,
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

/// A signal that tells a drive's state; a value that is listed nowhere is a fault.
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

/// Order and signs of roll and pitch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttitudeConvention {
    /// The paper's: Ry(roll) Rx(pitch), nose up positive.
    Paper,
    /// REP-103: x forward, y left, z up, Rz Ry Rx; nose down positive.
    Ros,
    /// x forward, y right, z down, Rz Ry Rx, as most AHRS; nose up positive.
    Aerospace,
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

fn one_f64() -> f64 {
    1.0
}
