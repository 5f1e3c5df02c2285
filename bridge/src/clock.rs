//! The cycle's clock: the machine's monotonic clock, or a simulated one.

use rustix::thread::{ClockId as SleepClock, clock_nanosleep_absolute};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// Where the time of a program begins, on the monotonic clock and in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    monotonic_s: f64,
    unix_s: f64,
}

impl Epoch {
    /// Returns an epoch that begins now.
    pub fn now() -> Self {
        Self {
            monotonic_s: seconds(&clock_gettime(ClockId::Monotonic)),
            unix_s: seconds(&clock_gettime(ClockId::Realtime)),
        }
    }

    /// Returns the time since the epoch, s.
    pub fn elapsed_s(&self) -> f64 {
        seconds(&clock_gettime(ClockId::Monotonic)) - self.monotonic_s
    }

    /// Returns the time of the world at `time_s`, s since 1970; a clock set since then is not
    /// followed, so that logs do not jump.
    pub fn unix_s(&self, time_s: f64) -> f64 {
        self.unix_s + time_s
    }
}

/// What a cycle waits on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Clock {
    /// Real time since an epoch.
    Real(Epoch),
    /// Time that goes on only by waiting.
    Virtual {
        /// Now, s.
        now_s: f64,
    },
}

impl Clock {
    /// Returns the time, s.
    pub fn now_s(&self) -> f64 {
        match self {
            Self::Real(epoch) => epoch.elapsed_s(),
            Self::Virtual { now_s } => *now_s,
        }
    }

    /// Waits until an absolute time, so that lateness does not add up; returns at once where it has
    /// passed.
    pub fn wait_until(&mut self, time_s: f64) {
        match self {
            Self::Virtual { now_s } => *now_s = now_s.max(time_s),
            Self::Real(epoch) => {
                let absolute_s = epoch.monotonic_s + time_s;
                if !absolute_s.is_finite() || absolute_s < 0.0 {
                    return;
                }
                let request = Timespec {
                    tv_sec: absolute_s as i64,
                    tv_nsec: ((absolute_s.fract() * 1e9) as i64).min(999_999_999),
                };
                // A signal ends the sleep early; then it is slept on.
                while epoch.elapsed_s() < time_s
                    && clock_nanosleep_absolute(SleepClock::Monotonic, &request).is_err()
                {
                }
            }
        }
    }
}

fn seconds(time: &Timespec) -> f64 {
    time.tv_sec as f64 + 1e-9 * time.tv_nsec as f64
}
