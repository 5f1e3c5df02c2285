use super::system::{BACKOFF_S, ENETDOWN, ENOBUFS, ENODEV, ENXIO};
use sidehill_bridge::drives::SendError;
use sidehill_can::frame::{Frame, FrameId};
use socketcan::embedded_can::{ExtendedId, Frame as _, Id, StandardId};
use socketcan::{CanDataFrame, CanSocket, Socket, SocketOptions};
use std::io::{Error, ErrorKind};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, mpsc};
use std::thread::JoinHandle;
use std::time::Duration;

/// Sends frames without waiting. A separate thread opens and closes sockets, because the kernel blocks
/// both while an interface disappears.
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

fn open_sender(interface: &str) -> Result<CanSocket, Error> {
    let socket = CanSocket::open(interface)?;
    // Nothing is read from this socket, so nothing may accumulate in it.
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
