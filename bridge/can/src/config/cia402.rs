use super::signals::ScaledSignal;
use crate::message::DriveRole;
use serde::{Deserialize, Serialize};

/// Two drives that speak CANopen with the profile CiA 402.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cia402Config {
    /// Node number of this program, from 1 to 127; its heartbeat is sent in every cycle.
    pub node_id: u8,
    /// Whether a SYNC follows the commands of every cycle.
    #[serde(default)]
    pub sync: bool,
    /// Time of quick stop when the drives are switched off. Then disable voltage is sent for as long, and a drive that
    /// is not off by then gets NMT stop.
    pub quick_stop_time_s: f64,
    /// Longest wait for the answer to an SDO write.
    pub answer_time_s: f64,
    /// [Traction and steer, or left and right](#drive-of-cia-402).
    pub drives: [Cia402Drive; 2],
}

/// One drive.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Cia402Drive {
    /// What the drive moves.
    pub role: DriveRole,
    /// Its node number, from 1 to 127.
    pub node_id: u8,
    /// [PDO](#command-pdo) that the drive receives.
    pub command: CommandPdo,
    /// [PDO](#feedback-pdo) that the drive sends.
    pub feedback: FeedbackPdo,
    /// [Objects](#object) written to the drive, in this order, whenever it has booted.
    #[serde(default)]
    pub setup: Vec<ObjectValue>,
}

/// The PDO that a drive receives.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandPdo {
    /// Name in the database.
    pub message: String,
    /// Signal of the controlword, object 0x6040.
    pub controlword: String,
    /// [Target velocity](#scaled-signal), in m/s.
    pub target_velocity: ScaledSignal,
}

/// The PDO that a drive sends.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FeedbackPdo {
    /// Name in the database.
    pub message: String,
    /// Signal of the statusword, object 0x6041.
    pub statusword: String,
    /// [Actual velocity](#scaled-signal), in m/s.
    pub actual_velocity: ScaledSignal,
}

/// An object of a drive and the value to write.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectValue {
    /// Index.
    pub object: u16,
    /// Subindex.
    #[serde(default)]
    pub sub: u8,
    /// Type.
    #[serde(rename = "type")]
    pub kind: ObjectType,
    /// Value.
    pub value: i64,
}

/// Type of an object that fits into one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ObjectType {
    /// Unsigned, 8 bits.
    U8,
    /// Unsigned, 16 bits.
    U16,
    /// Unsigned, 32 bits.
    U32,
    /// Signed, 8 bits.
    I8,
    /// Signed, 16 bits.
    I16,
    /// Signed, 32 bits.
    I32,
}
