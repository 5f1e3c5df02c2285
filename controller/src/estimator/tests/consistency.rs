//! Whether the covariance is that of the errors: normalised estimation error squared (NEES) over many runs.

use super::super::belief::{OFFSET_SIGMA_RAD, SCALE_SIGMA, STATES};
use super::super::learned::{LearnedModel, Moving};
use super::*;
use nalgebra::{DMatrix, DVector, Rotation3, SVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use sidehill_plant::frames::{BodyVelocity, wrap_angle};

/// Normalised squared errors (3 degrees of freedom) of runs in which everything is as the filter
/// believes: the vehicle slides at random by `slide` times what it expects, poses are noisy, have
/// an offset of their headings, and come 0.1 s late.
fn normalised_errors(seed: u64, slide: f64) -> Vec<f64> {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut gaussian = move |deviation: f64| -> f64 {
        let draw: f64 = StandardNormal.sample(&mut random);
        deviation * draw
    };
    let settings = settings();
    let offset_rad = gaussian(OFFSET_SIGMA_RAD);
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
        noisy.value.yaw_rad += offset_rad + gaussian(settings.pose_sigma_rad);
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
/// as the filter believes, parameters drawn from their prior and drifting included, and the bias of a gyroscope.
fn normalised_errors_of_all<M: LearnedModel<N>, const N: usize>(
    model: &M,
    gyroscope: bool,
    seed: u64,
) -> f64 {
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut gaussian = move |deviation: f64| -> f64 {
        let draw: f64 = StandardNormal.sample(&mut random);
        deviation * draw
    };
    const DT_S: f64 = 0.05;
    let mut model = model.clone();
    let mut settings = settings();
    settings.gyro_model_sigma_rad_per_sqrt_s = model.process_noise(&settings).turn;
    let prior = model.prior();
    let slope = 8.0_f64.to_radians();
    let normal = Vector3::new(0.0, -slope.sin(), slope.cos());
    let mut filter = Filter::new(settings, model.clone());
    let mut parameters: SVector<f64, N> =
        SVector::from_fn(|i, _| prior.mean[i] + gaussian(prior.sigma[i]));
    let mut pose = Vector3::new(1.0, 2.0, gaussian(1.0));
    let mut late = Vector3::zeros();
    let mut moving: Option<Moving<N>> = None;
    let mut yaw_rate_before_rad_s = 0.0;
    let bias_rad_s = gaussian(settings.gyro_bias_sigma_rad_s);
    let offset_rad = gaussian(OFFSET_SIGMA_RAD);
    let scale = gaussian(SCALE_SIGMA);
    let cycles = 200;
    for cycle in 0..=cycles {
        let time_s = DT_S * f64::from(cycle);
        let phase = 0.9 * time_s;
        let treads = TreadSpeeds {
            left_m_s: 0.3 - 0.3 * phase.sin(),
            right_m_s: 0.3 + 0.3 * phase.sin(),
        };
        let attitude_before = Attitude::on_plane(&normal, pose.z);
        let mut read_rad_s = bias_rad_s;
        if cycle > 0 {
            let drift = model.drift(treads, DT_S);
            let before = moving.unwrap_or_else(|| {
                model
                    .velocity(attitude_before, TreadSpeeds::default(), &parameters)
                    .into()
            });
            let moved = model.moved(attitude_before, treads, &parameters, &before, DT_S);
            moving = Some(moved.end);
            let velocity = BodyVelocity::from_vector(&moved.mean.value);
            let start = pose_rate(&velocity, &attitude_before, pose.z);
            let middle = pose_rate(
                &velocity,
                &attitude_before,
                pose.z + 0.5 * DT_S * start.yaw_rad_s,
            );
            let noise = model.process_noise(&settings);
            let now = velocity.vector();
            let missing = now - late;
            late = noise.followed(&late, &missing, DT_S);
            let half_way = Rotation3::from_axis_angle(
                &Vector3::z_axis(),
                pose.z + 0.5 * DT_S * start.yaw_rad_s,
            );
            let grown = noise.covariance(DT_S, 1.0, &missing, half_way.matrix());
            let root = grown.cholesky().unwrap().l();
            let white = Vector3::from_fn(|_, _| gaussian(1.0));
            let slid = root * white;
            let turned_rad = pose.z;
            pose += DT_S * Vector3::new(middle.x_m_s, middle.y_m_s, middle.yaw_rad_s) + slid;
            let yaw_rate_rad_s = (pose.z - turned_rad) / DT_S;
            if gyroscope {
                // As the true yaw rate is at the readings, and linear between them.
                pose.z = turned_rad + 0.5 * DT_S * (yaw_rate_before_rad_s + yaw_rate_rad_s);
            }
            yaw_rate_before_rad_s = yaw_rate_rad_s;
            let of_body = velocity.yaw_rate_rad_s / middle.yaw_rad_s;
            read_rad_s += (1.0 + scale) * of_body * yaw_rate_rad_s
                + gaussian(settings.gyro_sigma_rad_per_sqrt_s / DT_S.sqrt());
            for i in 0..N {
                parameters[i] = prior.mean[i]
                    + drift.keep[i] * (parameters[i] - prior.mean[i])
                    + gaussian(drift.variance[i].sqrt());
            }
        }
        let noisy = PlanarPose {
            x_m: pose.x + gaussian(settings.pose_sigma_m),
            y_m: pose.y + gaussian(settings.pose_sigma_m),
            yaw_rad: pose.z + offset_rad + gaussian(settings.pose_sigma_rad),
        };
        let sample = Sample {
            time_s,
            tread_speeds: stamped(time_s, model.encoder_scale().invert(treads)),
            attitude: stamped(time_s, Attitude::on_plane(&normal, pose.z)),
            yaw_rate: gyroscope.then_some(()).and(stamped(time_s, read_rad_s)),
            pose: stamped(time_s, pose_at(&noisy)),
        };
        filter.update(&sample);
    }
    let belief = filter.newest().unwrap();
    let mut error = DVector::zeros(STATES + N);
    let mut covariance = DMatrix::zeros(STATES + N, STATES + N);
    let first = pose.push(bias_rad_s).push(offset_rad).push(scale) - belief.mean;
    error.rows_mut(0, STATES).copy_from(&first);
    error[2] = wrap_angle(error[2]);
    for i in 0..N {
        error[STATES + i] = parameters[i] - belief.parameters[i];
    }
    covariance
        .view_mut((0, 0), (STATES, STATES))
        .copy_from(&belief.covariance);
    covariance
        .view_mut((0, STATES), (STATES, N))
        .copy_from(&belief.cross);
    covariance
        .view_mut((STATES, 0), (N, STATES))
        .copy_from(&belief.cross.transpose());
    covariance
        .view_mut((STATES, STATES), (N, N))
        .copy_from(&belief.parameter_covariance);
    let solved = covariance.cholesky().unwrap().solve(&error);
    error.dot(&solved)
}

/// Checks the mean over 200 runs: chi-square distributed with STATES + N degrees of freedom each. Bounds at 3.3
/// standard deviations, and `nonlinear` for what a linearised filter may be off.
fn check_whole_state<M: LearnedModel<N>, const N: usize>(
    model: &M,
    gyroscope: bool,
    nonlinear: f64,
) {
    const RUNS: u64 = 200;
    let freedom = (STATES + N) as f64;
    let total: f64 = (0..RUNS)
        .map(|seed| normalised_errors_of_all(model, gyroscope, seed))
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
    let model = SlipModel::new(Vehicle::j8(), adaptation);
    for gyroscope in [false, true] {
        check_whole_state(&model, gyroscope, 0.03);
    }
}

pub(super) fn learned_contact(settings: ContactLearningSettings) -> LearnedContact {
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
    for gyroscope in [false, true] {
        check_whole_state(&learned_contact(settings), gyroscope, 0.05);
    }
}

#[test]
fn what_was_predicted_before_is_nothing_to_a_prediction() {
    let mut fresh = learned_contact(ContactLearningSettings::default());
    let prior = fresh.prior();
    let mut used = fresh.clone();
    let attitude = |roll_rad, pitch_rad| Attitude {
        roll_rad,
        pitch_rad,
    };
    let treads = |left_m_s, right_m_s| TreadSpeeds {
        left_m_s,
        right_m_s,
    };
    let other = prior.mean + prior.sigma;
    used.velocity(attitude(-0.1, 0.1), treads(-0.5, 0.8), &other);
    let of = |model: &mut LearnedContact| {
        let (found, by) = model.velocity(attitude(0.1, 0.05), treads(0.3, 0.5), &prior.mean);
        let found = Vector3::new(found.right_m_s, found.forward_m_s, found.yaw_rate_rad_s);
        (found, by)
    };
    let (a, b) = (of(&mut fresh), of(&mut used));
    assert!((a.0 - b.0).norm() < 1e-9, "{}", a.0 - b.0);
    assert!((a.1 - b.1).norm() < 1e-6, "{}", a.1 - b.1);
}
