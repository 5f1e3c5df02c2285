//! Distances from the path that were predicted, and how well they came true.

use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// How far ahead is looked, s.
pub const AHEAD_S: f64 = 2.0;
/// Time over which errors of predictions are remembered, and that for which s = 1 counts beside them, s.
const MEMORY_S: f64 = 20.0;
const GIVEN_S: f64 = 6.0;

/// Where across the path the vehicle will be in [`AHEAD_S`].
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Ahead {
    /// Distance of the tracked point from the path by the plan, m, left of travel positive.
    pub cross_track_m: f64,
    /// Bound that the true distance from the path then keeps to it with a probability of 95 %, m.
    pub bound_m: f64,
}

/// A prediction that is still to be compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Prediction {
    pub(super) for_s: f64,
    pub(super) cross_track_m: f64,
    /// Of the estimate then, with s = 1, m^2.
    pub(super) variance_m2: f64,
}

/// Predictions, and how well earlier ones came true; nothing is allocated after [`Predictions::new`].
#[derive(Debug, Clone)]
pub(super) struct Predictions {
    /// The oldest first.
    pending: VecDeque<Prediction>,
    /// Integrals of squared errors over variances and of time, s.
    squares_s: f64,
    compared_s: f64,
}

impl Predictions {
    pub(super) fn new(period_s: f64) -> Self {
        Self {
            pending: VecDeque::with_capacity((AHEAD_S / period_s).ceil() as usize + 2),
            squares_s: 0.0,
            compared_s: 0.0,
        }
    }

    /// Drops the predictions of a plan that is not driven to its end.
    pub(super) fn drop_pending(&mut self) {
        self.pending.clear();
    }

    /// Forgets everything.
    pub(super) fn reset(&mut self) {
        self.drop_pending();
        (self.squares_s, self.compared_s) = (0.0, 0.0);
    }

    /// Compares the distance from the path with that predicted for now.
    pub(super) fn compare(&mut self, time_s: f64, elapsed_s: f64, cross_track_m: f64) {
        let mut due = None;
        while let Some(oldest) = self.pending.front()
            && oldest.for_s <= time_s + 1e-6
        {
            due = self.pending.pop_front();
        }
        let keep = (-elapsed_s / MEMORY_S).exp();
        self.squares_s *= keep;
        self.compared_s *= keep;
        if let Some(due) = due.filter(|due| due.variance_m2 > 0.0) {
            let off_m = cross_track_m - due.cross_track_m;
            self.squares_s += elapsed_s * off_m * off_m / due.variance_m2;
            self.compared_s += elapsed_s;
        }
    }

    pub(super) fn add(&mut self, prediction: Prediction) {
        if self.pending.len() == self.pending.capacity() {
            self.pending.pop_front();
        }
        self.pending.push_back(prediction);
    }

    /// Returns s. It is a mean of errors of which one in [`AHEAD_S`] is new, and the error to come is another one.
    pub(super) fn share(&self) -> f64 {
        let time_s = GIVEN_S + self.compared_s;
        (GIVEN_S + self.squares_s) / time_s * (1.0 + AHEAD_S / time_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// s before anything was compared.
    const NOTHING_LEARNED: f64 = 1.0 + AHEAD_S / GIVEN_S;

    /// Returns the distance from the path that is predicted for a time, m.
    fn predicted_m(time_s: f64) -> f64 {
        0.3 + 0.1 * time_s
    }

    /// Returns s after 100 s of predictions that are off by so many standard deviations of 1 cm.
    fn share_after(deviations: f64) -> (Predictions, f64) {
        let mut predictions = Predictions::new(0.05);
        for cycle in 0..2000 {
            let time_s = 0.05 * f64::from(cycle);
            predictions.compare(time_s, 0.05, predicted_m(time_s) + 0.01 * deviations);
            let for_s = time_s + AHEAD_S;
            predictions.add(Prediction {
                for_s,
                cross_track_m: predicted_m(for_s),
                variance_m2: 1e-4,
            });
        }
        let share = predictions.share();
        (predictions, share)
    }

    #[test]
    fn the_share_is_the_mean_square_of_the_errors_over_what_was_expected() {
        for deviations in [0.5, 1.0, 3.0] {
            let (_, share) = share_after(deviations);
            // After so long the last 20 s count, and beside them the 1 with which it begins.
            let time_s = GIVEN_S + MEMORY_S;
            let mean = (GIVEN_S + MEMORY_S * deviations * deviations) / time_s;
            let expected = mean * (1.0 + AHEAD_S / time_s);
            assert!((share - expected).abs() < 0.02 * expected, "{share}");
        }
    }

    #[test]
    fn what_is_dropped_is_not_compared_and_what_was_learned_is_forgotten_with_time() {
        let (mut predictions, share) = share_after(3.0);
        let mut reset = predictions.clone();
        predictions.drop_pending();
        predictions.compare(100.0, 0.05, 5.0);
        assert!(predictions.share() <= share);
        predictions.compare(300.0, 200.0, 5.0);
        assert!((predictions.share() - NOTHING_LEARNED).abs() < 0.01);
        assert_eq!(
            predictions.pending.capacity(),
            Predictions::new(0.05).pending.capacity()
        );
        reset.reset();
        reset.compare(100.0, 0.05, 5.0);
        assert_eq!(reset.share(), NOTHING_LEARNED);
    }

    #[test]
    fn a_prediction_without_a_variance_tells_nothing() {
        let mut predictions = Predictions::new(0.05);
        for cross_track_m in [0.0, 0.1] {
            predictions.add(Prediction {
                for_s: 1.0,
                cross_track_m,
                variance_m2: 0.0,
            });
            predictions.compare(1.0, 0.05, 0.0);
            assert_eq!(predictions.share(), NOTHING_LEARNED);
        }
    }
}
