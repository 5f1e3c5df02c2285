//! Control over the playing of a recording: pause, speed and seek, as `PlaybackControlRequest` and
//! `PlaybackState` of the Foxglove WebSocket protocol (foxglove-sdk, `protocol/common`).

use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Requests that wait for the player.
const REQUESTS: usize = 16;
/// Least and largest speed, as a factor of real time.
const SPEED: [f32; 2] = [0.01, 100.0];
/// First byte of a request.
pub(super) const REQUEST: u8 = 3;
/// First byte of a state.
const STATE: u8 = 5;
/// Bytes of a request before its id: opcode, command, speed, whether it seeks, time, length of the id.
const REQUEST_HEAD: usize = 19;
/// Longest id of a request, bytes.
const ID_MAX: usize = 256;

/// What a client asks of the player.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaybackRequest {
    /// Whether to play rather than to pause.
    pub play: bool,
    /// Speed as a factor of real time, 0.01 to 100.
    pub speed: f32,
    /// Where to go on, ns.
    pub seek_ns: Option<u64>,
    /// Name of the request, by which the state that answers it is known.
    pub id: String,
}

impl PlaybackRequest {
    /// Returns the request of a binary message; none for anything else.
    pub(super) fn parse(bytes: &[u8]) -> Option<Self> {
        let (head, id) = bytes.split_at_checked(REQUEST_HEAD)?;
        let [REQUEST, command @ (0 | 1), rest @ ..] = head else {
            return None;
        };
        let speed = f32::from_le_bytes(rest[..4].try_into().ok()?);
        let seeks = rest[4] != 0;
        let time_ns = u64::from_le_bytes(rest[5..13].try_into().ok()?);
        let length = u32::from_le_bytes(rest[13..].try_into().ok()?) as usize;
        let id = id.get(..length).filter(|id| id.len() <= ID_MAX)?;
        Some(Self {
            play: *command == 0,
            speed: if speed.is_finite() {
                speed.clamp(SPEED[0], SPEED[1])
            } else {
                1.0
            },
            seek_ns: seeks.then_some(time_ns),
            id: std::str::from_utf8(id).ok()?.to_owned(),
        })
    }
}

/// What the player does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PlaybackStatus {
    /// It plays.
    Playing = 0,
    /// It waits for a request to play.
    Paused = 1,
    /// It has reached the end.
    Ended = 3,
}

/// What the player sends to its clients.
#[derive(Debug, Clone, PartialEq)]
pub struct PlaybackState {
    /// What it does.
    pub status: PlaybackStatus,
    /// Time of the recording, ns.
    pub time_ns: u64,
    /// Speed as a factor of real time.
    pub speed: f32,
    /// Whether the time has changed because a client sought.
    pub sought: bool,
    /// Name of the request that this answers; empty where none was made.
    pub id: String,
}

impl PlaybackState {
    fn bytes(&self) -> Vec<u8> {
        let mut bytes = vec![STATE, self.status as u8];
        bytes.extend(self.time_ns.to_le_bytes());
        bytes.extend(self.speed.to_le_bytes());
        bytes.push(u8::from(self.sought));
        bytes.extend((self.id.len() as u32).to_le_bytes());
        bytes.extend(self.id.as_bytes());
        bytes
    }
}

/// The player's end.
pub struct PlaybackControl(Receiver<PlaybackRequest>);

impl PlaybackControl {
    /// Waits for the next request, no longer than `wait`.
    pub fn next_request(&self, wait: Duration) -> Option<PlaybackRequest> {
        match self.0.recv_timeout(wait) {
            Ok(request) => Some(request),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                std::thread::sleep(wait);
                None
            }
        }
    }
}

/// The clients' end.
pub(super) struct Playback {
    /// First and last time of the recording, ns.
    pub(super) range_ns: [u64; 2],
    requests: SyncSender<PlaybackRequest>,
    state: Mutex<Arc<[u8]>>,
}

impl Playback {
    pub(super) fn new(range_ns: [u64; 2]) -> (Self, PlaybackControl) {
        let (requests, arriving) = sync_channel(REQUESTS);
        let state = PlaybackState {
            status: PlaybackStatus::Playing,
            time_ns: range_ns[0],
            speed: 1.0,
            sought: false,
            id: String::new(),
        };
        let playback = Self {
            range_ns,
            requests,
            state: Mutex::new(state.bytes().into()),
        };
        (playback, PlaybackControl(arriving))
    }

    /// Passes a request on; one that finds no place is lost, and so is not answered.
    pub(super) fn request(&self, request: PlaybackRequest) {
        let _ = self.requests.try_send(request);
    }

    /// Returns the newest state as it is sent.
    pub(super) fn state(&self) -> Arc<[u8]> {
        Arc::clone(&self.state.lock().unwrap_or_else(PoisonError::into_inner))
    }

    /// Keeps a state for clients that come later, and returns it as it is sent.
    pub(super) fn set_state(&self, state: &PlaybackState) -> Arc<[u8]> {
        let bytes: Arc<[u8]> = state.bytes().into();
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = Arc::clone(&bytes);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn requests_and_states_have_the_layout_of_the_protocol() {
        // `playback_control_request_encode_play_with_seek` of foxglove-sdk.
        let mut bytes = vec![3, 0];
        bytes.extend(1.5_f32.to_le_bytes());
        bytes.push(1);
        bytes.extend(100_500_000_000_u64.to_le_bytes());
        bytes.extend(7_u32.to_le_bytes());
        bytes.extend(b"some-id");
        let request = PlaybackRequest {
            play: true,
            speed: 1.5,
            seek_ns: Some(100_500_000_000),
            id: "some-id".to_owned(),
        };
        assert_eq!(PlaybackRequest::parse(&bytes), Some(request));
        for length in 0..bytes.len() {
            assert_eq!(PlaybackRequest::parse(&bytes[..length]), None);
        }
        bytes[1] = 2;
        assert_eq!(PlaybackRequest::parse(&bytes), None);
        let state = PlaybackState {
            status: PlaybackStatus::Ended,
            time_ns: 12_345,
            speed: 1.0,
            sought: true,
            id: "id".to_owned(),
        };
        let expected = [
            &[5, 3][..],
            &12_345_u64.to_le_bytes(),
            &1.0_f32.to_le_bytes(),
            &[1],
            &2_u32.to_le_bytes(),
            b"id",
        ];
        assert_eq!(state.bytes(), expected.concat());
    }

    #[test]
    fn a_speed_that_cannot_be_is_another() {
        let with = |speed: f32| {
            let mut bytes = vec![3, 1];
            bytes.extend(speed.to_le_bytes());
            bytes.extend([0; 13]);
            PlaybackRequest::parse(&bytes).unwrap().speed
        };
        assert_eq!([f32::NAN, -3.0, 1e9].map(with), [1.0, 0.01, 100.0]);
    }
}
