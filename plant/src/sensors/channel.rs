//! One sensor: when it reads, what it reads, and when the reading arrives.

use super::config::Timing;
use crate::sample::Stamped;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};
use std::collections::VecDeque;

/// Turns what is true into what is read, given four draws of the standard normal distribution.
pub(super) trait Errors {
    type Reading: Copy;

    fn disturb(&self, truth: &Self::Reading, gaussians: [f64; 4]) -> Self::Reading;
}

/// Instant of a step, counted.
#[derive(Clone, Copy)]
pub(super) struct StepClock {
    pub(super) step_index: u64,
    pub(super) dt_s: f64,
}

impl StepClock {
    fn time_s(self) -> f64 {
        self.step_index as f64 * self.dt_s
    }

    /// How many periods of `rate_hz` have ended by now. The margin of 1e-6 periods keeps a period of
    /// whole steps from being seen a step late through rounding.
    fn periods(self, rate_hz: f64) -> u64 {
        (self.time_s() * rate_hz + 1e-6).floor() as u64
    }
}

#[derive(Debug, Clone)]
pub(super) struct Channel<E: Errors> {
    timing: Timing,
    errors: E,
    random: ChaCha8Rng,
    /// Number of the period of the newest reading.
    period: Option<u64>,
    /// Readings not yet delivered, the oldest in front.
    in_flight: VecDeque<Stamped<E::Reading>>,
}

/// Rounding of instants must not make a reading late by a cycle.
const TIME_MARGIN_S: f64 = 1e-9;

impl<E: Errors> Channel<E> {
    pub(super) fn new(timing: Timing, errors: E, seed: u64, stream: u64) -> Self {
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        random.set_stream(stream);
        Self {
            timing,
            errors,
            random,
            period: None,
            in_flight: VecDeque::new(),
        }
    }

    pub(super) fn observe(&mut self, clock: StepClock, truth: &E::Reading) {
        if let Some(rate_hz) = self.timing.rate_hz {
            let period = Some(clock.periods(rate_hz));
            if period == self.period {
                return;
            }
            self.period = period;
        }
        let gaussians = std::array::from_fn(|_| StandardNormal.sample(&mut self.random));
        let lost = self.uniform() < self.timing.dropout_probability;
        let time_s = clock.time_s();
        if lost || self.timing.is_gap(time_s) {
            return;
        }
        self.in_flight.push_back(Stamped {
            time_s,
            value: self.errors.disturb(truth, gaussians),
        });
        // Whoever does not ask for readings must not make the queue grow: of those that have arrived
        // only the newest can still be delivered.
        while self
            .in_flight
            .get(1)
            .is_some_and(|next| self.has_arrived(next, time_s))
        {
            self.in_flight.pop_front();
        }
    }

    pub(super) fn newest(&mut self, time_s: f64) -> Option<Stamped<E::Reading>> {
        let mut newest = None;
        while self
            .in_flight
            .front()
            .is_some_and(|front| self.has_arrived(front, time_s))
        {
            newest = self.in_flight.pop_front();
        }
        newest
    }

    fn has_arrived(&self, reading: &Stamped<E::Reading>, time_s: f64) -> bool {
        reading.time_s + self.timing.delay_s <= time_s + TIME_MARGIN_S
    }

    /// Evenly distributed in [0, 1), from the 53 bits a number of this size can hold.
    fn uniform(&mut self) -> f64 {
        (self.random.next_u64() >> 11) as f64 * (-53.0_f64).exp2()
    }

    #[cfg(test)]
    pub(super) fn waiting(&self) -> usize {
        self.in_flight.len()
    }
}
