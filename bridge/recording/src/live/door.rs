//! The door of the live view: reads what a connection asks for, and serves or refuses it.
//!
//! One thread reads the heads of all requests, without waiting for any: a client that asks for nothing takes no
//! place from others.

use super::client::{Client, serve};
use super::lock::lock;
use super::metrics::Form;
use super::outgoing::Registered;
use super::page::{HTML, PROTOCOL as PAGE_PROTOCOL};
use super::page_client;
use super::protocol::NAMES;
use super::shared::{Kind, Place, Shared};
use std::collections::VecDeque;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::mpsc::sync_channel;
use std::time::{Duration, Instant};
use tungstenite::WebSocket;
use tungstenite::handshake::machine::TryParse;
use tungstenite::handshake::server::{Request, create_response, write_response};
use tungstenite::http::HeaderValue;
use tungstenite::http::header::{ACCEPT, HeaderName, ORIGIN, SEC_WEBSOCKET_PROTOCOL, UPGRADE};
use tungstenite::protocol::{Role, WebSocketConfig};

/// Longest wait for the whole head of a request.
pub(super) const HEAD_WAIT: Duration = Duration::from_secs(3);
/// Longest head of a request, bytes.
const HEAD_MAX: usize = 8192;
/// Connections whose head is waited for; one more replaces the oldest.
const WAITING_MAX: usize = 64;
/// Messages that wait for a client at most.
pub(super) const QUEUE: usize = 1024;
/// Longest message of a client, bytes.
const REQUEST_MAX: usize = 1 << 16;
/// Time between two looks at all connections.
const LOOK: Duration = Duration::from_millis(20);
/// Longest wait for a client that does not take what is sent.
const SEND_WAIT: Duration = Duration::from_secs(2);
/// Longest wait until a client has taken the page.
const PAGE_WAIT: Duration = Duration::from_secs(30);

/// A connection whose head is not yet whole.
struct Waiting {
    stream: TcpStream,
    since: Instant,
    head: Vec<u8>,
    is_local: bool,
}

/// What has come of a connection.
enum Head {
    Partial,
    /// The request, and what follows it.
    Whole(Box<Request>, Vec<u8>),
    Broken,
}

impl Waiting {
    fn read(&mut self) -> Head {
        let mut bytes = [0; 2048];
        loop {
            match self.stream.read(&mut bytes) {
                Ok(0) => return Head::Broken,
                Ok(count) => self.head.extend(&bytes[..count]),
                Err(error) if error.kind() == ErrorKind::WouldBlock => break,
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(_) => return Head::Broken,
            }
            if self.head.len() > HEAD_MAX {
                return Head::Broken;
            }
        }
        match Request::try_parse(&self.head) {
            Ok(Some((length, request))) => {
                Head::Whole(Box::new(request), self.head.split_off(length))
            }
            Ok(None) if self.since.elapsed() < HEAD_WAIT => Head::Partial,
            Ok(None) | Err(_) => Head::Broken,
        }
    }
}

/// Lets clients in until the view ends.
pub(super) fn accept(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut waiting: VecDeque<Waiting> = VecDeque::new();
    while !shared.end.load(Ordering::Relaxed) {
        for _ in 0..WAITING_MAX {
            let Ok((stream, peer)) = listener.accept() else {
                break;
            };
            if stream.set_nonblocking(true).is_err() {
                continue;
            }
            if waiting.len() == WAITING_MAX {
                waiting.pop_front();
            }
            waiting.push_back(Waiting {
                stream,
                since: Instant::now(),
                head: Vec::new(),
                is_local: peer.ip().is_loopback(),
            });
        }
        for mut connection in std::mem::take(&mut waiting) {
            match connection.read() {
                Head::Partial => waiting.push_back(connection),
                Head::Whole(request, rest) => {
                    // An error of a client ends this client only.
                    let _ = answer(connection, &request, rest, shared);
                }
                Head::Broken => {}
            }
        }
        std::thread::sleep(LOOK);
    }
}

