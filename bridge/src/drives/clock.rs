use crate::system;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

/// Where the time of a program begins, on the monotonic clock and in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Epoch {
    begun: Instant,
    unix_s: f64,
}

impl Epoch {
    /// Returns an epoch that begins now.
    pub fn now() -> Self {
        let since_1970 = SystemTime::now().duration_since(UNIX_EPOCH);
        Self {
            begun: Instant::now(),
            unix_s: since_1970.map_or(0.0, |time| time.as_secs_f64()),
        }
    }

    /// Returns the time since the epoch, s.
    pub fn elapsed_s(&self) -> f64 {
        self.begun.elapsed().as_secs_f64()
    }

    /// Returns the time of the world at `time_s`, s since 1970; a clock set since then is not
    /// followed, so that logs do not jump.
    pub fn unix_s(&self, time_s: f64) -> f64 {
        self.unix_s + time_s
    }
}

/// A clock that is set from outside, as by a simulator; clones are the same clock.
#[derive(Debug, Clone, Default)]
pub struct ExternalClock {
    /// The time that was set last, s.
    shared: Arc<(Mutex<Option<f64>>, Condvar)>,
}

impl ExternalClock {
    /// Longest wait for a clock that stands still, in real time.
    const WAIT_MAX: Duration = Duration::from_millis(500);

    /// Sets the time, s. A number that is not finite is ignored.
    pub fn set(&self, now_s: f64) {
        if now_s.is_finite() {
            *self.lock() = Some(now_s);
            self.shared.1.notify_all();
        }
    }

    /// Returns the time that was set last, s; none before the first.
    pub fn now_s(&self) -> Option<f64> {
        *self.lock()
    }

    fn wait_until(&self, time_s: f64) {
        let time = self.lock();
        let early = |time: &mut Option<f64>| time.is_none_or(|now_s| now_s < time_s);
        // A poisoned lock ends the wait.
        drop(
            self.shared
                .1
                .wait_timeout_while(time, Self::WAIT_MAX, early),
        );
    }

    fn lock(&self) -> MutexGuard<'_, Option<f64>> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The clock of a control loop.
#[derive(Debug, Clone)]
pub enum Clock {
    /// Real time since an epoch.
    Real(Epoch),
    /// Simulated time that advances only by waiting.
    Virtual {
        /// Now, s.
        now_s: f64,
    },
    /// Time that is set from outside.
    External(ExternalClock),
}

impl Clock {
    /// Returns the time, s.
    pub fn now_s(&self) -> f64 {
        match self {
            Self::Real(epoch) => epoch.elapsed_s(),
            Self::Virtual { now_s } => *now_s,
            Self::External(clock) => clock.now_s().unwrap_or(0.0),
        }
    }

    /// Waits until an absolute time, so that lateness does not add up. Returns at once where it has
    /// passed, and early if an external clock stands still.
    pub fn wait_until(&mut self, time_s: f64) {
        match self {
            Self::Virtual { now_s } => *now_s = now_s.max(time_s),
            Self::External(clock) => clock.wait_until(time_s),
            Self::Real(epoch) => {
                if let Ok(left) = Duration::try_from_secs_f64(time_s - epoch.elapsed_s()) {
                    system::sleep(left);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_external_clock_wakes_a_waiting_thread() {
        let clock = ExternalClock::default();
        let source = clock.clone();
        let thread = std::thread::spawn(move || {
            for step in 1..=10 {
                std::thread::sleep(Duration::from_millis(5));
                source.set(f64::from(step) * 0.1);
            }
        });
        let mut waiting = Clock::External(clock);
        waiting.wait_until(0.5);
        assert!(waiting.now_s() >= 0.5);
        thread.join().unwrap();
        // A time that has passed is not waited for.
        waiting.wait_until(0.9);
        assert_eq!(waiting.now_s(), 1.0);
    }

    #[test]
    fn the_wait_for_an_external_clock_that_stands_ends() {
        let clock = ExternalClock::default();
        clock.set(3.0);
        clock.set(f64::NAN);
        let mut waiting = Clock::External(clock.clone());
        let start = Instant::now();
        waiting.wait_until(4.0);
        assert_eq!(waiting.now_s(), 3.0);
        assert!(start.elapsed() >= ExternalClock::WAIT_MAX);
    }
}
