//! Whether the covariance is that of the errors: normalised estimation error squared (NEES) over many runs.

use super::super::learned::{LearnedModel, Moving};
use super::*;
use nalgebra::{DMatrix, DVector, Rotation3, SVector};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use rand_distr::{Distribution, StandardNormal};
use sidehill_plant::contact::Parameter;
use sidehill_plant::frames::{BodyVelocity, wrap_angle};

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
    let mut settings = EstimatorSettings::default();
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
            let velocity = BodyVelocity::from_vector(&moved.mean.velocity);
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
            read_rad_s += of_body * yaw_rate_rad_s
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
            yaw_rad: pose.z + gaussian(settings.pose_sigma_rad),
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
    let mut error = DVector::zeros(4 + N);
    let mut covariance = DMatrix::zeros(4 + N, 4 + N);
    let first = pose.push(bias_rad_s) - belief.mean;
    error.rows_mut(0, 4).copy_from(&first);
    error[2] = wrap_angle(error[2]);
    for i in 0..N {
        error[4 + i] = parameters[i] - belief.parameters[i];
    }
    covariance
        .view_mut((0, 0), (4, 4))
        .copy_from(&belief.covariance);
    covariance.view_mut((0, 4), (4, N)).copy_from(&belief.cross);
    covariance
        .view_mut((4, 0), (N, 4))
        .copy_from(&belief.cross.transpose());
    covariance
        .view_mut((4, 4), (N, N))
        .copy_from(&belief.parameter_covariance);
    let solved = covariance.cholesky().unwrap().solve(&error);
    error.dot(&solved)
}

