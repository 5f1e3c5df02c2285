//! A gyroscope beside poses: one that is right, and ones that are not.

use super::super::belief::Belief;
use super::super::gains::Kept;
use super::super::gate::PoseSigmas;
use super::super::gyro::YawRate;
use super::super::learned::LearnedModel;
use super::consistency::learned_contact;
use super::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use sidehill_plant::frames::wrap_angle;

/// Turn that the treads give but the vehicle does not make, rad/s.
const SLIPS_RAD_S: f64 = 0.1;

/// Root mean square of the heading's error in the second half of 20 s, rad, and the last estimate. The vehicle winds and
/// turns slower than its treads say; `read` is what the gyroscope makes of the yaw rate.
fn drive(read: impl Fn(f64) -> Option<f64>) -> (f64, Estimate) {
    let mut random = ChaCha8Rng::seed_from_u64(7);
    let settings = settings();
    let adaptation = AdaptationSettings {
        shift_sigma: 0.0,
        slope_sigma: 0.0,
        ..settings.adaptation
    };
    let mut model = SlipModel::new(Vehicle::j8(), adaptation);
    let mut filter = Filter::new(settings, model.clone());
    let (mut yaw_rad, mut squares, mut last) = (0.0, 0.0, None);
    for cycle in 0..=400 {
        let time_s = 0.05 * f64::from(cycle);
        let steer_m_s = 0.3 * (0.5 * time_s).sin();
        let treads = TreadSpeeds {
            left_m_s: -steer_m_s,
            right_m_s: steer_m_s,
        };
        let (velocity, _) = model.velocity(Attitude::LEVEL, treads, &model.prior().mean);
        let rate_rad_s = velocity.yaw_rate_rad_s - SLIPS_RAD_S * (0.5 * time_s).sin();
        if cycle > 0 {
            yaw_rad += 0.05 * rate_rad_s;
        }
        let noise: f64 = StandardNormal.sample(&mut random);
        let pose = PlanarPose {
            yaw_rad: yaw_rad + settings.pose_sigma_rad * noise,
            ..PlanarPose::default()
        };
        let sample = Sample {
            time_s,
            tread_speeds: stamped(time_s, model.encoder_scale().invert(treads)),
            attitude: stamped(time_s, Attitude::LEVEL),
            yaw_rate: read(rate_rad_s).and_then(|read| stamped(time_s, read)),
            pose: stamped(time_s, pose_at(&pose)),
        };
        let estimate = filter.update(&sample).0.unwrap();
        if cycle > 200 {
            squares += wrap_angle(estimate.pose.yaw_rad - yaw_rad).powi(2) / 200.0;
        }
        last = Some(estimate);
    }
    (f64::sqrt(squares), last.unwrap())
}

#[test]
fn the_heading_follows_a_gyroscope_and_its_bias_is_found() {
    let (without_rad, estimate) = drive(|_| None);
    assert_eq!(estimate.gyro_bias_rad_s, None);
    for bias_rad_s in [0.0, 0.03, -0.03] {
        let (with_rad, estimate) = drive(|rate_rad_s| Some(rate_rad_s + bias_rad_s));
        assert!(with_rad < 0.5 * without_rad, "{with_rad}, {without_rad}");
        let found_rad_s = estimate.gyro_bias_rad_s.unwrap();
        assert!((found_rad_s - bias_rad_s).abs() < 0.005, "{found_rad_s}");
    }
}

#[test]
fn an_error_of_the_gyroscopes_scale_is_found() {
    let (right_rad, _) = drive(Some);
    for scale in [1.05, 0.96] {
        let (scaled_rad, _) = drive(|rate_rad_s| Some(scale * rate_rad_s));
        assert!(
            scaled_rad < 1.2 * right_rad,
            "{scale}: {scaled_rad}, {right_rad}"
        );
    }
}

#[test]
fn a_gyroscope_that_poses_contradict_is_left_out() {
    let wrong: [(&str, &dyn Fn(f64) -> f64); 4] = [
        ("another sign", &|rate_rad_s| -rate_rad_s),
        ("nothing", &|_| 0.0),
        ("deg/s", &f64::to_degrees),
        ("stuck", &|_| 0.5),
    ];
    for (reads, read) in wrong {
        let (with_rad, estimate) = drive(|rate_rad_s| Some(read(rate_rad_s)));
        assert_eq!(estimate.gyro_bias_rad_s, None, "{reads}");
        // Poses count for more for a while after they were doubted: their noise at most.
        let pose_rad = settings().pose_sigma_rad;
        assert!(with_rad < pose_rad, "{reads}: {with_rad}");
    }
}

#[test]
fn a_reading_far_from_the_models_yaw_rate_teaches_nothing() {
    let settings = settings();
    let mut model = learned_contact(settings.contact);
    let prior = model.prior();
    let kept = Kept {
        mean: prior.mean,
        covariance: prior.covariance(),
    };
    let treads = TreadSpeeds {
        left_m_s: 0.2,
        right_m_s: 0.6,
    };
    let before = Belief::at(
        &PlanarPose::default(),
        &PoseSigmas::of(&settings),
        settings.gyro_bias_sigma_rad_s,
        kept,
        treads,
        Attitude::LEVEL,
        model.velocity(Attitude::LEVEL, treads, &prior.mean).into(),
    );
    let yaw_rate_rad_s = before.moving.state.velocity.z;
    let noise = model.process_noise(&settings);
    let mut after = |off_rad_s: f64| {
        let mut belief = before;
        let read = YawRate {
            time_s: 0.05,
            rad_s: yaw_rate_rad_s + off_rad_s,
        };
        belief.correct_yaw_rate(&mut model, &noise, 1.0, read, settings.gate);
        belief
    };
    let told = after(0.01);
    assert!((told.parameters - before.parameters).norm() > 1e-4);
    assert!(told.parameter_covariance.trace() < before.parameter_covariance.trace());
    let refused = after(50.0);
    assert_eq!(refused.mean, before.mean);
    assert_eq!(refused.parameters, before.parameters);
    assert_eq!(refused.parameter_covariance, before.parameter_covariance);
}
