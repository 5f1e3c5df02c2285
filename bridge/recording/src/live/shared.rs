//! What the threads of the live view share.

use super::lock::lock;
use super::metrics::Metrics;
use super::outgoing::{Registered, TopicMessage};
use super::page::Page;
use super::parameters::LiveParameters;
use super::playback::Playback;
use crate::messages::Topic;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

/// What the threads of the view share.
pub(super) struct Shared {
    pub(super) clients: Mutex<Vec<Registered>>,
    /// Messages that a client gets when it subscribes: the newest path, and the scene that stays.
    pub(super) latched: Mutex<BTreeMap<Topic, TopicMessage>>,
    pub(super) page: Mutex<Page>,
    pub(super) metrics: Mutex<Metrics>,
    pub(super) parameters: Arc<LiveParameters>,
    /// Control over what is played; none where nothing is.
    pub(super) playback: Option<Playback>,
    /// What a client has to know to be served; none where every client is.
    pub(super) token: Option<String>,
    /// Places that are taken, by [`Kind`].
    pub(super) taken: [AtomicUsize; 3],
    pub(super) dropped: AtomicU64,
    pub(super) end: AtomicBool,
}

/// Kinds of clients; none takes a place from another kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// Of the Foxglove protocol.
    Foxglove,
    /// A page that is shown.
    Page,
    /// A page or metrics on their way.
    Download,
}

/// Clients of a kind at a time.
pub(super) const CLIENTS_MAX: usize = 16;

/// The place of a client, free again when it is dropped.
pub(super) struct Place {
    shared: Arc<Shared>,
    kind: Kind,
}

impl Place {
    /// Takes a place; none where all of the kind are taken.
    pub(super) fn take(shared: &Arc<Shared>, kind: Kind) -> Option<Self> {
        let place = Self {
            shared: Arc::clone(shared),
            kind,
        };
        // Dropped where there is none, it gives back what it took.
        let before = shared.taken[kind as usize].fetch_add(1, Ordering::Relaxed);
        (before < CLIENTS_MAX).then_some(place)
    }

    pub(super) fn shared(&self) -> &Arc<Shared> {
        &self.shared
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.shared.taken[self.kind as usize].fetch_sub(1, Ordering::Relaxed);
    }
}

impl Shared {
    pub(super) fn latched(&self, topic: Topic) -> Option<TopicMessage> {
        lock(&self.latched).get(&topic).cloned()
    }
}
