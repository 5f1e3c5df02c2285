//! builtin_interfaces, std_msgs and rosgraph_msgs.

use super::wire;

/// A stamp of builtin_interfaces: `nanosec` counts on from `sec` and is below 1e9.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Default,
    serde::Serialize,
    serde::Deserialize,
)]
pub struct Time {
    /// Whole seconds.
    pub sec: i32,
    /// Nanoseconds after them.
    pub nanosec: u32,
}

wire! {
    /// Stamp and coordinate frame of what follows.
    Header { stamp: Time, frame_id: String }
    /// The time that a simulation publishes.
    Clock = "rosgraph_msgs" / "Clock" { clock: Time }
    /// Nothing.
    Empty = "std_msgs" / "Empty" { structure_needs_at_least_one_member: u8 }
    /// A truth value.
    Bool = "std_msgs" / "Bool" { data: bool }
    /// A number.
    Float64 = "std_msgs" / "Float64" { data: f64 }
    /// Text.
    Text = "std_msgs" / "String" { data: String }
    /// One dimension of an array.
    MultiArrayDimension { label: String, size: u32, stride: u32 }
    /// The dimensions of an array.
    MultiArrayLayout { dim: Vec<MultiArrayDimension>, data_offset: u32 }
    /// An array of numbers.
    Float64MultiArray = "std_msgs" / "Float64MultiArray" { layout: MultiArrayLayout, data: Vec<f64> }
}
