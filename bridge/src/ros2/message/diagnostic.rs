//! diagnostic_msgs.

use super::standard::Header;
use super::wire;

wire! {
    /// A value by name.
    KeyValue { key: String, value: String }
    /// State of a part: `level` is 0 for well, 1 warning, 2 error, 3 stale.
    DiagnosticStatus {
        level: u8,
        name: String,
        message: String,
        hardware_id: String,
        values: Vec<KeyValue>,
    }
    /// States of parts.
    DiagnosticArray = "diagnostic_msgs" / "DiagnosticArray" {
        header: Header,
        status: Vec<DiagnosticStatus>,
    }
}
