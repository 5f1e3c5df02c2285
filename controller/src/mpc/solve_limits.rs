//! Deadline and iteration limit of a solve.

use crate::clock::Instant;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::time::Duration;

/// Deadline and iteration limit of a solve.
#[derive(Debug)]
pub struct SolveLimits {
    epoch: Instant,
    /// Nanoseconds after `epoch`.
    deadline_ns: AtomicU64,
    iterations: AtomicU32,
    /// Looks at the deadline since [`SolveLimits::begin_cycle`].
    looks: AtomicU32,
    /// The look that ends the solves, instead of the clock; `NEVER` for none.
    cut_at: AtomicU32,
    /// The first look that ended a solve; `NEVER` for none.
    was_cut_at: AtomicU32,
}

/// No look at the deadline.
const NEVER: u32 = u32::MAX;

impl Clone for SolveLimits {
    fn clone(&self) -> Self {
        let copy = |count: &AtomicU32| AtomicU32::new(count.load(Ordering::Relaxed));
        Self {
            epoch: self.epoch,
            deadline_ns: AtomicU64::new(self.deadline_ns.load(Ordering::Relaxed)),
            iterations: copy(&self.iterations),
            looks: copy(&self.looks),
            cut_at: copy(&self.cut_at),
            was_cut_at: copy(&self.was_cut_at),
        }
    }
}

impl SolveLimits {
    /// Returns limits without a deadline.
    pub fn new(iterations: u32) -> Self {
        Self {
            epoch: Instant::now(),
            deadline_ns: AtomicU64::new(u64::MAX),
            iterations: AtomicU32::new(iterations),
            looks: AtomicU32::new(0),
            cut_at: AtomicU32::new(NEVER),
            was_cut_at: AtomicU32::new(NEVER),
        }
    }

    /// Begins a cycle, whose solves look at the deadline in turn. With `cut_at` the look of that number
    /// ends them and no clock does, so that a recorded cycle is solved again exactly.
    pub fn begin_cycle(&self, cut_at: Option<u32>) {
        self.looks.store(0, Ordering::Relaxed);
        self.cut_at
            .store(cut_at.unwrap_or(NEVER), Ordering::Relaxed);
        self.was_cut_at.store(NEVER, Ordering::Relaxed);
    }

    /// Returns the look at the deadline that ended a solve of this cycle, counted from 0; none where
    /// none did.
    pub fn was_cut_at(&self) -> Option<u32> {
        Some(self.was_cut_at.load(Ordering::Relaxed)).filter(|look| *look != NEVER)
    }

    /// Sets when the solves to come end.
    pub fn set_deadline(&self, deadline: Option<Instant>) {
        let after = |instant: Instant| instant.saturating_duration_since(self.epoch).as_nanos();
        let limit = deadline.map_or(u64::MAX, |instant| {
            u64::try_from(after(instant)).unwrap_or(u64::MAX)
        });
        self.deadline_ns.store(limit, Ordering::Relaxed);
    }

    /// Sets the largest number of interior-point iterations of the solves to come.
    #[cfg(test)]
    pub fn set_iterations(&self, iterations: u32) {
        self.iterations.store(iterations, Ordering::Relaxed);
    }

    /// Returns the largest number of interior-point iterations.
    pub fn iterations(&self) -> u32 {
        self.iterations.load(Ordering::Relaxed)
    }

    /// Returns whether the deadline is over.
    pub fn passed(&self) -> bool {
        let look = self.looks.fetch_add(1, Ordering::Relaxed);
        let cut_at = self.cut_at.load(Ordering::Relaxed);
        let passed = if cut_at == NEVER {
            let deadline = Duration::from_nanos(self.deadline_ns.load(Ordering::Relaxed));
            self.epoch.elapsed() >= deadline
        } else {
            look >= cut_at
        };
        if passed {
            self.was_cut_at.fetch_min(look, Ordering::Relaxed);
        }
        passed
    }
}