/// Serves a request from a thread of its own, or refuses it.
fn answer(
    connection: Waiting,
    request: &Request,
    rest: Vec<u8>,
    shared: &Arc<Shared>,
) -> Result<(), tungstenite::Error> {
    let Waiting {
        mut stream,
        is_local,
        ..
    } = connection;
    if let Some(token) = &shared.token
        && !same(query(request, "token").unwrap_or_default(), token)
    {
        let text = "This live view needs its token: open the address that the program printed, which ends with \
                    ?token= and the token.";
        return refuse(&mut stream, "403 Forbidden", text);
    }
    if !is_upgrade(request) {
        let path = request.uri().path();
        if !["/", "/metrics"].contains(&path) {
            let text = "There are only the page at / and the metrics at /metrics.";
            return refuse(&mut stream, "404 Not Found", text);
        }
        let Some(place) = Place::take(shared, Kind::Download) else {
            return refuse(&mut stream, BUSY, "Too many clients load the page.");
        };
        let answer = match path {
            "/metrics" => metrics(request, shared),
            _ => [&page_head(), HTML].concat(),
        };
        return spawn(move || {
            let _ = give(&mut stream, &answer, &place);
        });
    }
    let offered = request.headers().get_all(SEC_WEBSOCKET_PROTOCOL);
    let offered: Vec<&str> = offered
        .iter()
        .filter_map(|value| value.to_str().ok())
        .flat_map(|value| value.split(','))
        .map(str::trim)
        .collect();
    let known = [NAMES[0], NAMES[1], PAGE_PROTOCOL];
    let Some(name) = known.into_iter().find(|name| offered.contains(name)) else {
        let text = format!("The protocol must be {}.", NAMES.join(" or "));
        return refuse(&mut stream, "400 Bad Request", &text);
    };
    let kind = if name == PAGE_PROTOCOL {
        Kind::Page
    } else {
        Kind::Foxglove
    };
    let Some(place) = Place::take(shared, kind) else {
        return refuse(&mut stream, BUSY, "Too many clients are connected.");
    };
    let mut response = create_response(request)?;
    response
        .headers_mut()
        .insert(SEC_WEBSOCKET_PROTOCOL, HeaderValue::from_static(name));
    let mut head = Vec::new();
    write_response(&mut head, &response)?;
    stream.set_nonblocking(false)?;
    stream.set_write_timeout(Some(SEND_WAIT))?;
    stream.set_nodelay(true)?;
    stream.write_all(&head)?;
    let config = WebSocketConfig::default()
        .max_message_size(Some(REQUEST_MAX))
        .max_frame_size(Some(REQUEST_MAX));
    let socket = WebSocket::from_partially_read(stream, rest, Role::Server, Some(config));
    match kind {
        Kind::Page => {
            let since = query(request, "since").map(str::to_owned);
            spawn(move || page_client::serve(socket, &place, since.as_deref()))
        }
        _ => {
            let client = register(place, is_local && is_own_page(request));
            spawn(move || serve(socket, client))
        }
    }
}

/// Status of what there is no place for.
const BUSY: &str = "503 Service Unavailable";

/// Enters a client into the list of those that messages are sent to.
fn register(place: Place, may_set: bool) -> Client {
    let (queue, messages) = sync_channel(QUEUE);
    let wanted = Arc::new(AtomicU32::new(0));
    let mut clients = lock(&place.shared().clients);
    // The other owner is the client's thread: without it the client has disconnected.
    clients.retain(|client| Arc::strong_count(&client.wanted) > 1);
    clients.push(Registered {
        queue,
        wanted: Arc::clone(&wanted),
    });
    drop(clients);
    Client {
        messages,
        wanted,
        place,
        may_set,
    }
}

