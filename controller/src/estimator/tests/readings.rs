//! Readings that are late, out of order, far off or not finite.

use super::super::filter::HISTORY;
use super::*;
use proptest::prelude::*;

/// An estimator that believes each pose and the gyroscope: what contradicts is judged in the order of arrival.
fn believing() -> Filter<SlipModel, GAINS> {
    let settings = EstimatorSettings {
        pose_sigma_rad: 1.0,
        gate: 1e6,
        ..settings()
    };
    Filter::new(settings, SlipModel::new(Vehicle::j8(), settings.adaptation))
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
        2 => sample.yaw_rate = stamped(time_s, 0.02 * a),
        _ => {
            let pose = PlanarPose {
                x_m: 0.2 * a,
                y_m: 0.2 * b,
                yaw_rad: 0.02 * c,
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
            (0..4_u8, -1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64),
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
            let mut estimator = believing();
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
            (0..4_u8, -1.0..1.0_f64, -1.0..1.0_f64, -1.0..1.0_f64, 0.0..0.3_f64),
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
fn a_late_pose_counts_up_to_an_age_at_any_rate_of_readings() {
    for (period_s, late_s, counts) in [
        (0.01, 1.3, true),
        (0.01, 1.7, false),
        (0.05, 1.3, true),
        (0.05, 1.7, false),
    ] {
        let cycles = (5.0_f64 / period_s).round() as u32;
        let run = |late: bool| {
            let mut truth = Truth::new(5.0);
            let mut estimator = estimator();
            let mut before = None;
            for cycle in 0..=cycles {
                let time_s = period_s * f64::from(cycle);
                let mut sample = truth.sample(time_s);
                if time_s < 5.0 - late_s {
                    before = sample.pose;
                }
                // All readings but poses, which have stopped.
                sample.pose = sample.pose.filter(|_| time_s < 3.0);
                sample.yaw_rate = stamped(time_s, 0.0);
                estimator.update(&sample);
                truth.drive(period_s);
            }
            let mut sample = nothing(5.0);
            sample.pose = before.filter(|_| late).map(|mut pose| {
                pose.value.x_m += 0.01;
                pose
            });
            estimator.update(&sample);
            assert!(estimator.readings_kept() <= HISTORY);
            estimator.update(&nothing(5.0)).0.unwrap()
        };
        let (with, without) = (run(true), run(false));
        let case = format!("{period_s} s: {late_s} s");
        assert_eq!(with.pose != without.pose, counts, "{case}");
        assert_eq!(with.poses_late, u32::from(!counts), "{case}");
        assert_eq!(without.poses_late, 0, "{case}");
    }
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
        assert!(innovation.normalised > settings().gate);
        assert!((innovation.difference.x - 3.0).abs() < 0.01);
        truth.drive(0.05);
    }
    let estimate = estimator.update(&truth.sample(1.5)).0.unwrap();
    assert_eq!(estimate.poses_gated, 0);
    assert_eq!(estimate.pose_age_s, 0.0);
    assert!(estimator.innovation().unwrap().normalised < 1.0);
}

fn refused(of: impl Fn(&mut Refused)) -> Refused {
    let mut refused = Refused::default();
    of(&mut refused);
    refused
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
            spoiled.push((sample, refused(|refused| refused.tread_speeds = true)));
            let mut sample = good;
            let attitude = sample.attitude.as_mut().unwrap();
            match field {
                0 => attitude.value.roll_rad = value,
                1 => attitude.value.pitch_rad = value,
                _ => attitude.time_s = value,
            }
            spoiled.push((sample, refused(|refused| refused.attitude = true)));
            let mut sample = good;
            sample.yaw_rate = if field == 0 {
                stamped(0.1, value)
            } else {
                stamped(value, 0.1)
            };
            spoiled.push((sample, refused(|refused| refused.yaw_rate = true)));
            let mut sample = good;
            let pose = sample.pose.as_mut().unwrap();
            match field {
                0 => pose.value.x_m = value,
                1 => pose.value.y_m = value,
                2 => pose.value.yaw_rad = value,
                _ => pose.time_s = value,
            }
            spoiled.push((sample, refused(|refused| refused.pose = true)));
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
                yaw_rate: sample.yaw_rate.filter(|_| !expected.yaw_rate),
                pose: sample.pose.filter(|_| !expected.pose),
            };
            assert_eq!(without.update(&left_out), (estimate, Refused::default()));
        }
    }
}

/// Settings say 1 cm; the noise that poses show decides what the next one counts for.
#[test]
fn poses_that_are_noisier_than_the_settings_say_count_for_less() {
    let shift_m = |noise_m: f64| {
        let mut truth = Truth::new(3.0);
        let mut estimator = estimator();
        for k in 0..200 {
            let mut sample = truth.sample(0.1 * f64::from(k));
            if let Some(pose) = &mut sample.pose {
                pose.value.x_m += noise_m * [1.0, -1.0, 0.0, -1.0, 1.0, 0.0][k as usize % 6];
            }
            estimator.update(&sample);
            truth.drive(0.1);
        }
        let mut last = truth.sample(20.0);
        let before = estimator.update(&Sample { pose: None, ..last }).0.unwrap();
        if let Some(pose) = &mut last.pose {
            pose.value.x_m = before.pose.x_m + 0.03;
        }
        estimator.update(&last).0.unwrap().pose.x_m - before.pose.x_m
    };
    let (calm_m, noisy_m) = (shift_m(0.0), shift_m(0.03));
    assert!(noisy_m < 0.7 * calm_m, "{noisy_m} {calm_m}");
}
