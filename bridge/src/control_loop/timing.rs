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

/// Share of a period by which sums of periods are rounded.
const ROUNDING: f64 = 1e-6;

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
    /// When the newest cycle began, s.
    begun_s: Option<f64>,
    skipped: u64,
    lateness: LatenessHistogram,
}

impl Schedule {
    pub(super) fn new(period_s: f64) -> Self {
        Self {
            period_s,
            first_s: None,
            tick: 0,
            begun_s: None,
            skipped: 0,
            lateness: LatenessHistogram::new(),
        }
    }

    /// Returns when the next cycle is due, counted from the first, s.
    fn due_s(&self, first_s: f64) -> f64 {
        first_s + self.tick as f64 * self.period_s
    }

    /// Waits for the next cycle, and returns whether the clock stands before it: a simulator was paused, and there is
    /// nothing to do.
    pub(super) fn stands(&self, clock: &mut Clock) -> bool {
        let (Some(first_s), Some(begun_s)) = (self.first_s, self.begun_s) else {
            return false;
        };
        let due_s = self.due_s(first_s);
        clock.wait_until(due_s);
        (begun_s..due_s).contains(&clock.now_s())
    }

    /// Waits for the next cycle.
    pub(super) fn wait(&mut self, clock: &mut Clock) -> CycleTime {
        let first_s = *self.first_s.get_or_insert_with(|| clock.now_s());
        let due_s = self.due_s(first_s);
        clock.wait_until(due_s);
        let begin_s = clock.now_s();
        self.begun_s = Some(begin_s);
        if begin_s + self.period_s < due_s {
            // The clock was set back: cycles count from now.
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
        let late_periods = (passed_s / self.period_s + ROUNDING).max(0.0) as u64;
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
            if sum >= rank {
                return ((i + 1) as f64 * Self::BIN_S).min(self.max_s);
            }
        }
        self.max_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drives::ExternalClock;

    /// A power of two, so that sums of periods are exact, s.
    const P: f64 = 0.0625;

    #[test]
    fn cycles_keep_to_their_times_and_skip_those_that_have_passed() {
        let mut schedule = Schedule::new(P);
        let clock = |now_s: f64| Clock::Virtual { now_s };
        // When the loop looks, when the cycle is due and begins, when it ends, and what is skipped; periods from 1 s.
        for (looks, due, begins, ends, skipped) in [
            (0.0, 0.0, 0.0, 0.25, 0),
            (0.25, 1.0, 1.0, 1.75, 0),
            // Late, and the next on time.
            (2.5, 2.0, 2.5, 2.75, 0),
            (2.75, 3.0, 3.0, 3.0, 0),
            // It ends in the second period after its own.
            (3.0, 4.0, 4.0, 6.5, 1),
            (6.5, 6.0, 6.5, 6.75, 1),
            // It begins two periods late and ends at once.
            (9.25, 7.0, 9.25, 9.25, 3),
            (9.25, 10.0, 10.0, 10.5, 3),
        ] {
            let mut clock = clock(1.0 + P * looks);
            let time = schedule.wait(&mut clock);
            assert_eq!(time.due_s, 1.0 + P * due);
            assert_eq!(time.begin_s, 1.0 + P * begins);
            assert_eq!(time.lateness_s(), P * (begins - due));
            let slack_s = schedule.finish(&time, 1.0 + P * ends);
            assert_eq!(slack_s, P * (due + 1.0 - ends));
            assert_eq!(schedule.skipped(), skipped);
        }
        let timing = schedule.timing(5);
        assert_eq!((timing.cycles, timing.skipped, timing.unsent), (8, 3, 5));
        assert_eq!(timing.lateness_max_s, 2.25 * P);
        assert_eq!(timing.slack_min_s, -1.5 * P);
    }

    #[test]
    fn cycles_count_from_now_where_the_clock_was_set_back_and_only_there() {
        let mut schedule = Schedule::new(P);
        for (now_s, due_s) in [(10.0, 10.0), (9.5, 9.5), (9.5625, 9.5625)] {
            let clock = ExternalClock::default();
            clock.set(now_s);
            let time = schedule.wait(&mut Clock::External(clock));
            assert_eq!((time.due_s, time.begin_s), (due_s, now_s));
            schedule.finish(&time, now_s);
        }
        // A clock that has not come to the time of the cycle yet.
        let clock = ExternalClock::default();
        clock.set(9.575);
        let time = schedule.wait(&mut Clock::External(clock));
        assert_eq!((time.due_s, time.begin_s), (9.625, 9.575));
    }

    #[test]
    fn no_cycle_is_due_while_the_clock_stands() {
        let source = ExternalClock::default();
        source.set(4.0);
        let mut clock = Clock::External(source.clone());
        let mut schedule = Schedule::new(0.05);
        assert!(!schedule.stands(&mut clock));
        // A clock of 10 ms whose times are those of the cycles but for rounding, and that is late by whole periods.
        for now_s in [4.0, 4.05, 4.15, 4.35, 4.4] {
            source.set(now_s);
            assert!(!schedule.stands(&mut clock), "{now_s}");
            let time = schedule.wait(&mut clock);
            assert_eq!(time.begin_s, now_s);
            schedule.finish(&time, now_s);
            assert!(schedule.stands(&mut clock), "{now_s}");
        }
        source.set(4.41);
        assert!(schedule.stands(&mut clock));
        source.set(1.0);
        assert!(!schedule.stands(&mut clock));
        assert_eq!(schedule.wait(&mut clock).due_s, 1.0);
    }

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
