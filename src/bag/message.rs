//! Topics and messages, whatever file they stand in.

use super::error::BagError;

/// A topic of a bag with messages of one type.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Topic {
    /// Its name, such as `/odom`.
    pub name: String,
    /// Type of its messages, such as `nav_msgs/msg/Odometry`.
    pub message_type: String,
    /// Encoding of its messages; of ROS 2, `cdr`.
    pub encoding: String,
}

/// One message as recorded.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    /// Its topic.
    pub topic: &'a Topic,
    /// When it was recorded, ns since 1970 or since the start of a simulation.
    pub received_ns: i64,
    /// Its bytes in the topic's encoding.
    pub data: &'a [u8],
}

/// What a reader of one file calls for each message; it may end the reading with an error.
pub(super) type Visit<'a> = &'a mut dyn FnMut(Message<'_>) -> Result<(), BagError>;

/// What reading one file found besides its messages.
#[derive(Debug, Default)]
pub(super) struct Outcome {
    /// Topics, those without a message too.
    pub(super) topics: Vec<Topic>,
    /// Why the file ends before its end; none where it is whole.
    pub(super) cut_off: Option<String>,
}
