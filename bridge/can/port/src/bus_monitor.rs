use super::system::{BACKOFF_S, ENETDOWN, ENODEV, ENXIO};
use sidehill_bridge::drives::{Epoch, LinkState};
use sidehill_bridge::system::{ThreadId, thread_id};
use sidehill_can::frame::{Frame, FrameId};
use socketcan::embedded_can::{Frame as _, Id};
use socketcan::errors::{CanError, ControllerProblems, ErrorCause};
use socketcan::{
    CanDataFrame, CanErrorFrame, CanFilter, CanFrame, CanInterface, CanSocket, Socket,
    SocketOptions,
};
use std::io::Error;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

/// Longest wait of a read.
const READ_TIMEOUT: Duration = Duration::from_millis(20);
/// Time between two checks of the interface, s.
const POLL_S: f64 = 0.05;
/// Automatic restarts after a bus-off. After that, an operator has to restart the interface.
const RESTARTS_MAX: u32 = 8;

/// News from the bus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum BusEvent {
    /// A data frame was received.
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
        state: LinkState,
    },
    /// A restart of the interface after a bus-off was tried.
    Restart {
        /// When, s.
        time_s: f64,
        /// Number of attempts since the bus-off.
        attempt: u32,
        /// The system's answer.
        answer: RestartAnswer,
    },
}

/// The system's answer to a restart of the interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RestartAnswer {
    /// Done.
    Accepted,
    /// Refused: no permission, or not supported by the driver.
    Refused {
        /// Error number.
        errno: i32,
    },
    /// No answer that could be decoded.
    None,
}

impl RestartAnswer {
    fn refused(errno: Option<i32>) -> Self {
        errno.map_or(Self::None, |errno| Self::Refused { errno })
    }
}

/// Receives frames and watches the state of an interface in its own thread, until it is dropped.
pub struct BusMonitor {
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl BusMonitor {
    /// Starts a monitor that passes frames with the identifiers `wanted`, and changes of the bus, to
    /// `handle`. The interface need not exist yet.
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(
        interface: &str,
        wanted: &[FrameId],
        epoch: Epoch,
        handle: impl FnMut(BusEvent) + Send + 'static,
    ) -> Result<Self, Error> {
        let filters = wanted.iter().map(|id| exact_filter(*id)).collect();
        Self::start_filtered(interface, Some(filters), epoch, handle)
    }

    /// Starts a monitor as [`BusMonitor::start`] that passes all data frames.
    ///
    /// # Errors
    /// As [`BusMonitor::start`].
    pub fn start_all(
        interface: &str,
        epoch: Epoch,
        handle: impl FnMut(BusEvent) + Send + 'static,
    ) -> Result<Self, Error> {
        Self::start_filtered(interface, None, epoch, handle)
    }

    fn start_filtered(
        interface: &str,
        filters: Option<Vec<CanFilter>>,
        epoch: Epoch,
        handle: impl FnMut(BusEvent) + Send + 'static,
    ) -> Result<Self, Error> {
        let stop = Arc::new(AtomicBool::new(false));
        let mut monitor = Monitor {
            interface: interface.to_owned(),
            filters,
            epoch,
            stop: Arc::clone(&stop),
            handle,
            reported: None,
            errors: LinkState::Active,
            restarts: 0,
            restart_s: 0.0,
        };
        let thread = std::thread::Builder::new()
            .name("can-listener".to_owned())
            .spawn(move || monitor.run())?;
        Ok(Self {
            stop,
            thread: Some(thread),
        })
    }

    /// Returns the system's identifier of the thread.
    pub fn thread_id(&self) -> Option<ThreadId> {
        self.thread.as_ref().map(thread_id)
    }
}

impl Drop for BusMonitor {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic of the thread has become a feedback time-out.
            let _ = thread.join();
        }
    }
}

/// Returns a filter that distinguishes standard from extended identifiers and data from remote frames.
pub(super) fn exact_filter(id: FrameId) -> CanFilter {
    const EXTENDED: u32 = 1 << 31;
    const REMOTE: u32 = 1 << 30;
    match id {
        FrameId::Standard(id) => CanFilter::new(u32::from(id), 0x7FF | EXTENDED | REMOTE),
        FrameId::Extended(id) => CanFilter::new(id | EXTENDED, 0x1FFF_FFFF | EXTENDED | REMOTE),
    }
}

struct Monitor<F> {
    interface: String,
    /// Those of the frames that are passed on; none for all.
    filters: Option<Vec<CanFilter>>,
    epoch: Epoch,
    stop: Arc<AtomicBool>,
    handle: F,
    reported: Option<LinkState>,
    errors: LinkState,
    restarts: u32,
    restart_s: f64,
}

