//! How dead reckoning becomes uncertain: slowly in steady motion, faster while the velocity changes.

use nalgebra::{Matrix3, Vector3};

/// Growth of the uncertainty of dead reckoning besides that of the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ProcessNoise {
    /// Of the position, m/sqrt(s).
    pub(super) slide: f64,
    /// Of the heading, rad/sqrt(s).
    pub(super) turn: f64,
    /// Of the heading while it follows a gyroscope, rad/sqrt(s).
    pub(super) gyro: f64,
    /// Of the heading by the model, as far as a gyroscope shows it, rad/sqrt(s).
    pub(super) shown: f64,
    /// Lag with which the vehicle may follow the model's velocity, s.
    pub(super) lag_s: f64,
}

impl ProcessNoise {
    /// Returns the covariance that (x, y, yaw) gain in `time_s`; `factor` is one on the variance, and `to_world`
    /// turns the body's axes into those of the world.
    ///
    /// A vehicle whose velocity changes may be late: its velocity u_l follows that of the model, u, with the lag
    /// T, or at once. An error of u - u_l that lasts about T adds 2 T (u - u_l)^2 to the variances in a second.
    pub(super) fn covariance(
        &self,
        time_s: f64,
        factor: f64,
        missing: &Vector3<f64>,
        to_world: &Matrix3<f64>,
    ) -> Matrix3<f64> {
        let steady = [self.slide, self.slide, self.turn].map(|s| factor * time_s * s.powi(2));
        let lag = 2.0 * self.lag_s * time_s * missing.component_mul(missing);
        Matrix3::from_diagonal(&steady.into())
            + to_world * Matrix3::from_diagonal(&lag) * to_world.transpose()
    }

    /// Returns the variance of the difference between a reading of the gyroscope and the model's yaw rate,
    /// (rad/s)^2: that of the model's heading over `time_s`, the time since the reading before, and the gyroscope's own.
    pub(super) fn yaw_rate(&self, time_s: f64, factor: f64, missing_rad_s: f64) -> f64 {
        let model = factor * self.shown.powi(2) + 2.0 * self.lag_s * missing_rad_s.powi(2);
        (model + self.gyro.powi(2)) / time_s
    }

    /// Returns the late velocity `time_s` on, that of the model being `missing` from it.
    pub(super) fn followed(
        &self,
        late: &Vector3<f64>,
        missing: &Vector3<f64>,
        time_s: f64,
    ) -> Vector3<f64> {
        // Of no lag and no time as well, where a quotient would be no number.
        let lag_s = self.lag_s.max(f64::MIN_POSITIVE);
        late + (1.0 - (-time_s / lag_s).exp()) * missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_a_lag_the_velocity_is_followed_at_once_and_in_no_time_not_at_all() {
        let noise = |lag_s| ProcessNoise {
            slide: 0.01,
            turn: 0.01,
            gyro: 0.001,
            shown: 0.02,
            lag_s,
        };
        let (late, missing) = (Vector3::new(0.1, 0.2, 0.3), Vector3::repeat(0.5));
        let at_once = noise(0.0).followed(&late, &missing, 0.05);
        assert!((at_once - late - missing).norm() < 1e-12);
        for lag_s in [0.0, 0.1] {
            assert_eq!(noise(lag_s).followed(&late, &missing, 0.0), late);
        }
    }
}
