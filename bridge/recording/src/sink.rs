//! Where messages go.

use super::messages::Topic;

/// Takes encoded messages.
pub trait MessageSink {
    /// Takes a CDR message of a topic with its time, ns since 1970 or since the start of simulated time.
    fn put(&mut self, topic: Topic, time_ns: u64, message: &[u8]);
}
