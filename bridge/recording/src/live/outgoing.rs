//! What is on its way to clients.

use crate::messages::Topic;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;
use std::sync::mpsc::SyncSender;

/// What is on its way to a client.
#[derive(Debug, Clone)]
pub(super) enum Outgoing {
    /// To those who subscribe to its topic.
    Message(TopicMessage),
    /// To every client, as it is.
    ToAll(Arc<[u8]>),
}

/// A message of a topic.
#[derive(Debug, Clone)]
pub(super) struct TopicMessage {
    pub(super) topic: Topic,
    pub(super) time_ns: u64,
    pub(super) message: Arc<[u8]>,
}

/// A client as the view knows it.
pub(super) struct Registered {
    pub(super) queue: SyncSender<Outgoing>,
    /// One bit for each topic that it wants.
    pub(super) wanted: Arc<AtomicU32>,
}
