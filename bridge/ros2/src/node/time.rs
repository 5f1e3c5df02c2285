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
    simulated: bool,
}

impl RosTime {
    /// Returns the mapping of system time to a monotonic clock that returns seconds.
    pub fn system(local_s: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        let time = Self {
            local_s: Arc::new(local_s),
            origin_ns: Arc::default(),
            simulated: false,
        };
        time.resynchronize();
        time
    }

    /// Returns the mapping for `use_sim_time`: the local clock is that of `/clock`, in seconds.
    pub fn simulated(local_s: impl Fn() -> f64 + Send + Sync + 'static) -> Self {
        Self {
            local_s: Arc::new(local_s),
            origin_ns: Arc::default(),
            simulated: true,
        }
    }

    /// Returns whether time is that of `/clock`.
    pub fn is_simulated(&self) -> bool {
        self.simulated
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

    /// Returns by how much system time was set since the last [`RosTime::resynchronize`], s; 0 with
    /// simulated time.
    pub fn system_jump_s(&self) -> f64 {
        if self.simulated {
            0.0
        } else {
            self.local_s(system_ns()) - self.now_s()
        }
    }

    /// Restarts the mapping of system time, as after a jump.
    pub fn resynchronize(&self) {
        if !self.simulated {
            let origin_ns = system_ns() - (self.now_s() * 1e9) as i64;
            self.origin_ns.store(origin_ns, Ordering::Relaxed);
        }
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
        assert!(time.system_jump_s().abs() < 0.05);
    }

    #[test]
    fn simulated_time_is_that_of_the_stamps() {
        let time = RosTime::simulated(|| 7.25);
        assert_eq!(time.now_s(), 7.25);
        assert_eq!(time.local_s(7_250_000_000), 7.25);
        assert_eq!(time.system_jump_s(), 0.0);
    }
}
