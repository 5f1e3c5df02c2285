//! A page of the live view that is shown, in its own thread.
//!
//! A page says nothing, so it can command nothing; the answers of its socket to pings say how much its link takes.

use super::lock::lock;
use super::page::Reader;
use super::shared::Place;
use std::io::ErrorKind;
use std::net::TcpStream;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};
use tungstenite::{Bytes, Error, Message, WebSocket};

/// Shortest time between two messages to a page, and longest.
const PERIOD: Duration = Duration::from_millis(200);
const HEARTBEAT: Duration = Duration::from_secs(1);
/// Longest wait for the end of the last message at the page.
const LINK_WAIT: Duration = Duration::from_secs(30);
/// Serves a page until it leaves, says something or does not take what is sent. `since` is what it has from an earlier
/// connection.
pub(super) fn serve(mut socket: WebSocket<TcpStream>, place: &Place, since: Option<&str>) {
    // Any error of a client ends this client only.
    let _ = show(&mut socket, place, since);
}

fn show(
    socket: &mut WebSocket<TcpStream>,
    place: &Place,
    since: Option<&str>,
) -> Result<(), Error> {
    socket.get_ref().set_read_timeout(Some(PERIOD / 4))?;
    let shared = place.shared();
    let mut reader = Reader::new(since);
    let mut sent: Option<Instant> = None;
    let mut taken = true;
    while !shared.end.load(Ordering::Relaxed) {
        match socket.read() {
            Ok(Message::Pong(_)) => taken = true,
            Ok(Message::Ping(_)) => {}
            Ok(_) => return socket.close(None),
            Err(Error::Io(error))
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(error) => return Err(error),
        }
        let waited = sent.map(|sent| sent.elapsed());
        if !taken {
            if waited > Some(LINK_WAIT) {
                return Err(Error::ConnectionClosed);
            }
            continue;
        }
        if waited.is_some_and(|waited| waited < PERIOD) {
            continue;
        }
        let text = reader.next(&lock(&shared.page));
        let Some(text) = text.or_else(|| (waited >= Some(HEARTBEAT)).then(|| "{}".to_owned()))
        else {
            continue;
        };
        socket.send(Message::text(text))?;
        // The page has taken the text when its socket answers.
        socket.send(Message::Ping(Bytes::new()))?;
        (sent, taken) = (Some(Instant::now()), false);
    }
    socket.close(None)
}
