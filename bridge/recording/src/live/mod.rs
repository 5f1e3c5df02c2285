//! The live view: the messages of a drive over the Foxglove WebSocket protocol.
//!
//! The caller of [`LiveView::put`] never waits: each client has a bounded queue and its own thread, and
//! what does not fit into a queue is dropped. Clients can look, but have no command over the vehicle: the
//! protocol's messages that would publish or call something are refused. Clients on this machine can set the
//! parameters of a [`ParameterOwner`], which checks them.

mod client;
mod parameters;
mod playback;
mod protocol;
mod shared;

use super::messages::Topic;
use super::sink::MessageSink;
use client::{Client, serve};
use parameters::LiveParameters;
pub use parameters::{ParameterOwner, SetRequest, Values};
use playback::Playback;
pub use playback::{PlaybackControl, PlaybackRequest, PlaybackState, PlaybackStatus};
use shared::{Outgoing, Registered, Shared, TopicMessage};
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Clients at a time, those that have not yet said what they want among them.
const CLIENTS_MAX: usize = 16;
/// Messages that wait for a client at most.
const QUEUE: usize = 1024;
/// Longest wait for a client that comes.
const ACCEPT_WAIT: Duration = Duration::from_millis(50);

/// Serves the live view until it is dropped.
pub struct LiveView {
    shared: Arc<Shared>,
    address: SocketAddr,
}

impl LiveView {
    /// Listens on an address and starts the thread that accepts clients; `fixed` are parameters that are shown
    /// and cannot be set.
    ///
    /// # Errors
    /// The system's, where the address cannot be listened to or no thread is left.
    pub fn start(address: SocketAddr, fixed: Values) -> Result<Self, std::io::Error> {
        Self::serve(address, fixed, None)
    }

    /// As [`LiveView::start`], for a recording with these first and last times, ns, whose playing clients control.
    ///
    /// # Errors
    /// As [`LiveView::start`].
    pub fn start_playback(
        address: SocketAddr,
        fixed: Values,
        range_ns: [u64; 2],
    ) -> Result<(Self, PlaybackControl), std::io::Error> {
        let (playback, control) = Playback::new(range_ns);
        Ok((Self::serve(address, fixed, Some(playback))?, control))
    }

    fn serve(
        address: SocketAddr,
        fixed: Values,
        playback: Option<Playback>,
    ) -> Result<Self, std::io::Error> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            clients: Mutex::default(),
            latched: Mutex::default(),
            parameters: Arc::new(LiveParameters::new(fixed)),
            playback,
            connections: AtomicUsize::new(0),
            dropped: AtomicU64::new(0),
            end: AtomicBool::new(false),
        });
        let accepting = Arc::clone(&shared);
        std::thread::Builder::new()
            .name("live".to_owned())
            .spawn(move || accept(&listener, &accepting))?;
        Ok(Self { shared, address })
    }

    /// Returns the address that is listened to.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Returns the owner's end of the parameters that clients can set.
    pub fn parameter_owner(&self) -> ParameterOwner {
        self.shared.parameters.owner()
    }

    /// Tells every client what the player does. Only where there is playback control.
    pub fn tell(&self, state: &PlaybackState) {
        if let Some(playback) = &self.shared.playback {
            let bytes = playback.set_state(state);
            self.send(&Outgoing::ToAll(bytes), |_| true);
        }
    }

    /// Returns the clients that are connected.
    pub fn clients(&self) -> usize {
        self.shared.connections.load(Ordering::Relaxed)
    }

    /// Puts something into the queues of the clients that are to have it.
    fn send(&self, outgoing: &Outgoing, to: impl Fn(&Registered) -> bool) {
        let shared = &self.shared;
        let mut clients = shared
            .clients
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        clients.retain(|client| {
            if !to(client) {
                return true;
            }
            match client.queue.try_send(outgoing.clone()) {
                Ok(()) => true,
                Err(std::sync::mpsc::TrySendError::Full(_)) => {
                    shared.dropped.fetch_add(1, Ordering::Relaxed);
                    true
                }
                Err(std::sync::mpsc::TrySendError::Disconnected(_)) => false,
            }
        });
    }

    /// Returns the messages that found the queue of a client full.
    pub fn dropped(&self) -> u64 {
        self.shared.dropped.load(Ordering::Relaxed)
    }
}

impl MessageSink for LiveView {
    fn put(&mut self, topic: Topic, time_ns: u64, message: &[u8]) {
        let shared = &self.shared;
        let message = TopicMessage {
            topic,
            time_ns,
            message: message.into(),
        };
        let mut latched = shared
            .latched
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        match topic {
            Topic::Path => {
                latched.insert(topic, message.clone());
            }
            Topic::Scene => {
                latched.entry(topic).or_insert_with(|| message.clone());
            }
            _ => {}
        }
        drop(latched);
        self.send(&Outgoing::Message(message), |client| {
            client.wanted.load(Ordering::Relaxed) & protocol::bit(topic) != 0
        });
    }
}

impl Drop for LiveView {
    fn drop(&mut self) {
        self.shared.end.store(true, Ordering::Relaxed);
    }
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    while !shared.end.load(Ordering::Relaxed) {
        let Ok((stream, peer)) = listener.accept() else {
            std::thread::sleep(ACCEPT_WAIT);
            continue;
        };
        if shared.connections.fetch_add(1, Ordering::Relaxed) >= CLIENTS_MAX {
            shared.connections.fetch_sub(1, Ordering::Relaxed);
            continue;
        }
        let (queue, messages) = sync_channel(QUEUE);
        let wanted = Arc::new(AtomicU32::new(0));
        let client = Client {
            messages,
            wanted: Arc::clone(&wanted),
            shared: Arc::clone(shared),
            is_local: peer.ip().is_loopback(),
        };
        let mut clients = shared
            .clients
            .lock()
            .unwrap_or_else(PoisonError::into_inner);
        // The other owner is the client's thread: without it the client has disconnected.
        clients.retain(|client| Arc::strong_count(&client.wanted) > 1);
        clients.push(Registered { queue, wanted });
        drop(clients);
        let counted = Arc::clone(shared);
        let thread = std::thread::Builder::new()
            .name("live-client".to_owned())
            .spawn(move || {
                serve(stream, client);
                counted.connections.fetch_sub(1, Ordering::Relaxed);
            });
        if thread.is_err() {
            shared.connections.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

#[cfg(test)]
mod tests;
