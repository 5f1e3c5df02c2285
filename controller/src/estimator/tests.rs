#![allow(clippy::unwrap_used)]

use super::filter::HISTORY;
use super::learned::LearnedModel;
use super::*;
use nalgebra::{DMatrix, DVector, SVector, Vector3};
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use sidehill_plant::frames::{Attitude, PlanarPose, Pose, pose_rate, wrap_angle};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::{MeasuredTreadSpeeds, TreadSpeeds};

fn estimator() -> Filter<SlipModel, GAINS> {
    let settings = EstimatorSettings::default();
    Filter::new(settings, SlipModel::new(Vehicle::j8(), settings.adaptation))
}

fn nothing(time_s: f64) -> Sample {
    Sample {
        time_s,
        tread_speeds: None,
        attitude: None,
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

/// A reading of one kind at its own time.
fn reading(time_s: f64, (kind, a, b, c): (u8, f64, f64, f64)) -> Sample {
    let mut sample = nothing(time_s);
    match kind {
        0 => {
            let speeds = MeasuredTreadSpeeds {
                left_m_s: a,
                right_m_s: b,
            };
            sample.tread_speeds = stamped(time_s, speeds);
        }
        1 => {
            let attitude = Attitude {
                roll_rad: 0.2 * a,
                pitch_rad: 0.2 * b,
            };
            sample.attitude = stamped(time_s, attitude);
        }
        _ => {
            let pose = PlanarPose {
                x_m: 0.2 * a,
                y_m: 0.2 * b,
                yaw_rad: 0.2 * c,
            };
            sample.pose = stamped(time_s, pose_at(&pose));
        }
    }
    sample
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn the_order_of_arrival_does_not_matter(
        (in_order, shuffled) in prop::collection::vec(
            (0..3_u8, -1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64),
            2..40,
        )
        .prop_map(|readings| {
            readings
                .into_iter()
                .enumerate()
                .map(|(i, values)| reading(0.02 * (i + 1) as f64, values))
                .collect::<Vec<_>>()
        })
        .prop_flat_map(|readings| (Just(readings.clone()), Just(readings).prop_shuffle())),
    ) {
        let run = |readings: &[Sample]| {
            let mut estimator = estimator();
            estimator.update(&Truth::new(3.0).sample(0.0));
            for reading in readings {
                estimator.update(reading);
            }
            estimator.update(&nothing(2.0)).0.unwrap()
        };
        let (a, b) = (run(&in_order), run(&shuffled));
        prop_assert_eq!(a.pose, b.pose);
        prop_assert_eq!(a.covariance, b.covariance);
        prop_assert_eq!(a.attitude, b.attitude);
        prop_assert_eq!(a.treads, b.treads);
        prop_assert_eq!(a.attitude_age_s, b.attitude_age_s);
        prop_assert_eq!(a.speeds_age_s, b.speeds_age_s);
    }

    #[test]
    fn the_covariance_stays_symmetric_and_positive(
        readings in prop::collection::vec(
            (0..3_u8, -1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64, 0.0..0.3_f64),
            1..200,
        ),
    ) {
        let mut estimator = estimator();
        estimator.update(&Truth::new(3.0).sample(0.0));
        for (i, (kind, a, b, c, late_s)) in readings.into_iter().enumerate() {
            let now_s = 0.05 * (i + 1) as f64;
            let mut sample = reading((now_s - late_s).max(0.0), (kind, a, b, c));
            sample.time_s = now_s;
            let covariance = estimator.update(&sample).0.unwrap().covariance;
            let asymmetry = (covariance - covariance.transpose()).abs().max();
            prop_assert!(asymmetry <= 1e-12 * covariance.max(), "{covariance}");
            prop_assert!(covariance.cholesky().is_some(), "{covariance}");
        }
    }
}

#[test]
fn readings_older_than_the_memory_have_no_effect() {
    let run = |ancient: bool| {
        let mut truth = Truth::new(5.0);
        let mut estimator = estimator();
        let first = truth.sample(0.0);
        for cycle in 0..100 {
            estimator.update(&truth.sample(0.05 * f64::from(cycle)));
            truth.drive(0.05);
        }
        if ancient {
            let mut sample = nothing(5.0);
            sample.pose = first.pose;
            estimator.update(&sample);
        }
        assert!(estimator.readings_kept() <= HISTORY);
        estimator.update(&nothing(5.0)).0
    };
    assert_eq!(run(true), run(false));
}

#[test]
fn outliers_are_gated_and_persistent_ones_make_the_pose_stale() {
    let mut truth = Truth::new(5.0);
    let mut estimator = estimator();
    for cycle in 0..20 {
        estimator.update(&truth.sample(0.05 * f64::from(cycle)));
        truth.drive(0.05);
    }
    for outlier in 1..=10 {
        let time_s = 0.95 + 0.05 * f64::from(outlier);
        let mut sample = truth.sample(time_s);
        sample.pose.as_mut().unwrap().value.x_m += 3.0;
        let estimate = estimator.update(&sample).0.unwrap();
        assert!(distance_m(&estimate, &truth.pose) < 0.01);
        assert_eq!(estimate.poses_gated, outlier);
        assert!((estimate.pose_age_s - 0.05 * f64::from(outlier)).abs() < 1e-9);
        let innovation = estimator.innovation().unwrap();
        assert!(innovation.normalised > EstimatorSettings::default().gate);
        assert!((innovation.difference.x - 3.0).abs() < 0.01);
        truth.drive(0.05);
    }
    let estimate = estimator.update(&truth.sample(1.5)).0.unwrap();
    assert_eq!(estimate.poses_gated, 0);
    assert_eq!(estimate.pose_age_s, 0.0);
    assert!(estimator.innovation().unwrap().normalised < 1.0);
}

#[test]
fn readings_that_are_not_finite_are_named_and_left_out() {
    let truth = Truth::new(5.0);
    for value in [f64::NAN, f64::INFINITY] {
        let good = truth.sample(0.1);
        let mut spoiled = Vec::new();
        for field in 0..4 {
            let mut sample = good;
            let speeds = sample.tread_speeds.as_mut().unwrap();
            match field {
                0 => speeds.value.left_m_s = value,
                1 => speeds.value.right_m_s = value,
                _ => speeds.time_s = value,
            }
            spoiled.push((
                sample,
                Refused {
                    tread_speeds: true,
                    ..Refused::default()
                },
            ));
            let mut sample = good;
            let attitude = sample.attitude.as_mut().unwrap();
            match field {
                0 => attitude.value.roll_rad = value,
                1 => attitude.value.pitch_rad = value,
                _ => attitude.time_s = value,
            }
            spoiled.push((
                sample,
                Refused {
                    attitude: true,
                    ..Refused::default()
                },
            ));
            let mut sample = good;
            let pose = sample.pose.as_mut().unwrap();
            match field {
                0 => pose.value.x_m = value,
                1 => pose.value.y_m = value,
                2 => pose.value.yaw_rad = value,
                _ => pose.time_s = value,
            }
            spoiled.push((
                sample,
                Refused {
                    pose: true,
                    ..Refused::default()
                },
            ));
        }
        for (sample, expected) in spoiled {
            let mut with = estimator();
            let mut without = estimator();
            with.update(&truth.sample(0.0));
            without.update(&truth.sample(0.0));
            let (estimate, refused) = with.update(&sample);
            assert_eq!(refused, expected);
            assert!(refused.any());
            let left_out = Sample {
                time_s: sample.time_s,
                tread_speeds: sample.tread_speeds.filter(|_| !expected.tread_speeds),
                attitude: sample.attitude.filter(|_| !expected.attitude),
                pose: sample.pose.filter(|_| !expected.pose),
            };
            assert_eq!(without.update(&left_out), (estimate, Refused::default()));
        }
    }
}

/// Normalised squared errors (3 degrees of freedom) of runs in which everything is as the filter
/// believes: the vehicle slides at random by `slide` times what it expects, poses are noisy and
/// come 0.1 s late.
fn normalised_errors(seed: u64, slide: f64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut gaussian = move |deviation: f64| -> f64 {
        let draw: f64 = StandardNormal.sample(&mut random);
        deviation * draw
    };
    let settings = EstimatorSettings::default();
    let mut truth = Truth::new(8.0);
    let mut estimator = estimator();
    let mut in_flight = Vec::new();
    let mut errors = Vec::new();
    for cycle in 0..80 {
        let time_s = 0.05 * f64::from(cycle);
        let mut sample = truth.sample(time_s);
        let noisy = sample.pose.as_mut().unwrap();
        noisy.value.x_m += gaussian(settings.pose_sigma_m);
        noisy.value.y_m += gaussian(settings.pose_sigma_m);
        noisy.value.yaw_rad += gaussian(settings.pose_sigma_rad);
        if cycle > 0 {
            in_flight.push(*noisy);
            let arrived = in_flight[0].time_s + 0.1 <= time_s + 1e-9;
            sample.pose = (arrived && cycle % 2 == 0).then(|| in_flight[0]);
            if arrived {
                in_flight.remove(0);
            }
        }
        let estimate = estimator.update(&sample).0.unwrap();
        let error = Vector3::new(
            estimate.pose.x_m - truth.pose.x_m,
            estimate.pose.y_m - truth.pose.y_m,
            wrap_angle(estimate.pose.yaw_rad - truth.pose.yaw_rad),
        );
        let inverse = estimate.covariance.try_inverse().unwrap();
        errors.push((error.transpose() * inverse * error).x);
        truth.drive(0.05);
        let root = slide * 0.05_f64.sqrt();
        truth.pose.x_m += gaussian(root * settings.slide_sigma_m_per_sqrt_s);
        truth.pose.y_m += gaussian(root * settings.slide_sigma_m_per_sqrt_s);
        truth.pose.yaw_rad += gaussian(root * settings.yaw_sigma_rad_per_sqrt_s);
    }
    errors
}

#[test]
fn the_covariance_is_that_of_the_errors() {
    const RUNS: u64 = 200;
    let mean_of = |slide: f64| -> Vec<f64> {
        let runs: Vec<_> = (0..RUNS)
            .map(|seed| normalised_errors(seed, slide))
            .collect();
        (0..runs[0].len())
            .map(|cycle| runs.iter().map(|run| run[cycle]).sum::<f64>() / RUNS as f64)
            .collect()
    };
    // The sum over runs is chi-square distributed with 3 RUNS degrees of freedom: mean 3 and
    // standard deviation sqrt(6/RUNS) of the average. Bounds at 3.3 of them, 0.1 %.
    let bound = 3.3 * (6.0 / RUNS as f64).sqrt();
    let mean_as_believed = mean_of(1.0);
    for cycle in [0, 1, 10, 39, 79] {
        let mean = mean_as_believed[cycle];
        assert!((mean - 3.0).abs() < bound, "cycle {cycle}: {mean}");
    }
    let surprised = mean_of(3.0)[79];
    assert!(surprised > 3.0 + bound, "{surprised}");
}

/// Normalised squared errors of pose and parameters together at the end of runs in which everything is
/// as the filter believes, parameters drawn from their prior and drifting included.
fn normalised_errors_of_all<M: LearnedModel<N>, const N: usize>(model: &M, seed: u64) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut gaussian = move |deviation: f64| -> f64 {
        let draw: f64 = StandardNormal.sample(&mut random);
        deviation * draw
    };
    const DT_S: f64 = 0.05;
    let settings = EstimatorSettings::default();
    let prior = model.prior();
    let slope = 8.0_f64.to_radians();
    let normal = Vector3::new(0.0, -slope.sin(), slope.cos());
    let mut filter = Filter::new(settings, model.clone());
    let mut parameters: SVector<f64, N> =
        SVector::from_fn(|i, _| prior.mean[i] + gaussian(prior.sigma[i]));
    let mut pose = Vector3::new(1.0, 2.0, gaussian(1.0));
    let cycles = 200;
    for cycle in 0..=cycles {
        let time_s = DT_S * f64::from(cycle);
        let phase = 0.9 * time_s;
        let treads = TreadSpeeds {
            left_m_s: 0.3 - 0.3 * phase.sin(),
            right_m_s: 0.3 + 0.3 * phase.sin(),
        };
        let attitude_before = Attitude::on_plane(&normal, pose.z);
        if cycle > 0 {
            let drift = model.drift(treads, DT_S);
            let (velocity, _) = model.velocity(attitude_before, treads, &parameters);
            let start = pose_rate(&velocity, &attitude_before, pose.z);
            let middle = pose_rate(
                &velocity,
                &attitude_before,
                pose.z + 0.5 * DT_S * start.yaw_rad_s,
            );
            let (slide, turn) = model.process_noise(&settings);
            let root = DT_S.sqrt();
            pose += DT_S * Vector3::new(middle.x_m_s, middle.y_m_s, middle.yaw_rad_s)
                + Vector3::new(
                    gaussian(root * slide),
                    gaussian(root * slide),
                    gaussian(root * turn),
                );
            for i in 0..N {
                parameters[i] = prior.mean[i]
                    + drift.keep[i] * (parameters[i] - prior.mean[i])
                    + gaussian(drift.variance[i].sqrt());
            }
        }
        let noisy = PlanarPose {
            x_m: pose.x + gaussian(settings.pose_sigma_m),
            y_m: pose.y + gaussian(settings.pose_sigma_m),
            yaw_rad: pose.z + gaussian(settings.pose_sigma_rad),
        };
        let sample = Sample {
            time_s,
            tread_speeds: stamped(time_s, model.encoder_scale().invert(treads)),
            attitude: stamped(time_s, Attitude::on_plane(&normal, pose.z)),
            pose: stamped(time_s, pose_at(&noisy)),
        };
        filter.update(&sample);
    }
    let belief = filter.newest().unwrap();
    let mut error = DVector::zeros(3 + N);
    let mut covariance = DMatrix::zeros(3 + N, 3 + N);
    for i in 0..3 {
        error[i] = pose[i] - belief.mean[i];
    }
    error[2] = wrap_angle(error[2]);
    for i in 0..N {
        error[3 + i] = parameters[i] - belief.parameters[i];
    }
    covariance
        .view_mut((0, 0), (3, 3))
        .copy_from(&belief.covariance);
    covariance.view_mut((0, 3), (3, N)).copy_from(&belief.cross);
    covariance
        .view_mut((3, 0), (N, 3))
        .copy_from(&belief.cross.transpose());
    covariance
        .view_mut((3, 3), (N, N))
        .copy_from(&belief.parameter_covariance);
    let solved = covariance.cholesky().unwrap().solve(&error);
    error.dot(&solved)
}

/// Checks the mean over 200 runs: chi-square distributed with 3 + N degrees of freedom each. Bounds at 3.3
/// standard deviations, and `nonlinear` for what a linearised filter may be off.
fn check_whole_state<M: LearnedModel<N>, const N: usize>(model: &M, nonlinear: f64) {
    const RUNS: u64 = 200;
    let freedom = (3 + N) as f64;
    let total: f64 = (0..RUNS)
        .map(|seed| normalised_errors_of_all(model, seed))
        .sum();
    let mean = total / RUNS as f64;
    let bound = 3.3 * (2.0 * freedom / RUNS as f64).sqrt() + nonlinear * freedom;
    assert!(
        (mean - freedom).abs() < bound,
        "{mean}, not {freedom} +- {bound}"
    );
}

#[test]
fn the_covariance_of_pose_and_gains_is_that_of_the_errors() {
    let adaptation = AdaptationSettings {
        forgetting_per_m: 0.01,
        ..AdaptationSettings::default()
    };
    check_whole_state(&SlipModel::new(Vehicle::j8(), adaptation), 0.03);
}

fn learned_contact(settings: ContactLearningSettings) -> LearnedContact {
    let vehicle = Vehicle::j8();
    let contact = ContactPrediction::new(&vehicle.contact_vehicle()).unwrap();
    LearnedContact::new(&vehicle, contact, settings)
}

#[test]
fn the_covariance_of_pose_and_contact_parameters_is_that_of_the_errors() {
    // Small enough for a linearisation to hold, and for the ranges to be nothing.
    let settings = ContactLearningSettings {
        prior_factor: 0.2,
        ..ContactLearningSettings::default()
    };
    check_whole_state(&learned_contact(settings), 0.05);
}

#[test]
fn what_is_not_excited_stays_at_its_prior_and_says_so() {
    let settings = EstimatorSettings::default();
    let mut filter = Filter::new(settings, learned_contact(settings.contact));
    let straight = TreadSpeeds {
        left_m_s: 0.4,
        right_m_s: 0.4,
    };
    let mut estimate = None;
    for cycle in 0..400 {
        let time_s = 0.05 * f64::from(cycle);
        let pose = PlanarPose {
            y_m: 0.4 * time_s,
            ..PlanarPose::default()
        };
        estimate = filter
            .update(&Sample {
                time_s,
                tread_speeds: stamped(time_s, Vehicle::j8().encoder_scale.invert(straight)),
                attitude: stamped(time_s, Attitude::LEVEL),
                pose: stamped(time_s, pose_at(&pose)),
            })
            .0;
    }
    let learned = estimate.unwrap().contact.unwrap();
    // On level ground, straight ahead, a height or a share of friction moves nothing.
    for parameter in [
        sidehill_plant::contact::Parameter::CentreHeight,
        sidehill_plant::contact::Parameter::LateralShare,
        sidehill_plant::contact::Parameter::InnerShare,
    ] {
        let i = parameter.index();
        assert!(
            learned.sigma[i] > 0.99 * learned.prior_sigma[i],
            "{parameter:?}"
        );
        assert!(
            learned.sigma[i] <= 1.000_001 * learned.prior_sigma[i],
            "{parameter:?}"
        );
    }
}
