//! The live view: a page for a browser, and the messages of a drive over the Foxglove WebSocket protocol, on one port.
//!
//! The caller of [`LiveView::put`] never waits: each client has its own thread and a bounded queue or history, and
//! what does not fit is dropped. Clients can look, but have no command over the vehicle: the protocol's messages
//! that would publish or call something are refused, and a page cannot say anything at all. Programs and pages of
//! this machine can set the parameters of a [`ParameterOwner`], which checks them.

mod client;
mod door;
mod lock;
mod metrics;
mod outgoing;
mod page;
mod page_client;
mod parameters;
mod playback;
mod protocol;
mod shared;
mod whole;

use super::messages::Topic;
use super::sink::MessageSink;
use lock::lock;
use outgoing::{Outgoing, Registered, TopicMessage};
use page::Page;
use parameters::LiveParameters;
pub use parameters::{ParameterOwner, SetRequest, Values};
use playback::Playback;
pub use playback::{PlaybackControl, PlaybackRequest, PlaybackState, PlaybackStatus};
use shared::{Kind, Shared};
use sidehill_bridge::safety::Transition;
use sidehill_controller::path::GeodeticOrigin;
use std::net::{SocketAddr, TcpListener};
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
pub use whole::{WholeDrive, components};

/// Where a live view listens, and to whom it answers.
#[derive(Debug, Clone)]
pub struct LiveAddress {
    /// Address and port.
    pub address: SocketAddr,
    /// What `?token=` of a request must be; none: every request is served.
    pub token: Option<String>,
}

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
    pub fn start(address: LiveAddress, fixed: Values) -> Result<Self, std::io::Error> {
        Self::serve(address, fixed, None)
    }

    /// As [`LiveView::start`], for a recording with these first and last times, ns, whose playing clients control.
    ///
    /// # Errors
    /// As [`LiveView::start`].
    pub fn start_playback(
        address: LiveAddress,
        fixed: Values,
        range_ns: [u64; 2],
    ) -> Result<(Self, PlaybackControl), std::io::Error> {
        let (playback, control) = Playback::new(range_ns);
        Ok((Self::serve(address, fixed, Some(playback))?, control))
    }

    fn serve(
        LiveAddress { address, token }: LiveAddress,
        fixed: Values,
        playback: Option<Playback>,
    ) -> Result<Self, std::io::Error> {
        let listener = TcpListener::bind(address)?;
        listener.set_nonblocking(true)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            clients: Mutex::default(),
            latched: Mutex::default(),
            page: Mutex::new(Page::new()),
            metrics: Mutex::default(),
            parameters: Arc::new(LiveParameters::new(fixed)),
            playback,
            token,
            taken: Default::default(),
            dropped: AtomicU64::new(0),
            end: AtomicBool::new(false),
        });
        let accepting = Arc::clone(&shared);
        std::thread::Builder::new()
            .name("live".to_owned())
            .spawn(move || door::accept(&listener, &accepting))?;
        Ok(Self { shared, address })
    }

    /// Returns the address that is listened to.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Has pages show latitude and longitude, by the place on earth of x = 0, y = 0.
    pub fn place(&self, datum: &GeodeticOrigin) {
        lock(&self.shared.page).place(datum);
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

    /// Returns the clients of the Foxglove protocol that are connected.
    pub fn clients(&self) -> usize {
        self.shared.taken[Kind::Foxglove as usize].load(Ordering::Relaxed)
    }

    /// Counts a change of state in the metrics, if it is a stop.
    pub fn transition(&self, transition: &Transition) {
        lock(&self.shared.metrics).transition(transition);
    }

    /// Puts something into the queues of the clients that are to have it.
    fn send(&self, outgoing: &Outgoing, to: impl Fn(&Registered) -> bool) {
        let shared = &self.shared;
        lock(&shared.clients).retain(|client| {
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
        let mut latched = lock(&shared.latched);
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
        lock(&shared.page).take(&message);
        lock(&shared.metrics).take(&message);
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

#[cfg(test)]
mod tests;
