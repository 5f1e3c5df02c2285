//! A SocketCAN interface: one thread that listens, one sender that never waits.

use crate::can::frame::{Frame, FrameId};
use crate::clock::Epoch;
use crate::safety::BusState;
use socketcan::embedded_can::{ExtendedId, Frame as _, Id, StandardId};
use socketcan::errors::{CanError, ControllerProblems, ErrorCause};
use socketcan::{
    CanDataFrame, CanErrorFrame, CanFilter, CanFrame, CanInterface, CanSocket, Socket,
    SocketOptions,
};
use std::io::{Error, ErrorKind};
use std::os::unix::thread::JoinHandleExt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;
use thread_priority::ThreadId;

const ENXIO: i32 = 6;
const ENODEV: i32 = 19;
const ENETDOWN: i32 = 100;
const ENOBUFS: i32 = 105;

/// How long a read waits before the interface is looked at.
const READ_TIMEOUT: Duration = Duration::from_millis(20);
/// How often the interface is looked at while frames come.
const POLL_S: f64 = 0.05;
/// First and longest pause between attempts to open an interface or to restart it.
const BACKOFF_S: [f64; 2] = [0.05, 2.0];
/// Restarts after a bus-off before a person has to look.
const RESTARTS_MAX: u32 = 8;

/// What a listener hears.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Heard {
    /// A data frame that arrived.
    Frame {
        /// When, s.
        time_s: f64,
        /// The frame.
        frame: Frame,
    },
    /// The state of the bus has changed.
    Bus {
        /// When, s.
        time_s: f64,
        /// The new state.
        state: BusState,
    },
    /// A restart of the interface after a bus-off was tried.
    Restart {
        /// When, s.
        time_s: f64,
        /// How many were tried since the bus was left.
        attempt: u32,
        /// What the system said.
        answer: RestartAnswer,
    },
}

/// What the system says to a restart of the interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RestartAnswer {
    /// It has been done.
    Accepted,
    /// It has been refused, for want of permission or because the driver cannot.
    Refused {
        /// Error number.
        errno: i32,
    },
    /// There was no answer that could be understood.
    None,
}

impl RestartAnswer {
    fn refused(errno: Option<i32>) -> Self {
        errno.map_or(Self::None, |errno| Self::Refused { errno })
    }
}

/// Why a frame was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SendFault {
    /// The interface's queue is full; the frame is dropped, since a later one is newer.
    #[error("the queue of the interface is full")]
    QueueFull,
    /// The interface is down.
    #[error("the interface is down")]
    Down,
    /// There is no interface, or it cannot be opened.
    #[error("there is no such interface, or no permission to use it")]
    Absent,
    /// The frame's values do not fit.
    #[error("the command does not fit its signals")]
    Values,
    /// Another error of the system.
    #[error("system error {errno}")]
    System {
        /// Its number.
        errno: i32,
    },
}

impl From<crate::can::message::FrameFault> for SendFault {
    fn from(_: crate::can::message::FrameFault) -> Self {
        Self::Values
    }
}

/// Sends frames without waiting. Sockets are opened and closed by a thread of its own: while an
/// interface disappears, the kernel keeps both waiting.
pub struct Sender {
    socket: Option<CanSocket>,
    closed: mpsc::Sender<CanSocket>,
    opened: mpsc::Receiver<CanSocket>,
    thread: Option<JoinHandle<()>>,
    stop: Arc<AtomicBool>,
}

impl Sender {
    /// Returns a sender for an interface that need not exist yet.
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(interface: &str) -> Result<Self, Error> {
        let (closed, to_close) = mpsc::channel();
        let (ready, opened) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let socket = open_sender(interface).ok();
        let (ended, interface) = (Arc::clone(&stop), interface.to_owned());
        let mut wanted = socket.is_none();
        let thread = std::thread::Builder::new()
            .name("can-opener".to_owned())
            .spawn(move || {
                let mut backoff_s = BACKOFF_S[0];
                while !ended.load(Ordering::Relaxed) {
                    let pause = Duration::from_secs_f64(backoff_s);
                    match to_close.recv_timeout(pause) {
                        Ok(socket) => {
                            drop(socket);
                            wanted = true;
                            backoff_s = BACKOFF_S[0];
                        }
                        Err(mpsc::RecvTimeoutError::Timeout) => {}
                        Err(mpsc::RecvTimeoutError::Disconnected) => return,
                    }
                    if !wanted {
                        continue;
                    }
                    match open_sender(&interface) {
                        Ok(socket) => {
                            wanted = false;
                            backoff_s = BACKOFF_S[0];
                            if ready.send(socket).is_err() {
                                return;
                            }
                        }
                        Err(_) => backoff_s = (2.0 * backoff_s).min(BACKOFF_S[1]),
                    }
                }
            })?;
        Ok(Self {
            socket,
            closed,
            opened,
            thread: Some(thread),
            stop,
        })
    }

