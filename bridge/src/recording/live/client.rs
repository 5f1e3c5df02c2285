//! One client of the live view, in a thread of its own.

use super::protocol::{self, NAMES, Request, Subscription};
use super::shared::{Outgoing, Shared};
use crate::recording::messages::Topic;
use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::Receiver;
use std::time::Duration;
use tungstenite::handshake::server::{ErrorResponse, Request as Upgrade, Response};
use tungstenite::http::HeaderValue;
use tungstenite::http::header::SEC_WEBSOCKET_PROTOCOL;
use tungstenite::protocol::WebSocketConfig;
use tungstenite::{Error, Message, WebSocket, accept_hdr_with_config};

/// Longest wait for a client's first words, and for a client that does not take what is sent.
const PATIENCE: Duration = Duration::from_secs(2);
/// Longest wait for a client's next words, and so of a message for the client.
const TICK: Duration = Duration::from_millis(20);
/// Longest message of a client, bytes.
const REQUEST_MAX: usize = 1 << 16;

pub(super) struct Client {
    pub(super) messages: Receiver<Outgoing>,
    /// One bit for each topic that is wanted.
    pub(super) wanted: Arc<AtomicU32>,
    pub(super) shared: Arc<Shared>,
}

/// Serves a client until it leaves, breaks the protocol or does not take what is sent.
pub(super) fn serve(stream: TcpStream, mut client: Client) {
    // Whatever goes wrong with a client ends it and nothing else.
    let _ = client.serve(stream);
    client.wanted.store(0, Ordering::Relaxed);
}

impl Client {
    fn serve(&mut self, stream: TcpStream) -> Result<(), Error> {
        stream.set_nonblocking(false)?;
        stream.set_read_timeout(Some(PATIENCE))?;
        stream.set_write_timeout(Some(PATIENCE))?;
        stream.set_nodelay(true)?;
        let config = WebSocketConfig::default()
            .max_message_size(Some(REQUEST_MAX))
            .max_frame_size(Some(REQUEST_MAX));
        let mut socket = accept_hdr_with_config(stream, choose_protocol, Some(config))
            .map_err(|_| Error::ConnectionClosed)?;
        socket.get_ref().set_read_timeout(Some(TICK))?;
        for text in protocol::greeting() {
            socket.send(Message::text(text))?;
        }
        let mut subscriptions: BTreeMap<u32, Topic> = BTreeMap::new();
        while !self.shared.end.load(Ordering::Relaxed) {
            match socket.read() {
                Ok(Message::Text(text)) => {
                    self.answer(&mut socket, text.as_str(), &mut subscriptions)?;
                }
                Ok(Message::Binary(_)) => {
                    let reason = "this server shows only: nothing can be published or called";
                    socket.send(Message::text(protocol::refusal(reason)))?;
                }
                Ok(_) => {}
                Err(Error::Io(error))
                    if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
                Err(error) => return Err(error),
            }
            while let Ok(outgoing) = self.messages.try_recv() {
                send(&mut socket, &subscriptions, &outgoing)?;
            }
        }
        socket.close(None)
    }

    fn answer(
        &self,
        socket: &mut WebSocket<TcpStream>,
        text: &str,
        subscriptions: &mut BTreeMap<u32, Topic>,
    ) -> Result<(), Error> {
        let reply = match serde_json::from_str(text) {
            Ok(Request::Subscribe {
                subscriptions: wanted,
            }) => {
                for Subscription { id, channel_id } in wanted {
                    let Some(topic) = protocol::topic(channel_id) else {
                        continue;
                    };
                    subscriptions.insert(id, topic);
                    if let Some(latched) = self.shared.latched(topic) {
                        let bytes = protocol::data(id, latched.time_ns, &latched.message);
                        socket.send(Message::binary(bytes))?;
                    }
                    if subscriptions.len() > 2 * Topic::ALL.len() {
                        return Err(Error::ConnectionClosed);
                    }
                }
                None
            }
            Ok(Request::Unsubscribe { subscription_ids }) => {
                for id in subscription_ids {
                    subscriptions.remove(&id);
                }
                None
            }
            Ok(Request::GetParameters {
                parameter_names,
                id,
            }) => Some(protocol::parameters(&self.shared, &parameter_names, id)),
            Ok(Request::SetParameters { id }) => {
                let reason = "the parameters of this server cannot be set";
                socket.send(Message::text(protocol::refusal(reason)))?;
                Some(protocol::parameters(&self.shared, &[], id))
            }
            Ok(Request::SubscribeParameterUpdates {} | Request::UnsubscribeParameterUpdates {}) => {
                None
            }
            Err(_) => Some(protocol::refusal("this server does not do that")),
        };
        let bits = subscriptions.values().map(|topic| protocol::bit(*topic));
        let wanted = bits.fold(0, |all, bit| all | bit);
        self.wanted.store(wanted, Ordering::Relaxed);
        match reply {
            Some(reply) => socket.send(Message::text(reply)),
            None => Ok(()),
        }
    }
}

fn send(
    socket: &mut WebSocket<TcpStream>,
    subscriptions: &BTreeMap<u32, Topic>,
    outgoing: &Outgoing,
) -> Result<(), Error> {
    for (id, topic) in subscriptions {
        if *topic == outgoing.topic {
            let bytes = protocol::data(*id, outgoing.time_ns, &outgoing.message);
            socket.send(Message::binary(bytes))?;
        }
    }
    Ok(())
}

/// Chooses the protocol among those that the client offers.
#[allow(clippy::result_large_err)]
fn choose_protocol(request: &Upgrade, mut response: Response) -> Result<Response, ErrorResponse> {
    let offered = request.headers().get_all(SEC_WEBSOCKET_PROTOCOL);
    let offered: Vec<&str> = offered
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .collect();
    let Some(name) = NAMES.into_iter().find(|name| offered.contains(name)) else {
        let reason = format!("the protocol must be {}", NAMES.join(" or "));
        let mut refused = ErrorResponse::new(Some(reason));
        *refused.status_mut() = tungstenite::http::StatusCode::BAD_REQUEST;
        return Err(refused);
    };
    let headers = response.headers_mut();
    headers.insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(name));
    Ok(response)
}
