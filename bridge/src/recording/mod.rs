//! Drives as ROS 2 messages: recorded to MCAP files, and shown live.
//!
//! ```text
//! controller, loop -> rings -> DriveMessages -> MessageSink: McapRecording, a live view
//! ```
//!
//! The control loop and the controller leave plain values in rings ([`tap`], [`crate::control_loop::record`]);
//! a thread without priority makes messages of them. Messages are CDR with ros2msg schemas, so that any
//! reader of ROS 2 bags decodes them. [`ControllerCycle`] and [`PathCommand`] hold what a replay needs,
//! bit by bit.

mod drive_messages;
pub mod live;
mod mcap_file;
mod messages;
mod reader;
mod scene;
mod schema;
mod tap;

pub use drive_messages::{DriveMessages, GeneralState, unix_ns};
pub use mcap_file::{Header, McapRecording, RecordLimits, RecordingStatus};
pub use messages::{ControllerCycle, LogLine, LoopCycle, PathCommand, Topic};
pub use reader::{Recording, RecordingError, scan};
pub use scene::{Marker, ground};
pub use schema::schema;
pub use tap::{
    ControllerLog, ControllerTap, PathLog, PathRecord, PlanView, RecordedPath, StepRecord, tap,
};

use crate::ros2::node::message::TopicMessage;
#[cfg(test)]
mod tests;

/// A file, a live view, both or neither.
#[derive(Default)]
pub struct Sinks {
    /// The file.
    pub file: Option<McapRecording>,
    /// The live view.
    pub live: Option<live::LiveView>,
}

impl Sinks {
    /// Gives what has waited long enough to the disk.
    pub fn flush_when_due(&mut self) {
        if let Some(file) = &mut self.file {
            file.flush_when_due();
        }
    }

    /// Returns how the recording fares; none without one.
    pub fn status(&self) -> Option<&RecordingStatus> {
        self.file.as_ref().map(McapRecording::status)
    }

    /// Closes the file and ends the view.
    pub fn finish(self) -> Option<RecordingStatus> {
        self.file.map(McapRecording::finish)
    }
}

impl MessageSink for Sinks {
    fn put(&mut self, topic: Topic, time_ns: u64, message: &[u8]) {
        if let Some(file) = &mut self.file {
            file.put(topic, time_ns, message);
        }
        if let Some(live) = &mut self.live {
            live.put(topic, time_ns, message);
        }
    }
}

/// Takes encoded messages.
pub trait MessageSink {
    /// Takes a CDR message of a topic with its time, ns since 1970 or since the start of simulated time.
    fn put(&mut self, topic: Topic, time_ns: u64, message: &[u8]);
}
