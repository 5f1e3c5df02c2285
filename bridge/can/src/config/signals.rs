use serde::{Deserialize, Serialize};

/// A signal and how its unit relates to ours.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScaledSignal {
    /// Name in the database.
    pub signal: String,
    /// Signal units per 1 m/s, m, rad or rad/s; negative if the directions are opposite.
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
    /// [Checksum](#checksum) over the other bytes.
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
    /// Bytes that are included before those of the frame, so that messages cannot be mistaken for each other.
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

fn one_f64() -> f64 {
    1.0
}
