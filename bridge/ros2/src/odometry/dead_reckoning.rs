//! Dead reckoning by the vehicle's best model, with a covariance that grows with the way.

use nalgebra::Matrix3;
use sidehill_bridge::ros2::odometry::OdometryState;
use sidehill_plant::dead_reckoning::{StepMotion, advance_between};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::odometry::{KinematicModel, VelocityModel};
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
    model: VelocityModel,
    timeout_s: f64,
    newest: Option<(f64, StepMotion)>,
    pose: Pose,
    covariance: Matrix3<f64>,
    gaps: u64,
}

impl DeadReckoning {
    /// Returns dead reckoning that begins at the origin, heading along x in ROS axes.
    pub(super) fn new(vehicle: &Vehicle, timeout_s: f64) -> Self {
        Self {
            model: VelocityModel::new(KinematicModel::best_for(vehicle), vehicle),
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
    /// they are not newer than those before.
    ///
    /// Over a gap longer than the timeout nothing is known of the motion: the pose stays, and the
    /// covariance grows by the way at the newest speed.
    pub(super) fn take(
        &mut self,
        speeds: Stamped<MeasuredTreadSpeeds>,
        attitude: Attitude,
    ) -> Option<OdometryState> {
        let velocity = self.model.body_velocity(attitude, speeds.value);
        let motion = StepMotion { velocity, attitude };
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
    use crate::server::test_data::j8;
    use nalgebra::Vector3;
    use sidehill_plant::contact::{ContactModel, ContactVehicle};
    use sidehill_plant::motion::{GroundState, MotionModel};

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
        let mut reckoning = DeadReckoning::new(&j8(), 0.5);
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

    fn vehicle(file: &str) -> Vehicle {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles");
        let file = std::fs::File::open(format!("{folder}/{file}")).unwrap();
        serde_yaml::from_reader(file).unwrap()
    }

    /// Pose of a differential drive whose treads are as far apart as the J8's tread ICRs: wheel odometry.
    fn count_wheels(
        pose: &mut Pose,
        dt_s: f64,
        from: MeasuredTreadSpeeds,
        to: MeasuredTreadSpeeds,
    ) {
        let between = |of: fn(&MeasuredTreadSpeeds) -> f64| 0.5 * (of(&from) + of(&to));
        let (left, right) = (between(|s| s.left_m_s), between(|s| s.right_m_s));
        let turn_rad = dt_s * (right - left) / (1.073 + 0.980);
        let way_m = 0.5 * dt_s * (left + right);
        let yaw_rad = pose.yaw_rad + 0.5 * turn_rad;
        pose.x_m -= way_m * yaw_rad.sin();
        pose.y_m += way_m * yaw_rad.cos();
        pose.yaw_rad += turn_rad;
    }

    #[test]
    fn known_wheels_drift_a_tenth_of_what_wheel_odometry_does_on_10_deg() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../config/vehicles");
        let file = std::fs::File::open(format!("{folder}/j8_contact.yaml")).unwrap();
        let wheels: ContactVehicle = serde_yaml::from_reader(file).unwrap();
        let slope_rad = 10_f64.to_radians();
        let (normal, dt_s) = (Vector3::new(0.0, -slope_rad.sin(), slope_rad.cos()), 0.02);
        // Twenty drives of a minute: turns of all periods, begun in all directions.
        for drive in 0..20 {
            let share = |step: f64| (f64::from(drive) * step).fract();
            let (period_s, heading) = (
                10.0 + 25.0 * share(0.618),
                std::f64::consts::TAU * share(0.414),
            );
            let speeds_at = |time_s: f64| {
                let steer = 0.25 * (std::f64::consts::TAU * time_s / period_s).sin() + 0.05;
                let begin = (0.5 * time_s).min(1.0);
                MeasuredTreadSpeeds {
                    left_m_s: begin * (0.5 - steer),
                    right_m_s: begin * (0.5 + steer),
                }
            };
            let mut plant = ContactModel::new(wheels.clone());
            let mut velocity_at = |time_s: f64, yaw_rad: f64| {
                let attitude = Attitude::on_plane(&normal, yaw_rad);
                let ground = GroundState {
                    attitude,
                    ..GroundState::default()
                };
                let treads = j8().encoder_scale.apply(speeds_at(time_s));
                let velocity = plant.body_velocity(&ground, treads, 0.0).unwrap();
                StepMotion { velocity, attitude }
            };
            let mut reckoning = DeadReckoning::new(&vehicle("j8_wheels_identified.yaml"), 0.5);
            let start = Pose {
                yaw_rad: heading,
                ..Pose::default()
            };
            reckoning.pose = start;
            let (mut truth, mut counted) = (start, start);
            let (mut model_drift, mut wheel_drift) = (0.0, 0.0);
            let mut motion = velocity_at(0.0, truth.yaw_rad);
            reckoning.take(
                Stamped {
                    time_s: 0.0,
                    value: speeds_at(0.0),
                },
                motion.attitude,
            );
            for step in 0..3000 {
                let (before_s, time_s) = (f64::from(step) * dt_s, f64::from(step + 1) * dt_s);
                let ahead = advance_between(&truth, dt_s, &motion, &motion);
                let next = velocity_at(time_s, ahead.yaw_rad);
                truth = advance_between(&truth, dt_s, &motion, &next);
                motion = next;
                let speeds = Stamped {
                    time_s,
                    value: speeds_at(time_s),
                };
                let state = reckoning.take(speeds, motion.attitude).unwrap();
                count_wheels(&mut counted, dt_s, speeds_at(before_s), speeds_at(time_s));
                let off = |pose: &Pose| (pose.x_m - truth.x_m).hypot(pose.y_m - truth.y_m);
                model_drift += off(&state.pose).powi(2);
                wheel_drift += off(&counted).powi(2);
            }
            let ratio = (model_drift / wheel_drift).sqrt();
            assert!(ratio < 0.1, "drive {drive}: {ratio}");
        }
    }

    #[test]
    fn old_readings_and_gaps_move_nothing() {
        let mut reckoning = DeadReckoning::new(&j8(), 0.5);
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
        let mut reckoning = DeadReckoning::new(&j8(), 0.5);
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
