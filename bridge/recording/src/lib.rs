//! Drives as ROS 2 messages: recorded to MCAP files, and shown live.
//!
//! ```text
//! controller, loop -> rings -> DriveMessages -> MessageSink: McapRecording, a live view
//! ```
//!
//! The control loop and the controller leave plain values in rings ([`sidehill_bridge::control_loop::tap`], [`sidehill_bridge::control_loop::record`]);
//! a thread without priority makes messages of them. Messages are CDR with ros2msg schemas, so that any
//! reader of ROS 2 bags decodes them. [`ControllerCycle`] and [`PathCommand`] hold what a replay needs,
//! bit by bit.

mod diagnostics;
mod drive_messages;
pub mod framing;
pub mod live;
mod mcap_file;
mod messages;
mod reader;
mod records;
mod scene;
mod schema;
mod sink;
mod sinks;
mod whole_file;

pub use diagnostics::{GeneralState, drive_values, learned_values};
pub use drive_messages::{DriveMessages, unix_ns};
pub use mcap_file::{Header, McapRecording, RecordLimits, RecordingStatus};
pub use messages::{ControllerCycle, FixState, GuardState, LogLine, LoopCycle, PathCommand, Topic};
pub use reader::{Recording, RecordingError, scan};
pub use scene::{Marker, Obstacles, ground};
pub use schema::schema;
pub use sink::MessageSink;
pub use sinks::Sinks;

#[cfg(test)]
mod tests;
