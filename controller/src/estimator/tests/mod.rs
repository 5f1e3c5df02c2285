#![allow(clippy::unwrap_used)]

mod consistency;
mod gyroscope;
mod late;
mod learning;
mod readings;

use super::*;
use nalgebra::Vector3;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose, pose_rate, wrap_angle};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::{MeasuredTreadSpeeds, TreadSpeeds};

/// Settings with which what is tested is seen within seconds: more is uncertain, and nothing is smoothed.
fn settings() -> EstimatorSettings {
    EstimatorSettings {
        slide_sigma_m_per_sqrt_s: 0.02,
        yaw_sigma_rad_per_sqrt_s: 0.02,
        gate: 30.0,
        normal_filter_s: 0.0,
        adaptation: AdaptationSettings {
            slope_sigma: 0.7,
            forgetting_per_m: 0.001,
            ..AdaptationSettings::default()
        },
        contact: ContactLearningSettings {
            friction_forgetting_per_m: 0.05,
            ..ContactLearningSettings::default()
        },
        ..EstimatorSettings::default()
    }
}

fn estimator() -> Filter<SlipModel, GAINS> {
    let settings = settings();
    Filter::new(settings, SlipModel::new(Vehicle::j8(), settings.adaptation))
}

fn nothing(time_s: f64) -> Sample {
    Sample {
        time_s,
        tread_speeds: None,
        attitude: None,
        yaw_rate: None,
        pose: None,
    }
}

fn pose_at(pose: &PlanarPose) -> Pose {
    Pose {
        x_m: pose.x_m,
        y_m: pose.y_m,
        z_m: 0.0,
        yaw_rad: pose.yaw_rad,
    }
}

fn stamped<T>(time_s: f64, value: T) -> Option<Stamped<T>> {
    Some(Stamped { time_s, value })
}

/// A vehicle on a plane, driven by the exact model.
struct Truth {
    vehicle: Vehicle,
    normal_in_world: Vector3<f64>,
    treads: TreadSpeeds,
    pose: PlanarPose,
}

impl Truth {
    fn new(slope_deg: f64) -> Self {
        let slope = slope_deg.to_radians();
        Self {
            vehicle: Vehicle::j8(),
            normal_in_world: Vector3::new(0.0, -slope.sin(), slope.cos()),
            treads: TreadSpeeds {
                left_m_s: 0.3,
                right_m_s: 0.5,
            },
            pose: PlanarPose::default(),
        }
    }

    fn attitude(&self) -> Attitude {
        Attitude::on_plane(&self.normal_in_world, self.pose.yaw_rad)
    }

    fn drive(&mut self, time_s: f64) {
        let steps = 100;
        let dt_s = time_s / f64::from(steps);
        for _ in 0..steps {
            let rate_at = |yaw_rad| {
                let attitude = Attitude::on_plane(&self.normal_in_world, yaw_rad);
                let velocity = self.vehicle.body_velocity(attitude, self.treads);
                pose_rate(&velocity, &attitude, yaw_rad)
            };
            let start = rate_at(self.pose.yaw_rad);
            let middle = rate_at(self.pose.yaw_rad + 0.5 * dt_s * start.yaw_rad_s);
            self.pose.x_m += dt_s * middle.x_m_s;
            self.pose.y_m += dt_s * middle.y_m_s;
            self.pose.yaw_rad += dt_s * middle.yaw_rad_s;
        }
    }

    fn sample(&self, time_s: f64) -> Sample {
        let treads = MeasuredTreadSpeeds {
            left_m_s: self.treads.left_m_s / self.vehicle.encoder_scale.left,
            right_m_s: self.treads.right_m_s / self.vehicle.encoder_scale.right,
        };
        Sample {
            time_s,
            tread_speeds: stamped(time_s, treads),
            attitude: stamped(time_s, self.attitude()),
            yaw_rate: None,
            pose: stamped(time_s, pose_at(&self.pose)),
        }
    }
}

fn distance_m(estimate: &Estimate, truth: &PlanarPose) -> f64 {
    (estimate.pose.x_m - truth.x_m).hypot(estimate.pose.y_m - truth.y_m)
}

#[test]
fn nothing_is_known_before_an_attitude_and_a_pose() {
    let truth = Truth::new(5.0);
    let mut estimator = estimator();
    assert_eq!(estimator.update(&nothing(0.0)).0, None);
    let sample = truth.sample(0.05);
    let only_pose = Sample {
        attitude: None,
        ..sample
    };
    assert_eq!(estimator.update(&only_pose).0, None);
    let only_attitude = Sample {
        pose: None,
        ..sample
    };
    assert_eq!(estimator.update(&only_attitude).0, None);
    let (estimate, refused) = estimator.update(&truth.sample(0.1));
    let estimate = estimate.unwrap();
    assert!(!refused.any());
    assert_eq!(estimate.pose, truth.pose);
    assert_eq!(estimate.pose_age_s, 0.0);
    assert!((estimate.normal_in_world - truth.normal_in_world).norm() < 1e-12);
}

