//! Topics and messages, independent of the file format.

use super::error::BagError;

/// A topic of a bag with messages of one type.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct BagTopic {
    /// Its name, such as `/odom`.
    pub name: String,
    /// Type of its messages, such as `nav_msgs/msg/Odometry`.
    pub message_type: String,
    /// Encoding of its messages; `cdr` for ROS 2.
    pub encoding: String,
}

/// One message as recorded.
#[derive(Debug, Clone, Copy)]
pub struct RecordedMessage<'a> {
    /// Its topic.
    pub topic: &'a BagTopic,
    /// When it was recorded, ns since 1970 or since the start of a simulation.
    pub received_ns: i64,
    /// Its bytes in the topic's encoding.
    pub data: &'a [u8],
}

/// Callback for each message of a file; an error ends the reading.
pub(super) type Visit<'a> = &'a mut dyn FnMut(RecordedMessage<'_>) -> Result<(), BagError>;

/// What reading a file found besides its messages.
#[derive(Debug, Default)]
pub(super) struct FileFindings {
    /// Topics, including those without messages.
    pub(super) topics: Vec<BagTopic>,
    /// Why the file is incomplete; none if it is complete.
    pub(super) cut_off: Option<String>,
}
