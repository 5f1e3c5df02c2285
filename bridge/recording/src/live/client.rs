//! One client of the live view, in its own thread.

use super::outgoing::Outgoing;
use super::parameters::Values;
use super::playback::PlaybackRequest;
use super::protocol::{self, ClientRequest, ShownParameter, Subscription};
use super::shared::{Place, Shared};
use crate::messages::Topic;
use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::Receiver;
use std::time::{Duration, Instant};
use tungstenite::{Bytes, Error, Message, WebSocket};

/// Longest wait for a client's next words, and so of a message for the client.
const TICK: Duration = Duration::from_millis(20);
/// Time without a word from a client after which it is asked whether it is there, and after which it is not.
const ASK_AFTER: Duration = Duration::from_secs(5);
const GONE_AFTER: Duration = Duration::from_secs(20);

pub(super) struct Client {
    pub(super) messages: Receiver<Outgoing>,
    /// One bit for each topic that is wanted.
    pub(super) wanted: Arc<AtomicU32>,
    pub(super) place: Place,
    /// Whether it may set parameters.
    pub(super) may_set: bool,
}

/// Serves a client until it leaves, breaks the protocol or does not take what is sent.
pub(super) fn serve(socket: WebSocket<TcpStream>, mut client: Client) {
    // Any error of a client ends this client only.
    let _ = client.serve(socket);
    client.wanted.store(0, Ordering::Relaxed);
}

impl Client {
    fn serve(&mut self, socket: WebSocket<TcpStream>) -> Result<(), Error> {
        socket.get_ref().set_read_timeout(Some(TICK))?;
        let shared = Arc::clone(self.place.shared());
        let mut session = Session {
            socket,
            may_set: self.may_set,
            subscriptions: BTreeMap::new(),
            watched: BTreeSet::new(),
            told: Values::new(),
            version: shared.parameters.version(),
        };
        session.greet(&shared)?;
        let (mut heard, mut asked) = (Instant::now(), false);
        while !shared.end.load(Ordering::Relaxed) {
            let word = session.socket.read();
            if word.is_ok() {
                (heard, asked) = (Instant::now(), false);
            }
            match word {
                Ok(Message::Text(text)) => session.answer(&shared, text.as_str())?,
                Ok(Message::Binary(bytes)) => session.answer_binary(&shared, &bytes)?,
                Ok(_) => {}
                Err(Error::Io(error))
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) => return Err(error),
            }
            if heard.elapsed() > GONE_AFTER {
                return Err(Error::ConnectionClosed);
            }
            if heard.elapsed() > ASK_AFTER && !asked {
                asked = true;
                session.socket.send(Message::Ping(Bytes::new()))?;
            }
            self.wanted.store(session.wanted(), Ordering::Relaxed);
            while let Ok(outgoing) = self.messages.try_recv() {
                session.send(&outgoing)?;
            }
            session.tell_changes(&shared)?;
        }
        session.socket.close(None)
    }
}

/// What a client has requested so far.
struct Session {
    socket: WebSocket<TcpStream>,
    /// Whether it may set parameters.
    may_set: bool,
    subscriptions: BTreeMap<u32, Topic>,
    /// Parameters whose changes it subscribes to.
    watched: BTreeSet<String>,
    /// Values of these that it knows.
    told: Values,
    /// Version of the parameters that it knows.
    version: u64,
}

impl Session {
    fn greet(&mut self, shared: &Shared) -> Result<(), Error> {
        let playback = shared.playback.as_ref();
        for text in protocol::greeting(playback.map(|playback| playback.range_ns)) {
            self.say(text)?;
        }
        match playback {
            Some(playback) => self.socket.send(Message::binary(playback.state().to_vec())),
            None => Ok(()),
        }
    }

    fn say(&mut self, text: String) -> Result<(), Error> {
        self.socket.send(Message::text(text))
    }

    /// Returns one bit for each topic that is wanted.
    fn wanted(&self) -> u32 {
        let bits = self
            .subscriptions
            .values()
            .map(|topic| protocol::bit(*topic));
        bits.fold(0, |all, bit| all | bit)
    }