#[test]
fn perfect_readings_reproduce_the_truth() {
    for slope_deg in [0.0, 10.0] {
        let mut truth = Truth::new(slope_deg);
        let mut estimator = estimator();
        for cycle in 0..400 {
            let time_s = 0.05 * f64::from(cycle);
            let mut sample = truth.sample(time_s);
            if cycle % 2 == 1 {
                sample.pose = None;
            }
            let estimate = estimator.update(&sample).0.unwrap();
            // Between readings the attitude is held, which costs a little on a slope.
            assert!(distance_m(&estimate, &truth.pose) < 2e-4);
            assert!((estimate.pose.yaw_rad - truth.pose.yaw_rad).abs() < 1e-4);
            assert_eq!(estimate.attitude, truth.attitude());
            truth.drive(0.05);
        }
    }
}

#[test]
fn dead_reckoning_carries_on_without_poses() {
    let mut truth = Truth::new(10.0);
    let mut estimator = estimator();
    for cycle in 0..200 {
        let mut sample = truth.sample(0.05 * f64::from(cycle));
        if cycle > 0 {
            sample.pose = None;
        }
        let estimate = estimator.update(&sample).0.unwrap();
        assert!(distance_m(&estimate, &truth.pose) < 0.01);
        assert!((estimate.pose_age_s - 0.05 * f64::from(cycle)).abs() < 1e-9);
        truth.drive(0.05);
    }
    let estimate = estimator.update(&nothing(10.0)).0.unwrap();
    let deviation_m = estimate.covariance[(0, 0)].sqrt();
    // 0.02 m/sqrt(s) over 10 s, and what the heading's growth adds.
    assert!(deviation_m > 0.02 * 10.0_f64.sqrt(), "{deviation_m}");
}

#[test]
fn an_offset_of_the_poses_headings_is_learned_by_driving_and_not_by_standing() {
    let offset_rad = 0.02;
    let heading_off_rad = |speed_m_s: f64| {
        let mut truth = Truth::new(0.0);
        truth.treads = TreadSpeeds {
            left_m_s: speed_m_s,
            right_m_s: speed_m_s,
        };
        let mut estimator = estimator();
        let mut off_rad = f64::NAN;
        for cycle in 0..4000 {
            let mut sample = truth.sample(0.05 * f64::from(cycle));
            sample.pose.as_mut().unwrap().value.yaw_rad += offset_rad;
            let estimate = estimator.update(&sample).0.unwrap();
            off_rad = wrap_angle(estimate.pose.yaw_rad - truth.pose.yaw_rad);
            truth.drive(0.05);
        }
        off_rad
    };
    let (driven, stood) = (heading_off_rad(0.4), heading_off_rad(0.0));
    assert!(driven.abs() < 0.15 * offset_rad, "{driven}");
    assert!((stood - offset_rad).abs() < 1e-9, "{stood}");
}

#[test]
fn a_late_pose_counts_at_its_own_time() {
    let mut truth = Truth::new(0.0);
    truth.treads = TreadSpeeds {
        left_m_s: 1.0,
        right_m_s: 1.0,
    };
    let mut estimator = estimator();
    estimator.update(&truth.sample(0.0));
    let mut late = None;
    for cycle in 1..=20 {
        truth.drive(0.05);
        let time_s = 0.05 * f64::from(cycle);
        let mut sample = truth.sample(time_s);
        if cycle == 10 {
            late = sample.pose;
        }
        sample.pose = None;
        estimator.update(&sample);
    }
    let mut late = late.unwrap();
    late.value.x_m += 0.01;
    let sample = Sample {
        pose: Some(late),
        ..nothing(1.0)
    };
    let estimate = estimator.update(&sample).0.unwrap();
    // Half a metre behind by now, it moves the estimate sideways and not back.
    assert!(
        (estimate.pose.y_m - truth.pose.y_m).abs() < 1e-3,
        "{estimate:?}"
    );
    assert!(
        estimate.pose.x_m > 0.005 && estimate.pose.x_m < 0.02,
        "{estimate:?}"
    );
    assert!((estimate.pose_age_s - 0.5).abs() < 1e-9);
    let innovation = estimator.innovation().unwrap();
    assert!((innovation.difference - Vector3::new(0.01, 0.0, 0.0)).norm() < 1e-9);
    assert_eq!(innovation.time_s, late.time_s);
}