/// Checks the mean over 200 runs: chi-square distributed with 4 + N degrees of freedom each. Bounds at 3.3
/// standard deviations, and `nonlinear` for what a linearised filter may be off.
fn check_whole_state<M: LearnedModel<N>, const N: usize>(
    model: &M,
    gyroscope: bool,
    nonlinear: f64,
) {
    const RUNS: u64 = 200;
    let freedom = (4 + N) as f64;
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
                yaw_rate: None,
                pose: stamped(time_s, pose_at(&pose)),
            })
            .0;
    }
    let learned = estimate.unwrap().contact.unwrap();
    // On level ground, straight ahead, a height or a share of friction moves nothing.
    for parameter in [
        Parameter::CentreHeight,
        Parameter::LateralShare,
        Parameter::InnerShare,
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

#[test]
fn friction_is_forgotten_by_the_metres_driven_and_the_centre_of_mass_by_those_steered() {
    let settings = ContactLearningSettings::default();
    let model = learned_contact(settings);
    let straight = TreadSpeeds {
        left_m_s: 0.5,
        right_m_s: 0.5,
    };
    let turn = TreadSpeeds {
        left_m_s: -0.5,
        right_m_s: 0.5,
    };
    let prior = model.prior();
    for (treads, of_friction, of_centre) in [
        (straight, settings.friction_forgetting_per_m, 0.0),
        (
            turn,
            settings.friction_forgetting_per_m + settings.forgetting_per_m,
            settings.forgetting_per_m,
        ),
    ] {
        // 5 cm.
        let drift = model.drift(treads, 0.1);
        for (parameter, per_m) in [
            (Parameter::Friction, of_friction),
            (Parameter::CentreRight, of_centre),
        ] {
            let i = parameter.index();
            let share = 0.05 * per_m;
            let variance = drift.variance[i] / prior.sigma[i].powi(2);
            assert!(
                (variance - share).abs() < 1e-12,
                "{parameter:?}: {variance}"
            );
            assert!((drift.keep[i].powi(2) - (1.0 - share)).abs() < 1e-12);
        }
    }
}

/// Traction and steer of a vehicle that weaves, m/s.
const WEAVING: fn(f64) -> (f64, f64) = |time_s| (0.4, 0.2 * (0.9 * time_s).sin());

/// Returns what is learned by poses every 50 ms in `duration_s` on a slope of 8 deg of a vehicle some of whose parameters are not those of the
/// prior; `speeds` are traction and steer over time.
fn learned_of(
    differing: &[(Parameter, f64)],
    duration_s: f64,
    speeds: impl Fn(f64) -> (f64, f64),
) -> ContactEstimate {
    let settings = EstimatorSettings::default();
    let mut model = learned_contact(settings.contact);
    let mut filter = Filter::new(settings, model.clone());
    let mut parameters = model.prior().mean;
    for (parameter, value) in differing {
        parameters[parameter.index()] = parameter.entry(*value);
    }
    let normal = Vector3::new(0.0, -8.0_f64.to_radians().sin(), 8.0_f64.to_radians().cos());
    let mut pose = PlanarPose::default();
    let mut learned = None;
    let mut moving = None;
    for cycle in 0..=(duration_s / 0.05).round() as u32 {
        let time_s = 0.05 * f64::from(cycle);
        let (traction_m_s, steer_m_s) = speeds(time_s);
        let said = TreadSpeeds {
            left_m_s: traction_m_s - steer_m_s,
            right_m_s: traction_m_s + steer_m_s,
        };
        let attitude = Attitude::on_plane(&normal, pose.yaw_rad);
        if cycle > 0 {
            let before = moving.unwrap_or_else(|| {
                let rest = TreadSpeeds::default();
                model.velocity(attitude, rest, &parameters).into()
            });
            let moved = model.moved(attitude, said, &parameters, &before, 0.05);
            moving = Some(moved.end);
            let velocity = BodyVelocity::from_vector(&moved.mean.velocity);
            let rate = pose_rate(&velocity, &attitude, pose.yaw_rad);
            pose.x_m += 0.05 * rate.x_m_s;
            pose.y_m += 0.05 * rate.y_m_s;
            pose.yaw_rad += 0.05 * rate.yaw_rad_s;
        }
        let sample = Sample {
            time_s,
            tread_speeds: stamped(time_s, model.encoder_scale().invert(said)),
            attitude: stamped(time_s, Attitude::on_plane(&normal, pose.yaw_rad)),
            yaw_rate: None,
            pose: stamped(time_s, pose_at(&pose)),
        };
        learned = filter.update(&sample).0.and_then(|e| e.contact);
    }
    learned.unwrap()
}

/// Treads that move at 70 and 75 % of what encoders say.
#[test]
fn factors_of_treads_that_slip_are_learned() {
    let truth = [(Parameter::LeftTread, 0.7), (Parameter::RightTread, 0.75)];
    let learned = learned_of(&truth, 20.0, WEAVING);
    for (parameter, factor) in truth {
        let (found, _) = learned.interval(parameter);
        assert!((found - factor).abs() < 0.02, "{parameter:?}: {found}");
        assert!(learned.observed(parameter), "{parameter:?}");
    }
}

#[test]
fn the_radius_of_a_patch_is_learned_on_the_spot_and_not_by_gentle_weaving() {
    let patch = Parameter::PatchRadius;
    let (guess_m, _) = learned_of(&[], 0.0, WEAVING).interval(patch);
    let on_the_spot = |time_s: f64| (0.0, 0.5 * (0.3 * time_s).sin());
    for radius_m in [0.0, 0.14] {
        let truth = [(patch, radius_m)];
        let learned = learned_of(&truth, 60.0, on_the_spot);
        assert!(learned.observed(patch), "{learned:?}");
        let (found_m, (low_m, high_m)) = learned.interval(patch);
        assert!((low_m..=high_m).contains(&radius_m), "{learned:?}");
        let off = |m: f64| (m * m - radius_m * radius_m).abs();
        assert!(off(found_m) < 0.8 * off(guess_m), "{found_m}");

        let learned = learned_of(&truth, 20.0, WEAVING);
        assert!(!learned.observed(patch), "{learned:?}");
        let (found_m, (low_m, high_m)) = learned.interval(patch);
        assert!((low_m..=high_m).contains(&radius_m), "{learned:?}");
        assert!((found_m - guess_m).abs() < 0.01, "{found_m}");
    }
}

#[test]
fn inertia_is_learned_by_turning_to_and_fro() {
    let inertia = Parameter::Inertia;
    let to_and_fro = |time_s: f64| (0.3, 0.4 * (3.0 * time_s).sin());
    for truth in [0.6, 1.6] {
        let learned = learned_of(&[(inertia, truth)], 60.0, to_and_fro);
        assert!(learned.observed(inertia), "{learned:?}");
        let (found, _) = learned.interval(inertia);
        assert!(
            (found - truth).abs() < 0.6 * (truth - 1.0_f64).abs(),
            "{found}, {truth}"
        );
    }
    let learned = learned_of(&[(inertia, 0.6)], 10.0, |_| (0.4, 0.0));
    assert!(!learned.observed(inertia), "{learned:?}");
}

#[test]
fn a_vehicle_that_is_known_to_have_no_inertia_has_none() {
    let vehicle = Vehicle::j8();
    let mut wheels = vehicle.contact_vehicle();
    wheels.set_inertia(0.0);
    let contact = ContactPrediction::new(&wheels).unwrap();
    let settings = ContactLearningSettings::default();
    let prior = LearnedContact::new(&vehicle, contact, settings).prior();
    let i = Parameter::Inertia.index();
    assert_eq!((prior.mean[i], prior.sigma[i]), (0.0, 0.0));
}

#[test]
fn what_was_learned_of_other_parameters_is_refused() {
    let settings = EstimatorSettings::default();
    let mut filter = Filter::new(settings, learned_contact(settings.contact));
    // Versions before had eight, ten and eleven.
    for number in [8, 10, 11] {
        let refused = filter.recall(&LearnedGains {
            mean: vec![0.0; number],
            covariance: vec![0.0; number * number],
            prior_sigma: vec![0.1; number],
        });
        assert_eq!(refused, Err("gains have another number than the model"));
    }
}