    fn answer_binary(&mut self, shared: &Shared, bytes: &[u8]) -> Result<(), Error> {
        match (&shared.playback, PlaybackRequest::parse(bytes)) {
            (Some(playback), Some(request)) => {
                playback.request(request);
                Ok(())
            }
            _ => {
                let reason = "this server shows only: nothing can be published or called";
                self.say(protocol::refusal(reason))
            }
        }
    }

    fn answer(&mut self, shared: &Shared, text: &str) -> Result<(), Error> {
        match serde_json::from_str(text) {
            Ok(ClientRequest::Subscribe { subscriptions }) => {
                self.subscribe(shared, &subscriptions)
            }
            Ok(ClientRequest::Unsubscribe { subscription_ids }) => {
                for id in subscription_ids {
                    self.subscriptions.remove(&id);
                }
                Ok(())
            }
            Ok(ClientRequest::GetParameters {
                parameter_names,
                id,
            }) => self.say(protocol::parameters(
                &shared.parameters,
                &parameter_names,
                id,
            )),
            Ok(ClientRequest::SetParameters { parameters, id }) => self.set(shared, parameters, id),
            Ok(ClientRequest::SubscribeParameterUpdates { parameter_names }) => {
                let known = shared.parameters.values(&[]);
                let known = parameter_names
                    .into_iter()
                    .filter(|name| known.contains_key(name));
                self.watched.extend(known);
                self.told = self.watched_values(shared);
                Ok(())
            }
            Ok(ClientRequest::UnsubscribeParameterUpdates { parameter_names }) => {
                for name in parameter_names {
                    self.watched.remove(&name);
                }
                Ok(())
            }
            Err(_) => self.say(protocol::refusal("this server does not do that")),
        }
    }

    fn subscribe(&mut self, shared: &Shared, wanted: &[Subscription]) -> Result<(), Error> {
        for Subscription { id, channel_id } in wanted {
            let Some(topic) = protocol::topic(*channel_id) else {
                continue;
            };
            self.subscriptions.insert(*id, topic);
            if let Some(latched) = shared.latched(topic) {
                let bytes = protocol::data(*id, latched.time_ns, &latched.message);
                self.socket.send(Message::binary(bytes))?;
            }
            if self.subscriptions.len() > 2 * Topic::ALL.len() {
                return Err(Error::ConnectionClosed);
            }
        }
        Ok(())
    }

    /// Has the owner set parameters, all or none, and sends their new values.
    fn set(
        &mut self,
        shared: &Shared,
        parameters: Vec<ShownParameter>,
        id: Option<String>,
    ) -> Result<(), Error> {
        let values: Values = parameters
            .into_iter()
            .map(|parameter| (parameter.name, parameter.value))
            .collect();
        let names: Vec<String> = values.keys().cloned().collect();
        let result = if self.may_set {
            shared.parameters.set(values)
        } else {
            Err(
                "parameters are set from the vehicle's own machine, by a program or page of it"
                    .to_owned(),
            )
        };
        if let Err(reason) = result {
            self.say(protocol::refusal(&reason))?;
        }
        // Without names it would be all.
        if names.is_empty() {
            return Ok(());
        }
        self.say(protocol::parameters(&shared.parameters, &names, id))
    }

    fn watched_values(&self, shared: &Shared) -> Values {
        let mut values = shared.parameters.values(&[]);
        values.retain(|name, _| self.watched.contains(name));
        values
    }

    /// Tells which of the watched parameters have changed.
    fn tell_changes(&mut self, shared: &Shared) -> Result<(), Error> {
        let version = shared.parameters.version();
        if self.version == version {
            return Ok(());
        }
        self.version = version;
        let now = self.watched_values(shared);
        let mut changed = now.clone();
        changed.retain(|name, value| self.told.get(name) != Some(value));
        self.told = now;
        if changed.is_empty() {
            return Ok(());
        }
        self.say(protocol::parameter_values(&changed, None))
    }

    fn send(&mut self, outgoing: &Outgoing) -> Result<(), Error> {
        let message = match outgoing {
            Outgoing::Message(message) => message,
            Outgoing::ToAll(bytes) => return self.socket.send(Message::binary(bytes.to_vec())),
        };
        for (id, topic) in &self.subscriptions {
            if *topic == message.topic {
                let bytes = protocol::data(*id, message.time_ns, &message.message);
                self.socket.send(Message::binary(bytes))?;
            }
        }
        Ok(())
    }
}