    /// Sends a frame at once or not at all.
    ///
    /// # Errors
    /// [`SendFault`]; the frame is then lost.
    pub fn send(&mut self, frame: &Frame) -> Result<(), SendFault> {
        if self.socket.is_none() {
            self.socket = self.opened.try_recv().ok();
        }
        let socket = self.socket.as_ref().ok_or(SendFault::Absent)?;
        let data = socket_frame(frame).ok_or(SendFault::Values)?;
        let Err(error) = socket.write_frame(&data) else {
            return Ok(());
        };
        Err(match error.raw_os_error() {
            Some(ENOBUFS) => SendFault::QueueFull,
            Some(ENETDOWN) => SendFault::Down,
            Some(ENODEV | ENXIO) => {
                if let Some(socket) = self.socket.take() {
                    // Where the thread is gone, the socket is closed here.
                    let _ = self.closed.send(socket);
                }
                SendFault::Absent
            }
            _ if error.kind() == ErrorKind::WouldBlock => SendFault::QueueFull,
            errno => SendFault::System {
                errno: errno.unwrap_or(0),
            },
        })
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // Not joined: the program's end need not wait for a pause between attempts.
        drop(self.thread.take());
    }
}

fn open_sender(interface: &str) -> Result<CanSocket, Error> {
    let socket = CanSocket::open(interface)?;
    // Nothing is read here, so nothing may pile up.
    socket.set_filter_drop_all()?;
    socket.set_error_filter_drop_all()?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn socket_frame(frame: &Frame) -> Option<CanDataFrame> {
    let id: Id = match frame.id {
        FrameId::Standard(id) => StandardId::new(id)?.into(),
        FrameId::Extended(id) => ExtendedId::new(id)?.into(),
    };
    CanDataFrame::new(id, frame.bytes())
}

/// Listens on an interface in a thread of its own until it is dropped.
pub struct Listener {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Listener {
    /// Returns a listener that passes frames of the identifiers `wanted`, errors and states of the
    /// bus to `hear`; the interface need not exist yet.
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(
        interface: &str,
        wanted: &[FrameId],
        epoch: Epoch,
        hear: impl FnMut(Heard) + Send + 'static,
    ) -> Result<Self, Error> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut ear = Ear {
            interface: interface.to_owned(),
            filters: wanted.iter().map(|id| exact_filter(*id)).collect(),
            epoch,
            stop: Arc::clone(&stop),
            hear,
            told: None,
            errors: BusState::Active,
            restarts: 0,
            restart_s: 0.0,
        };
        let thread = std::thread::Builder::new()
            .name("can-listener".to_owned())
            .spawn(move || ear.run())?;
        Ok(Self {
            stop,
            thread: Some(thread),
        })
    }

    /// Returns the system's name of the thread.
    pub fn thread_id(&self) -> Option<ThreadId> {
        self.thread.as_ref().map(JoinHandleExt::as_pthread_t)
    }
}

impl Drop for Listener {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the listener has shown itself as a feedback time-out.
            let _ = thread.join();
        }
    }
}

/// A filter that does not take an extended identifier for a standard one of the same number, nor a
/// remote frame for a data frame.
fn exact_filter(id: FrameId) -> CanFilter {
    const EXTENDED: u32 = 1 << 31;
    const REMOTE: u32 = 1 << 30;
    match id {
        FrameId::Standard(id) => CanFilter::new(u32::from(id), 0x7FF | EXTENDED | REMOTE),
        FrameId::Extended(id) => CanFilter::new(id | EXTENDED, 0x1FFF_FFFF | EXTENDED | REMOTE),
    }
}

struct Ear<F> {
    interface: String,
    filters: Vec<CanFilter>,
    epoch: Epoch,
    stop: Arc<AtomicBool>,
    hear: F,
    told: Option<BusState>,
    errors: BusState,
    restarts: u32,
    restart_s: f64,
}

impl<F: FnMut(Heard)> Ear<F> {
    fn run(&mut self) {
        let mut backoff_s = BACKOFF_S[0];
        while !self.stop.load(Ordering::Relaxed) {
            if let Ok(socket) = self.open() {
                backoff_s = BACKOFF_S[0];
                self.errors = BusState::Active;
                self.listen(&socket);
            } else {
                self.tell(BusState::Absent);
                // Short sleeps, so that the end of the program does not wait.
                let until_s = self.epoch.elapsed_s() + backoff_s;
                while self.epoch.elapsed_s() < until_s && !self.stop.load(Ordering::Relaxed) {
                    std::thread::sleep(READ_TIMEOUT);
                }
                backoff_s = (2.0 * backoff_s).min(BACKOFF_S[1]);
            }
        }
    }

