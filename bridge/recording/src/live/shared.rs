//! What the threads of the live view share.

use super::parameters::LiveParameters;
use super::playback::Playback;
use crate::messages::Topic;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize};
use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex, PoisonError};

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

/// What the threads of the view share.
pub(super) struct Shared {
    pub(super) clients: Mutex<Vec<Registered>>,
    /// Messages that a client gets when it subscribes: the newest path, and the scene that stays.
    pub(super) latched: Mutex<BTreeMap<Topic, TopicMessage>>,
    pub(super) parameters: Arc<LiveParameters>,
    /// Control over what is played; none where nothing is.
    pub(super) playback: Option<Playback>,
    pub(super) connections: AtomicUsize,
    pub(super) dropped: AtomicU64,
    pub(super) end: AtomicBool,
}

/// A client as the view knows it.
pub(super) struct Registered {
    pub(super) queue: SyncSender<Outgoing>,
    /// One bit for each topic that it wants.
    pub(super) wanted: Arc<AtomicU32>,
}

impl Shared {
    pub(super) fn latched(&self, topic: Topic) -> Option<TopicMessage> {
        let latched = self.latched.lock().unwrap_or_else(PoisonError::into_inner);
        latched.get(&topic).cloned()
    }
}
