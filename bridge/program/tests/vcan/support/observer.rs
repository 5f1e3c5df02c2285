//! A third party that watches the commands on the bus.

use super::{BUS, layout, unix_now_s};
use sidehill_bridge::drives::Epoch;
use sidehill_can::frame::{Frame, FrameId};
use sidehill_can::message::{DriveRole, Quantity};
use sidehill_can_port::{BusEvent, BusMonitor};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

/// A command as a third party on the bus saw it.
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    pub unix_s: f64,
    pub enable: bool,
    pub zero: bool,
}

/// A third party that watches the commands.
pub struct Observer {
    seen: Arc<Mutex<Vec<Seen>>>,
    _listener: BusMonitor,
}

impl Observer {
    /// Starts to watch the commands of `can.yaml`.
    pub fn start() -> Self {
        let message = layout().command[0].clone();
        Self::watch(&[message.id()], move |frame| {
            let contents = message.decode(frame).ok()??;
            let is_zero = |role| contents.get(Quantity::Command(role)).unwrap().abs() < 1e-9;
            Some((
                contents.get(Quantity::CommandEnable).unwrap() == 1.0,
                is_zero(DriveRole::Traction) && is_zero(DriveRole::Steer),
            ))
        })
    }

    /// Starts to watch frames; `read` returns whether a frame enables and whether it is zero.
    pub fn watch(
        wanted: &[FrameId],
        mut read: impl FnMut(&Frame) -> Option<(bool, bool)> + Send + 'static,
    ) -> Self {
        let seen = Arc::new(Mutex::new(Vec::new()));
        let inside = Arc::clone(&seen);
        let epoch = Epoch::now();
        let listener = BusMonitor::start(BUS, wanted, epoch, move |heard| {
            if let BusEvent::Frame { time_s, frame } = heard
                && let Some((enable, zero)) = read(&frame)
            {
                inside.lock().unwrap().push(Seen {
                    unix_s: epoch.unix_s(time_s),
                    enable,
                    zero,
                });
            }
        })
        .unwrap();
        Self {
            seen,
            _listener: listener,
        }
    }

    /// What was seen.
    pub fn seen(&self) -> Vec<Seen> {
        self.seen.lock().unwrap().clone()
    }

    /// Waits until the vehicle has been told to move for `for_s`.
    pub fn wait_for_driving(&self, for_s: f64) {
        let start = Instant::now();
        loop {
            let since = self.seen().into_iter().rev().take_while(|s| !s.zero).last();
            if since.is_some_and(|first| unix_now_s() - first.unix_s > for_s) {
                return;
            }
            assert!(start.elapsed() < Duration::from_secs(20), "nothing drives");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns the time of the last command before the first silence of half a second.
    pub fn silent_since_s(&self) -> f64 {
        let seen = self.seen();
        let silence = seen
            .windows(2)
            .find(|pair| pair[1].unix_s - pair[0].unix_s > 0.5);
        silence.expect("there was no silence")[0].unix_s
    }

    /// Time from `unix_s` to the first command from which on all are zero and off, s; none where
    /// commands still move or enable.
    pub fn off_after_s(&self, unix_s: f64) -> Option<f64> {
        let seen = self.seen();
        let last_on = seen.iter().rposition(|s| s.enable || !s.zero);
        let first_off = last_on.map_or(0, |last| last + 1);
        seen.get(first_off).map(|s| s.unix_s - unix_s)
    }
}