    fn open(&self) -> Result<CanSocket, Error> {
        let socket = CanSocket::open(self.interface.as_str())?;
        socket.set_filters(&self.filters)?;
        socket.set_error_filter_accept_all()?;
        socket.set_read_timeout(READ_TIMEOUT)?;
        Ok(socket)
    }

    /// Reads until the interface has gone or the end is asked for.
    fn listen(&mut self, socket: &CanSocket) {
        let index = self.attribute("ifindex");
        let mut polled_s = f64::NEG_INFINITY;
        while !self.stop.load(Ordering::Relaxed) {
            let read = socket.read_frame();
            let time_s = self.epoch.elapsed_s();
            match read {
                Ok(CanFrame::Data(data)) => {
                    if let Some(frame) = plain_frame(&data) {
                        (self.hear)(Heard::Frame { time_s, frame });
                    }
                }
                Ok(CanFrame::Error(error)) => self.judge(error),
                Ok(CanFrame::Remote(_)) => {}
                Err(error) => match error.raw_os_error() {
                    Some(ENODEV | ENXIO) => {
                        self.tell(BusState::Absent);
                        return;
                    }
                    Some(ENETDOWN) => self.tell(BusState::Down),
                    _ => {}
                },
            }
            if time_s - polled_s >= POLL_S {
                polled_s = time_s;
                // An interface that was deleted and made again has another index.
                if index.is_none() || self.attribute("ifindex") != index {
                    self.tell(BusState::Absent);
                    return;
                }
                self.poll(time_s);
            }
        }
    }

    /// Looks at the interface: up or down, and whether a bus-off has ended.
    fn poll(&mut self, time_s: f64) {
        const UP: u32 = 1;
        let up = self
            .attribute("flags")
            .and_then(|text| u32::from_str_radix(text.trim().trim_start_matches("0x"), 16).ok())
            .is_some_and(|flags| flags & UP != 0);
        if !up {
            // A controller that is started again has forgotten its errors.
            self.errors = BusState::Active;
            self.restarts = 0;
            self.tell(BusState::Down);
            return;
        }
        if self.errors == BusState::BusOff {
            self.recover(time_s);
        }
        self.tell(self.errors);
    }

    /// Restarts a controller that has left the bus, with growing pauses and not for ever.
    fn recover(&mut self, time_s: f64) {
        if self.restarts >= RESTARTS_MAX || time_s < self.restart_s {
            return;
        }
        self.restarts += 1;
        let pause_s = BACKOFF_S[0] * f64::from(1u32 << self.restarts.min(16));
        self.restart_s = time_s + pause_s.min(BACKOFF_S[1]);
        let restarted =
            CanInterface::open(&self.interface).and_then(|interface| interface.restart());
        let answer = match restarted {
            Ok(()) => {
                self.errors = BusState::Active;
                RestartAnswer::Accepted
            }
            Err(socketcan::Error::Io(error)) => RestartAnswer::refused(error.raw_os_error()),
            Err(socketcan::Error::Nl(error)) => RestartAnswer::refused(error.errno()),
            Err(_) => RestartAnswer::None,
        };
        (self.hear)(Heard::Restart {
            time_s,
            attempt: self.restarts,
            answer,
        });
    }

    fn judge(&mut self, frame: CanErrorFrame) {
        for cause in CanError::from(frame).causes() {
            self.errors = match cause {
                ErrorCause::BusOff => {
                    if self.errors != BusState::BusOff {
                        self.restarts = 0;
                        self.restart_s = self.epoch.elapsed_s() + BACKOFF_S[0];
                    }
                    BusState::BusOff
                }
                ErrorCause::Restarted => BusState::Active,
                ErrorCause::Controller(problems) => controller_state(*problems, self.errors),
                _ => self.errors,
            };
        }
        self.tell(self.errors);
    }

    fn tell(&mut self, state: BusState) {
        if self.told.replace(state) != Some(state) {
            (self.hear)(Heard::Bus {
                time_s: self.epoch.elapsed_s(),
                state,
            });
        }
    }

    fn attribute(&self, name: &str) -> Option<String> {
        std::fs::read_to_string(format!("/sys/class/net/{}/{name}", self.interface)).ok()
    }
}

fn controller_state(problems: ControllerProblems, before: BusState) -> BusState {
    if problems.intersects(ControllerProblems::RX_PASSIVE | ControllerProblems::TX_PASSIVE) {
        BusState::Passive
    } else if problems.intersects(ControllerProblems::RX_WARNING | ControllerProblems::TX_WARNING) {
        BusState::Warning
    } else if problems.contains(ControllerProblems::ACTIVE) {
        BusState::Active
    } else {
        before
    }
}

fn plain_frame(data: &CanDataFrame) -> Option<Frame> {
    let id = match data.id() {
        Id::Standard(id) => FrameId::Standard(id.as_raw()),
        Id::Extended(id) => FrameId::Extended(id.as_raw()),
    };
    Frame::new(id, data.data())
}
