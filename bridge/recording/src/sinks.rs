//! The sinks of a drive together.

use super::live::LiveView;
use super::mcap_file::{McapRecording, RecordingStatus};
use super::messages::Topic;
use super::sink::MessageSink;

/// A file, a live view, both or neither.
#[derive(Default)]
pub struct Sinks {
    /// The file.
    pub file: Option<McapRecording>,
    /// The live view.
    pub live: Option<LiveView>,
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