fn spawn(serve: impl FnOnce() + Send + 'static) -> Result<(), tungstenite::Error> {
    let thread = std::thread::Builder::new().name("live-client".to_owned());
    thread.spawn(serve)?;
    Ok(())
}

/// Refuses a request; the answer fits into the buffer of any connection, so nothing waits.
fn refuse(stream: &mut TcpStream, status: &str, text: &str) -> Result<(), tungstenite::Error> {
    let head =
        "Content-Type: text/plain; charset=utf-8\r\nCache-Control: no-store\r\nConnection: close";
    let length = text.len() + 1;
    write!(
        stream,
        "HTTP/1.1 {status}\r\n{head}\r\nContent-Length: {length}\r\n\r\n{text}\n"
    )?;
    stream.shutdown(std::net::Shutdown::Write)?;
    Ok(())
}

/// Returns head and text of the metrics.
fn metrics(request: &Request, shared: &Shared) -> String {
    let form = Form::accepted(text(request, &ACCEPT).unwrap_or_default());
    let body = lock(&shared.metrics).text(form);
    format!(
        "HTTP/1.1 200 OK\r\nContent-Type: {}\r\nContent-Length: {}\r\nX-Content-Type-Options: nosniff\r\n\
         Cache-Control: no-store\r\nConnection: close\r\n\r\n{body}",
        form.content_type(),
        body.len()
    )
}

/// Sends an answer, within [`PAGE_WAIT`].
fn give(stream: &mut TcpStream, answer: &str, _place: &Place) -> std::io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_write_timeout(Some(SEND_WAIT))?;
    let since = Instant::now();
    let mut left = answer.as_bytes();
    while !left.is_empty() && since.elapsed() < PAGE_WAIT {
        let count = stream.write(left)?;
        left = &left[count..];
    }
    stream.shutdown(std::net::Shutdown::Write)
}

/// Returns the head before the page. The page may load nothing, speak to no other server, and be in no other page.
fn page_head() -> String {
    let policy = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; img-src data:; \
                  connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";
    format!(
        "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\nContent-Length: {}\r\n\
         Content-Security-Policy: {policy}\r\nReferrer-Policy: no-referrer\r\n\
         X-Content-Type-Options: nosniff\r\nCache-Control: no-store\r\nConnection: close\r\n\r\n",
        HTML.len()
    )
}

fn is_upgrade(request: &Request) -> bool {
    text(request, &UPGRADE).is_some_and(|value| value.eq_ignore_ascii_case("websocket"))
}

fn text<'a>(request: &'a Request, name: &HeaderName) -> Option<&'a str> {
    request.headers().get(name)?.to_str().ok()
}

/// Returns a value of the query of a request as it is written there.
fn query<'a>(request: &'a Request, name: &str) -> Option<&'a str> {
    let query = request.uri().query()?;
    let pairs = query.split('&').filter_map(|pair| pair.split_once('='));
    pairs
        .into_iter()
        .find_map(|(key, value)| (key == name).then_some(value))
}

/// Returns whether two texts are equal, in a time that does not tell where they differ.
fn same(given: &str, token: &str) -> bool {
    let pairs = given.bytes().zip(token.bytes());
    given.len() == token.len() && pairs.fold(0, |all, (a, b)| all | (a ^ b)) == 0
}

/// Returns whether a request comes from a program or from a page that this machine serves: a browser sends the
/// origin of its page, and any page on the web can reach a server on the machine that shows it.
fn is_own_page(request: &Request) -> bool {
    if !request.headers().contains_key(ORIGIN) {
        return true;
    }
    let origin = text(request, &ORIGIN).unwrap_or_default();
    let host = ["http://", "https://"]
        .into_iter()
        .find_map(|scheme| origin.strip_prefix(scheme));
    let own = ["localhost", "127.0.0.1", "[::1]"];
    own.into_iter()
        .filter_map(|name| host?.strip_prefix(name))
        .any(|rest| rest.is_empty() || rest.starts_with(':'))
}
