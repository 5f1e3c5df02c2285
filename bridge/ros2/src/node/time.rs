//! Between the stamps of ROS and a local clock that counts seconds from its own zero.

use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Maps ROS stamps to a local clock and back. Clones share the mapping.
#[derive(Clone)]
pub struct RosTime {
    local_s: Arc<dyn Fn() -> f64 + Send + Sync>,
    /// ROS time at the zero of the local clock, ns.
    origin_ns: Arc<AtomicI64>,
    /// System time, ns; none where time is simulated.
    system_ns: Option<SystemClock>,
}

type SystemClock = Arc<dyn Fn() -> i64 + Send + Sync>;

/// Smallest step of system time that is followed, s.
const STEP_S: f64 = 0.005;
/// Longest time between the two readings of the local clock around one of system time, s: more is an interrupted
/// measurement.
const READING_S: f64 = 0.001;

impl RosTime {
    /// Returns the mapping of system time to a monotonic clock that returns seconds.
    pub fn system(local_s: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        Self::of_clocks(local_s, system_ns)
    }

    /// Returns the mapping of a clock that returns ns, and can be set, to a monotonic one that returns seconds.
    pub(crate) fn of_clocks(
        local_s: impl Fn() -> f64 + Send + Sync + 'static,
        system_ns: impl Fn() -> i64 + Send + Sync + 'static,
    ) -> Self {
        let origin_ns = system_ns() - (local_s() * 1e9) as i64;
        Self {
            local_s: Arc::new(local_s),
            origin_ns: Arc::new(origin_ns.into()),
            system_ns: Some(Arc::new(system_ns)),
        }
    }

    /// Returns the mapping for `use_sim_time`: the local clock is that of `/clock`, in seconds.
    pub fn simulated(local_s: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        Self {
            local_s: Arc::new(local_s),
            origin_ns: Arc::default(),
            system_ns: None,
        }
    }

    /// Returns whether time is that of `/clock`.
    pub fn is_simulated(&self) -> bool {
        self.system_ns.is_none()
    }

    /// Returns the local time, s.
    pub fn now_s(&self) -> f64 {
        (self.local_s)()
    }

    /// Returns the local time of a stamp, s.
    pub fn local_s(&self, stamp_ns: i64) -> f64 {
        let origin_ns = self.origin_ns.load(Ordering::Relaxed);
        stamp_ns.saturating_sub(origin_ns) as f64 / 1e9
    }

    /// Returns the stamp of a local time, ns.
    pub fn stamp_ns(&self, local_s: f64) -> i64 {
        let origin_ns = self.origin_ns.load(Ordering::Relaxed);
        origin_ns.saturating_add((local_s * 1e9) as i64)
    }

    /// Follows system time where it was set, as by NTP: from then on stamps are those of the new time. Returns by how
    /// much it was set since the last call, s; 0 with simulated time.
    pub fn follow_system(&self) -> f64 {
        let Some(system_ns) = &self.system_ns else {
            return 0.0;
        };
        let (before_s, now_ns, after_s) = (self.now_s(), system_ns(), self.now_s());
        let now_s = 0.5 * (before_s + after_s);
        let step_s = self.local_s(now_ns) - now_s;
        if after_s - before_s > READING_S || step_s.abs() < STEP_S {
            return 0.0;
        }
        let origin_ns = now_ns - (now_s * 1e9) as i64;
        self.origin_ns.store(origin_ns, Ordering::Relaxed);
        step_s
    }
}

fn system_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| {
        i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Instant;

    #[test]
    fn stamps_and_local_times_are_inverse() {
        let start = Instant::now();
        let time = RosTime::system(move || start.elapsed().as_secs_f64());
        assert!((time.local_s(system_ns()) - time.now_s()).abs() < 0.05);
        let stamp_ns = time.stamp_ns(12.5);
        assert!((time.local_s(stamp_ns) - 12.5).abs() < 1e-6);
    }

    #[test]
    fn simulated_time_is_that_of_the_stamps() {
        let time = RosTime::simulated(|| 7.25);
        assert_eq!(time.now_s(), 7.25);
        assert_eq!(time.local_s(7_250_000_000), 7.25);
        assert_eq!(time.follow_system(), 0.0);
    }
    #[test]
    fn steps_of_system_time_are_followed_and_returned() {
        let system_ns = Arc::new(AtomicI64::new(1_000_000_000_000));
        let clock = Arc::clone(&system_ns);
        let time = RosTime::of_clocks(|| 7.0, move || clock.load(Ordering::Relaxed));
        assert_eq!(time.follow_system(), 0.0);
        for step_s in [0.3, -0.4, 0.5, -100.0] {
            system_ns.fetch_add((step_s * 1e9) as i64, Ordering::Relaxed);
            let now_ns = system_ns.load(Ordering::Relaxed);
            assert!((time.local_s(now_ns) - 7.0 - step_s).abs() < 1e-6);
            assert!((time.follow_system() - step_s).abs() < 1e-6);
            assert!((time.local_s(now_ns) - 7.0).abs() < 1e-6);
            assert_eq!(time.follow_system(), 0.0);
        }
        // Less is the error of the measurement.
        system_ns.fetch_add(1_000_000, Ordering::Relaxed);
        assert_eq!(time.follow_system(), 0.0);
    }
}