impl<F: FnMut(BusEvent)> Monitor<F> {
    fn run(&mut self) {
        let mut backoff_s = BACKOFF_S[0];
        while !self.stop.load(Ordering::Relaxed) {
            if let Ok(socket) = self.open() {
                backoff_s = BACKOFF_S[0];
                self.errors = LinkState::Active;
                self.listen(&socket);
            } else {
                self.report(LinkState::Absent);
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
        if let Some(filters) = &self.filters {
            socket.set_filters(filters)?;
        }
        socket.set_error_filter_accept_all()?;
        socket.set_read_timeout(READ_TIMEOUT)?;
        Ok(socket)
    }

    /// Reads until the interface disappears or the monitor ends.
    fn listen(&mut self, socket: &CanSocket) {
        let index = self.attribute("ifindex");
        let mut polled_s = f64::NEG_INFINITY;
        while !self.stop.load(Ordering::Relaxed) {
            let read = socket.read_frame();
            let time_s = self.epoch.elapsed_s();
            match read {
                Ok(CanFrame::Data(data)) => {
                    if let Some(frame) = plain_frame(&data) {
                        (self.handle)(BusEvent::Frame { time_s, frame });
                    }
                }
                Ok(CanFrame::Error(error)) => self.handle_error(error),
                Ok(CanFrame::Remote(_)) => {}
                Err(error) => match error.raw_os_error() {
                    Some(ENODEV | ENXIO) => {
                        self.report(LinkState::Absent);
                        return;
                    }
                    Some(ENETDOWN) => self.report(LinkState::Down),
                    _ => {}
                },
            }
            if time_s - polled_s >= POLL_S {
                polled_s = time_s;
                // An interface that was deleted and re-created has another index.
                if index.is_none() || self.attribute("ifindex") != index {
                    self.report(LinkState::Absent);
                    return;
                }
                self.poll(time_s);
            }
        }
    }

    /// Checks the interface: whether it is up, and whether a bus-off has ended.
    fn poll(&mut self, time_s: f64) {
        const UP: u32 = 1;
        let up = self
            .attribute("flags")
            .and_then(|text| u32::from_str_radix(text.trim().trim_start_matches("0x"), 16).ok())
            .is_some_and(|flags| flags & UP != 0);
        if !up {
            // Switching the interface on resets its error counters.
            self.errors = LinkState::Active;
            self.restarts = 0;
            self.report(LinkState::Down);
            return;
        }
        if self.errors == LinkState::BusOff {
            self.recover(time_s);
        }
        self.report(self.errors);
    }

    /// Restarts the interface after a bus-off, with growing pauses and a limited number of times.
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
                self.errors = LinkState::Active;
                RestartAnswer::Accepted
            }
            Err(socketcan::Error::Io(error)) => RestartAnswer::refused(error.raw_os_error()),
            Err(socketcan::Error::Nl(error)) => RestartAnswer::refused(error.errno()),
            Err(_) => RestartAnswer::None,
        };
        (self.handle)(BusEvent::Restart {
            time_s,
            attempt: self.restarts,
            answer,
        });
    }

    fn handle_error(&mut self, frame: CanErrorFrame) {
        for cause in CanError::from(frame).causes() {
            self.errors = match cause {
                ErrorCause::BusOff => {
                    if self.errors != LinkState::BusOff {
                        self.restarts = 0;
                        self.restart_s = self.epoch.elapsed_s() + BACKOFF_S[0];
                    }
                    LinkState::BusOff
                }
                ErrorCause::Restarted => LinkState::Active,
                ErrorCause::Controller(problems) => controller_state(*problems, self.errors),
                _ => self.errors,
            };
        }
        self.report(self.errors);
    }

    fn report(&mut self, state: LinkState) {
        if self.reported.replace(state) != Some(state) {
            (self.handle)(BusEvent::Bus {
                time_s: self.epoch.elapsed_s(),
                state,
            });
        }
    }

    fn attribute(&self, name: &str) -> Option<String> {
        std::fs::read_to_string(format!("/sys/class/net/{}/{name}", self.interface)).ok()
    }
}

fn controller_state(problems: ControllerProblems, before: LinkState) -> LinkState {
    if problems.intersects(ControllerProblems::RX_PASSIVE | ControllerProblems::TX_PASSIVE) {
        LinkState::Passive
    } else if problems.intersects(ControllerProblems::RX_WARNING | ControllerProblems::TX_WARNING) {
        LinkState::Warning
    } else if problems.contains(ControllerProblems::ACTIVE) {
        LinkState::Active
    } else {
        before
    }
}

pub(super) fn plain_frame(data: &CanDataFrame) -> Option<Frame> {
    let id = match data.id() {
        Id::Standard(id) => FrameId::Standard(id.as_raw()),
        Id::Extended(id) => FrameId::Extended(id.as_raw()),
    };
    Frame::new(id, data.data())
}
