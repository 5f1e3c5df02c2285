use super::bus_monitor::{exact_filter, plain_frame};
use super::system::{BACKOFF_S, ENETDOWN, ENOBUFS, ENODEV, ENXIO};
use sidehill_bridge::drives::SendError;
use sidehill_can::frame::{Frame, FrameId};
use socketcan::embedded_can::{ExtendedId, Frame as _, Id, StandardId};
use socketcan::{CanDataFrame, CanFilter, CanFrame, CanSocket, Socket, SocketOptions};
use std::io::{Error, ErrorKind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

/// Time for which a foreign frame forbids driving, s: longer than the period of a slow heartbeat.
pub(super) const FOREIGN_S: f64 = 3.0;

/// Most frames that are looked at in one call: more than two cycles of a full bus bring.
const FOREIGN_MAX: usize = 64;

/// Sends frames without waiting, and hears who else sends with the same identifiers. A separate thread opens and closes sockets, because the kernel blocks
/// both while an interface disappears.
pub struct Sender {
    socket: Option<CanSocket>,
    closed: mpsc::Sender<CanSocket>,
    opened: mpsc::Receiver<CanSocket>,
    thread: Option<JoinHandle<()>>,
    stop: Arc<AtomicBool>,
}

impl Sender {
    /// Returns a sender for an interface that need not exist yet. Frames with identifiers of `own` that others send are
    /// [`Sender::foreign`].
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(interface: &str, own: &[FrameId]) -> Result<Self, Error> {
        let (closed, to_close) = mpsc::channel();
        let (ready, opened) = mpsc::channel();
        let stop = Arc::new(AtomicBool::new(false));
        let own = own.to_vec();
        let socket = open_sender(interface, &own).ok();
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
                    match open_sender(&interface, &own) {
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

    /// Returns the last of the frames that have arrived with an identifier of this sender since the call before. A
    /// socket does not receive what it has sent itself, so another has sent them, on this machine or on the bus.
    pub fn foreign(&mut self) -> Option<Frame> {
        let socket = self.socket.as_ref()?;
        let mut last = None;
        for _ in 0..FOREIGN_MAX {
            match socket.read_frame() {
                Ok(CanFrame::Data(data)) => last = plain_frame(&data).or(last),
                Ok(_) => {}
                // Nothing is left, or the next `send` tells the error.
                Err(_) => break,
            }
        }
        last
    }

    /// Sends a frame at once or not at all.
    ///
    /// # Errors
    /// [`SendError`]; the frame is then lost.
    pub fn send(&mut self, frame: &Frame) -> Result<(), SendError> {
        if self.socket.is_none() {
            self.socket = self.opened.try_recv().ok();
        }
        let socket = self.socket.as_ref().ok_or(SendError::Absent)?;
        let data = socket_frame(frame).ok_or(SendError::Values)?;
        let Err(error) = socket.write_frame(&data) else {
            return Ok(());
        };
        Err(match error.raw_os_error() {
            Some(ENOBUFS) => SendError::QueueFull,
            Some(ENETDOWN) => SendError::Down,
            Some(ENODEV | ENXIO) => {
                if let Some(socket) = self.socket.take() {
                    // If the thread has ended, the socket is closed here.
                    let _ = self.closed.send(socket);
                }
                SendError::Absent
            }
            _ if error.kind() == ErrorKind::WouldBlock => SendError::QueueFull,
            errno => SendError::System {
                errno: errno.unwrap_or(0),
            },
        })
    }
}

impl Drop for Sender {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        // Not joined: it may be in a pause between attempts.
        drop(self.thread.take());
    }
}

fn open_sender(interface: &str, own: &[FrameId]) -> Result<CanSocket, Error> {
    let socket = CanSocket::open(interface)?;
    // Nothing else is read from this socket, so nothing else may accumulate in it.
    if own.is_empty() {
        socket.set_filter_drop_all()?;
    } else {
        let filters: Vec<CanFilter> = own.iter().map(|id| exact_filter(*id)).collect();
        socket.set_filters(&filters)?;
    }
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
