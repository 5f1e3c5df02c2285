//! Dead reckoning by the slope model, with a covariance that grows with the way.

use super::OdometryState;
use nalgebra::Matrix3;
use sidehill_plant::dead_reckoning::{Motion, advance_between};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::odometry::KinematicModel;
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Standard deviation of the way after 1 m, m; it grows with the root of the way. That of the heading, rad,
/// after 1 rad of turning.
///
/// Chosen to cover the drift of the J8 on the contact plant at 10 deg, which is systematic: with another
/// vehicle it is that of its identification.
const WAY_STD_M: f64 = 0.05;
const TURN_STD_RAD: f64 = 0.05;

/// Poses from tread speeds and attitude.
pub(super) struct DeadReckoning {
    vehicle: Vehicle,
    timeout_s: f64,
    newest: Option<(f64, Motion)>,
    pose: Pose,
    covariance: Matrix3<f64>,
    gaps: u64,
}

impl DeadReckoning {
    /// Returns dead reckoning that begins at the origin, heading along x in ROS axes.
    pub(super) fn new(vehicle: Vehicle, timeout_s: f64) -> Self {
        Self {
            vehicle,
            timeout_s,
            newest: None,
            pose: Pose {
                yaw_rad: -std::f64::consts::FRAC_PI_2,
                ..Pose::default()
            },
            covariance: Matrix3::zeros(),
            gaps: 0,
        }
    }

    /// Takes tread speeds with the attitude that holds for them, and returns the state then; none where
    /// they are no newer than those before.
    ///
    /// Over a gap longer than the timeout nothing is known of the motion: the pose stays, and the
    /// covariance grows by the way at the newest speed.
    pub(super) fn take(
        &mut self,
        speeds: Stamped<MeasuredTreadSpeeds>,
        attitude: Attitude,
    ) -> Option<OdometryState> {
        let velocity =
            KinematicModel::Extended.body_velocity(&self.vehicle, attitude, speeds.value);
        let motion = Motion { velocity, attitude };
        if let Some((before_s, from)) = self.newest {
            let dt_s = speeds.time_s - before_s;
            if dt_s <= 0.0 {
                return None;
            }
            let way_m = dt_s * velocity.forward_m_s.hypot(velocity.right_m_s);
            if dt_s <= self.timeout_s {
                let next = advance_between(&self.pose, dt_s, &from, &motion);
                let turn_rad = (next.yaw_rad - self.pose.yaw_rad).abs();
                self.grow(&next, way_m, turn_rad);
                self.pose = next;
            } else {
                self.gaps += 1;
                let variance = way_m.powi(2);
                self.covariance[(0, 0)] += variance;
                self.covariance[(1, 1)] += variance;
            }
        }
        self.newest = Some((speeds.time_s, motion));
        Some(OdometryState {
            time_s: speeds.time_s,
            pose: self.pose,
            attitude,
            velocity,
            covariance: self.covariance,
            velocity_std_m_s: WAY_STD_M,
            yaw_rate_std_rad_s: TURN_STD_RAD,
        })
    }

    /// Returns how often readings were missing for longer than the timeout.
    pub(super) fn gaps(&self) -> u64 {
        self.gaps
    }

    /// Forgets the newest reading: the clock has jumped.
    pub(super) fn forget(&mut self) {
        self.newest = None;
    }

    fn grow(&mut self, next: &Pose, way_m: f64, turn_rad: f64) {
        // An error of the heading displaces all that is driven after it.
        let (dx, dy) = (next.x_m - self.pose.x_m, next.y_m - self.pose.y_m);
        let forward = Matrix3::new(1.0, 0.0, -dy, 0.0, 1.0, dx, 0.0, 0.0, 1.0);
        self.covariance = forward * self.covariance * forward.transpose();
        let way_variance = WAY_STD_M.powi(2) * way_m;
        self.covariance[(0, 0)] += way_variance;
        self.covariance[(1, 1)] += way_variance;
        self.covariance[(2, 2)] += TURN_STD_RAD.powi(2) * turn_rad;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::server::test_data::j8;

    fn speeds(time_s: f64, left_m_s: f64, right_m_s: f64) -> Stamped<MeasuredTreadSpeeds> {
        Stamped {
            time_s,
            value: MeasuredTreadSpeeds {
                left_m_s,
                right_m_s,
            },
        }
    }

    /// Roll of 10 deg, as across a slope with its right side down.
    const ACROSS: Attitude = Attitude {
        roll_rad: 0.175,
        pitch_rad: 0.0,
    };

    #[test]
    fn a_pivot_across_the_slope_slides_as_the_model_says() {
        let mut reckoning = DeadReckoning::new(j8(), 0.5);
        let mut state = reckoning.take(speeds(0.0, -0.3, 0.3), ACROSS).unwrap();
        let velocity = j8().extended().extended_velocity(
            ACROSS,
            j8().encoder_scale.apply(speeds(0.0, -0.3, 0.3).value),
        );
        assert_eq!(state.velocity, velocity);
        assert!(velocity.right_m_s > 0.0, "downhill");
        for index in 1..=10 {
            state = reckoning
                .take(speeds(0.1 * f64::from(index), -0.3, 0.3), ACROSS)
                .unwrap();
        }
        let way_m = state.pose.x_m.hypot(state.pose.y_m);
        assert!(way_m > 0.5 * velocity.right_m_s && state.covariance[(2, 2)] > 0.0);
    }

    #[test]
    fn old_readings_and_gaps_move_nothing() {
        let mut reckoning = DeadReckoning::new(j8(), 0.5);
        let start = reckoning
            .take(speeds(1.0, 0.5, 0.5), Attitude::LEVEL)
            .unwrap();
        assert!(
            reckoning
                .take(speeds(1.0, 0.5, 0.5), Attitude::LEVEL)
                .is_none()
        );
        assert!(
            reckoning
                .take(speeds(0.9, 0.5, 0.5), Attitude::LEVEL)
                .is_none()
        );
        let after = reckoning
            .take(speeds(3.0, 0.5, 0.5), Attitude::LEVEL)
            .unwrap();
        assert_eq!((after.pose, reckoning.gaps()), (start.pose, 1));
        assert!(after.covariance[(0, 0)] > 0.9, "a metre");
        reckoning.forget();
        let jumped = reckoning
            .take(speeds(0.0, 0.5, 0.5), Attitude::LEVEL)
            .unwrap();
        assert_eq!(jumped.pose, start.pose);
    }

    #[test]
    fn straight_on_level_ground_is_along_x_in_the_axes_of_ros() {
        let mut reckoning = DeadReckoning::new(j8(), 0.5);
        for index in 0..=20 {
            reckoning.take(speeds(0.1 * f64::from(index), 0.5, 0.5), Attitude::LEVEL);
        }
        let pose = reckoning.pose;
        assert!(
            (pose.x_m - 1.0).abs() < 0.02 && pose.y_m.abs() < 0.02,
            "{pose:?}"
        );
    }
}
