//! Between the stamps of ROS and the cycle's clock.

use crate::drives::{Clock, Epoch, ExternalClock};
use std::sync::Arc;
use std::sync::atomic::{AtomicI64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// Where on the clock of ROS the cycle's clock begins. Copies are the same.
#[derive(Debug, Clone)]
pub struct RosTime {
    origin_ns: Arc<AtomicI64>,
    source: Source,
}

#[derive(Debug, Clone)]
enum Source {
    World(Epoch),
    Told(ExternalClock),
}

impl RosTime {
    /// Returns the time of the world, with the cycle's since `epoch`.
    pub fn of_world(epoch: Epoch) -> Self {
        let time = Self {
            origin_ns: Arc::default(),
            source: Source::World(epoch),
        };
        time.follow_world();
        time
    }

    /// Returns the time that /clock tells, which is the cycle's too.
    pub fn told(clock: ExternalClock) -> Self {
        Self {
            origin_ns: Arc::default(),
            source: Source::Told(clock),
        }
    }

    /// Returns the clock of the cycle.
    pub fn clock(&self) -> Clock {
        match &self.source {
            Source::World(epoch) => Clock::Real(*epoch),
            Source::Told(clock) => Clock::External(clock.clone()),
        }
    }

    /// Returns the cycle's time, s.
    pub fn now_s(&self) -> f64 {
        self.clock().now_s()
    }

    /// Returns the told clock, where there is one.
    pub fn told_clock(&self) -> Option<&ExternalClock> {
        match &self.source {
            Source::World(_) => None,
            Source::Told(clock) => Some(clock),
        }
    }

    /// Returns the cycle's time of a stamp, s.
    pub fn cycle_s(&self, stamp_ns: i64) -> f64 {
        let origin_ns = self.origin_ns.load(Ordering::Relaxed);
        stamp_ns.saturating_sub(origin_ns) as f64 / 1e9
    }

    /// Returns the stamp of a cycle's time, ns.
    pub fn stamp_ns(&self, cycle_s: f64) -> i64 {
        let origin_ns = self.origin_ns.load(Ordering::Relaxed);
        origin_ns.saturating_add((cycle_s * 1e9) as i64)
    }

    /// Returns by how much the clock of the world has been set since it was last followed, s.
    pub fn world_set_by_s(&self) -> f64 {
        match &self.source {
            Source::Told(_) => 0.0,
            Source::World(epoch) => self.cycle_s(world_ns()) - epoch.elapsed_s(),
        }
    }

    /// Takes over the clock of the world as it is now.
    pub fn follow_world(&self) {
        if let Source::World(epoch) = &self.source {
            let origin_ns = world_ns() - (epoch.elapsed_s() * 1e9) as i64;
            self.origin_ns.store(origin_ns, Ordering::Relaxed);
        }
    }
}

fn world_ns() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH);
    since.map_or(0, |since| {
        i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_and_cycle_times_are_each_others_inverse() {
        let time = RosTime::of_world(Epoch::now());
        assert!((time.cycle_s(world_ns()) - time.now_s()).abs() < 0.05);
        let stamp_ns = time.stamp_ns(12.5);
        assert!((time.cycle_s(stamp_ns) - 12.5).abs() < 1e-6);
        assert!(time.world_set_by_s().abs() < 0.05);
    }

    #[test]
    fn a_told_time_is_the_stamps_own() {
        let clock = ExternalClock::default();
        let time = RosTime::told(clock.clone());
        clock.tell(7.25);
        assert_eq!(time.now_s(), 7.25);
        assert_eq!(time.cycle_s(7_250_000_000), 7.25);
        assert_eq!(time.world_set_by_s(), 0.0);
    }
}
