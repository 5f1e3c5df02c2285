//! How noisy poses are, as they show it themselves.
//!
//! From pose to pose the vehicle moves as dead reckoning says, but for an error that hardly changes from one interval to
//! the next. With z_k the motion between two poses less that of dead reckoning, the difference of two of these is the
//! noise n of three poses,
//!
//! ```text
//! w_k = z_k - z_(k-1) = n_k - 2 n_(k-1) + n_(k-2),    E w^2 = 6 sigma^2
//! ```
//!
//! so that a velocity that the model has wrong does not count as noise of poses. The mean of w^2 / 6 is their variance
//! in the filter, within a range around that of the settings: errors of poses that last, as those of satellites, do
//! not show in w.

use super::gate::PoseSigmas;
use nalgebra::{Matrix3, Vector3};

/// Poses over which the square is averaged.
const AVERAGED: f64 = 100.0;
/// Poses for which the settings count.
const GIVEN: f64 = 6.0;
/// Time between two poses from which on they are not compared, s.
const GAP_S: f64 = 1.5;
/// Standard deviations beyond which a difference counts as one of so many.
const OUTLIER: f64 = 3.0;
/// Range of the standard deviations over those of the settings.
const RANGE: (f64, f64) = (0.5, 10.0);

/// The newest pose.
#[derive(Debug, Clone, Copy)]
struct Newest {
    time_s: f64,
    /// Pose less the estimate after it.
    residual: Vector3<f64>,
    /// z of the interval before it.
    missed: Option<Vector3<f64>>,
}

/// Variances of (x, y, yaw) of poses.
#[derive(Debug, Clone, Copy)]
pub(super) struct PoseNoise {
    variance: Vector3<f64>,
    /// Poses averaged so far.
    poses: f64,
    newest: Option<Newest>,
}

impl PoseNoise {
    /// Returns the variances of the settings.
    pub(super) fn new(sigmas: &PoseSigmas) -> Self {
        Self {
            variance: sigmas.covariance().diagonal(),
            poses: GIVEN,
            newest: None,
        }
    }

    /// Returns the covariance of a pose, within its range around that of the settings.
    pub(super) fn covariance(&self, given: &Matrix3<f64>) -> Matrix3<f64> {
        let (low, high) = RANGE;
        let within = self.variance.zip_map(&given.diagonal(), |variance, given| {
            variance.clamp(low * low * given, high * high * given)
        });
        Matrix3::from_diagonal(&within)
    }

    /// Returns the standard deviation of positions, m.
    pub(super) fn position_m(&self) -> f64 {
        self.variance.x.sqrt()
    }

    /// Takes a new pose that is believed: its differences from the prediction, and from the estimate after it.
    pub(super) fn observe(
        &mut self,
        time_s: f64,
        innovation: &Vector3<f64>,
        residual: Vector3<f64>,
    ) {
        let before = self
            .newest
            .filter(|newest| (0.0..GAP_S).contains(&(time_s - newest.time_s)));
        let missed = before.map(|before| innovation - before.residual);
        if let (Some(missed), Some(last)) = (missed, before.and_then(|before| before.missed)) {
            let square = (missed - last).map(|w| w * w / 6.0);
            let square = square.zip_map(&self.variance, |square, variance| {
                square.min(OUTLIER * OUTLIER * variance)
            });
            // Both directions of the ground alike.
            let position = 0.5 * (square.x + square.y);
            self.poses = (self.poses + 1.0).min(AVERAGED);
            self.variance +=
                (Vector3::new(position, position, square.z) - self.variance) / self.poses;
        }
        self.newest = Some(Newest {
            time_s,
            residual,
            missed,
        });
    }

    /// Begins anew after a pose that is not believed.
    pub(super) fn interrupt(&mut self) {
        self.newest = None;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};

    const GIVEN_SIGMAS: PoseSigmas = PoseSigmas {
        position_m: 0.01,
        heading_rad: 0.01,
    };

    /// Returns the standard deviations found, over those given, of poses with `factor` times the noise given and an error
    /// of dead reckoning of `drift` in each interval; `gain` is that of a filter, which must not matter.
    fn found(factor: f64, drift: f64, gain: f64, interval_s: f64) -> Vector3<f64> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(1);
        let mut noise = PoseNoise::new(&GIVEN_SIGMAS);
        let mut estimate = Vector3::zeros();
        for k in 0..400 {
            let truth = Vector3::repeat(drift * f64::from(k));
            let normal = Vector3::from_fn(|_, _| StandardNormal.sample(&mut random));
            let pose: Vector3<f64> = truth + factor * 0.01 * normal;
            let innovation = pose - estimate;
            estimate += gain * innovation;
            noise.observe(interval_s * f64::from(k), &innovation, pose - estimate);
        }
        noise
            .covariance(&GIVEN_SIGMAS.covariance())
            .diagonal()
            .map(|variance: f64| variance.sqrt() / 0.01)
    }

    #[test]
    fn noise_is_found_whatever_the_filter_does_and_whatever_velocity_is_wrong() {
        for factor in [0.7, 1.0, 2.0] {
            for (drift, gain) in [(0.0, 0.2), (0.0, 0.8), (0.01, 0.5)] {
                let sigmas = found(factor, drift, gain, 0.1);
                assert!(
                    (sigmas / factor).iter().all(|s| (0.85..1.15).contains(s)),
                    "{factor} {drift} {gain}: {sigmas}"
                );
            }
        }
    }

    #[test]
    fn it_stays_within_a_range_around_the_settings() {
        assert!((found(0.01, 0.0, 0.5, 0.1) - Vector3::repeat(0.5)).norm() < 1e-9);
        assert!((found(30.0, 0.0, 0.5, 0.1) - Vector3::repeat(10.0)).norm() < 1e-9);
    }

    #[test]
    fn poses_far_apart_tell_nothing() {
        assert_eq!(found(2.0, 0.0, 0.5, 2.0), Vector3::repeat(1.0));
    }

    #[test]
    fn an_outlier_counts_for_little() {
        let mut noise = PoseNoise::new(&GIVEN_SIGMAS);
        for k in 0..300 {
            let off = if k == 250 { 1.0 } else { 0.0 };
            let innovation = Vector3::repeat(off);
            noise.observe(0.1 * f64::from(k), &innovation, Vector3::zeros());
        }
        assert!(noise.covariance(&GIVEN_SIGMAS.covariance())[(0, 0)] <= 0.25 * 1e-4 + 1e-12);
    }
}
