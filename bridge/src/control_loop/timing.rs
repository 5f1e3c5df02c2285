use crate::drives::Clock;
use serde::Serialize;

/// How well the loop has kept its times.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct LoopTiming {
    /// Cycles run.
    pub cycles: u64,
    /// Cycles skipped because earlier ones took too long.
    pub skipped: u64,
    /// Cycles whose command could not be sent.
    pub unsent: u64,
    /// Median start lateness, s.
    pub lateness_p50_s: f64,
    /// 99 % quantile of the start lateness, s.
    pub lateness_p99_s: f64,
    /// Largest start lateness, s.
    pub lateness_max_s: f64,
    /// Smallest remaining time at the end of a cycle, s; negative where a cycle ended late.
    pub slack_min_s: f64,
}

/// The times of one cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CycleTime {
    /// When it should begin, s.
    due_s: f64,
    /// When it began, s.
    pub(super) begin_s: f64,
}

impl CycleTime {
    pub(super) fn lateness_s(&self) -> f64 {
        self.begin_s - self.due_s
    }
}

/// Absolute times of the cycles, so that lateness does not add up.
pub(super) struct Schedule {
    period_s: f64,
    first_s: Option<f64>,
    /// Number of the next cycle, counted from `first_s`.
    tick: u64,
    skipped: u64,
    lateness: LatenessHistogram,
}

impl Schedule {
    pub(super) fn new(period_s: f64) -> Self {
        Self {
            period_s,
            first_s: None,
            tick: 0,
            skipped: 0,
            lateness: LatenessHistogram::new(),
        }
    }

    /// Waits for the next cycle.
    pub(super) fn wait(&mut self, clock: &mut Clock) -> CycleTime {
        let first_s = *self.first_s.get_or_insert_with(|| clock.now_s());
        let due_s = first_s + self.tick as f64 * self.period_s;
        clock.wait_until(due_s);
        let begin_s = clock.now_s();
        if begin_s + self.period_s < due_s {
            // The clock was set back, or stands still: cycles count from now.
            self.first_s = Some(begin_s);
            self.tick = 0;
            return CycleTime {
                due_s: begin_s,
                begin_s,
            };
        }
        CycleTime { due_s, begin_s }
    }

    /// Takes the end of a cycle, skips cycles whose time has passed, and returns what was left of the
    /// period, s.
    pub(super) fn finish(&mut self, time: &CycleTime, end_s: f64) -> f64 {
        let slack_s = time.due_s + self.period_s - end_s;
        self.lateness.add(time.lateness_s(), slack_s);
        // A cycle that began after its own period is not followed by another at once.
        let passed_s = time.lateness_s().max(-slack_s);
        let late_periods = (passed_s / self.period_s).max(0.0) as u64;
        self.tick += 1 + late_periods;
        self.skipped += late_periods;
        slack_s
    }

    pub(super) fn skipped(&self) -> u64 {
        self.skipped
    }

    pub(super) fn timing(&self, unsent: u64) -> LoopTiming {
        LoopTiming {
            cycles: self.lateness.count,
            skipped: self.skipped,
            unsent,
            lateness_p50_s: self.lateness.quantile(0.5),
            lateness_p99_s: self.lateness.quantile(0.99),
            lateness_max_s: self.lateness.max_s,
            slack_min_s: self.lateness.slack_min_s,
        }
    }
}

/// Streaming distribution of the lateness in bins of 0.1 ms; allocates only when it is made.
struct LatenessHistogram {
    counts: Box<[u32; Self::BINS]>,
    count: u64,
    max_s: f64,
    slack_min_s: f64,
}

impl LatenessHistogram {
    const BINS: usize = 1000;
    const BIN_S: f64 = 1e-4;

    fn new() -> Self {
        Self {
            counts: Box::new([0; Self::BINS]),
            count: 0,
            max_s: 0.0,
            slack_min_s: f64::INFINITY,
        }
    }

    fn add(&mut self, lateness_s: f64, slack_s: f64) {
        let bin = (lateness_s / Self::BIN_S) as usize;
        self.counts[bin.min(Self::BINS - 1)] += 1;
        self.count += 1;
        self.max_s = self.max_s.max(lateness_s);
        self.slack_min_s = self.slack_min_s.min(slack_s);
    }

    /// Returns the upper edge of the bin in which the quantile `share` lies, s.
    fn quantile(&self, share: f64) -> f64 {
        let rank = (share * self.count as f64).ceil() as u64;
        let mut sum = 0;
        for (i, count) in self.counts.iter().enumerate() {
            sum += u64::from(*count);
            if sum >= rank && rank > 0 {
                return ((i + 1) as f64 * Self::BIN_S).min(self.max_s);
            }
        }
        self.max_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_lie_in_the_bin_of_their_rank() {
        let mut histogram = LatenessHistogram::new();
        assert_eq!(histogram.quantile(0.5), 0.0);
        for lateness_ms in [0.05, 0.05, 0.05, 2.01, 250.0] {
            histogram.add(1e-3 * lateness_ms, 0.01);
        }
        assert_eq!(histogram.quantile(0.5), 1e-4);
        assert!((histogram.quantile(0.8) - 2.1e-3).abs() < 1e-12);
        // Beyond the last bin, only the maximum is known.
        assert_eq!(histogram.quantile(1.0), 0.1);
        assert_eq!(histogram.max_s, 0.25);
    }
}
