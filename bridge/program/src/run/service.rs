//! What systemd is told of a run: that it is ready, its state in words, and that its cycles go on.
//!
//! Nothing is sent without systemd, which passes the address of its socket in the environment.

use sd_notify::NotifyState;
use std::time::{Duration, Instant};

/// A program that systemd watches, where it does.
pub(super) struct ServiceManager {
    /// Longest time between two signs of life; none where systemd expects none.
    sign_every: Option<Duration>,
    signed: Instant,
    /// Turns of the control loop at the last sign of life.
    turns: u64,
    ready: bool,
    state: String,
}

impl ServiceManager {
    /// Returns a service that has told nothing yet.
    pub(super) fn new() -> Self {
        Self {
            // Two signs may be late before systemd ends the program.
            sign_every: sd_notify::watchdog_enabled().map(|limit| limit / 3),
            signed: Instant::now(),
            turns: 0,
            ready: false,
            state: String::new(),
        }
    }

    /// Gives a sign of life if the control loop has made turns since the last one, of which `turns` is the number so
    /// far. A loop that hangs makes none, and systemd ends the program.
    pub(super) fn live(&mut self, turns: u64) {
        if turns == self.turns {
            return;
        }
        if !self.ready {
            self.ready = true;
            tell(&[NotifyState::Ready]);
        }
        if self
            .sign_every
            .is_some_and(|every| self.signed.elapsed() >= every)
        {
            self.turns = turns;
            self.signed = Instant::now();
            tell(&[NotifyState::Watchdog]);
        }
    }

    /// Tells the state in words, where it is another.
    pub(super) fn state(&mut self, state: &str) {
        if state != self.state {
            state.clone_into(&mut self.state);
            tell(&[NotifyState::Status(state)]);
        }
    }
}

/// Sends a message. One that cannot be sent changes nothing for the vehicle.
fn tell(message: &[NotifyState]) {
    let _ = sd_notify::notify(message);
}
