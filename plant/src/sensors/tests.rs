use super::*;
use crate::sample::Stamped;
use proptest::prelude::*;

const DT_S: f64 = 0.005;

fn sensors(yaml: &str, seed: u64) -> Sensors {
    Sensors::new(&serde_yaml::from_str(yaml).unwrap(), seed, DT_S)
}

/// A truth that tells its step, so that a reading tells when it was taken.
fn truth(step: u64) -> Truth {
    let value = step as f64;
    Truth {
        tread_speeds: MeasuredTreadSpeeds {
            left_m_s: value,
            right_m_s: -value,
        },
        attitude: Attitude {
            roll_rad: value,
            pitch_rad: -value,
        },
        yaw_rate_rad_s: value,
        pose: Pose {
            x_m: value,
            y_m: 0.0,
            z_m: 0.0,
            yaw_rad: value,
        },
    }
}

/// Samples of every `stride`-th step.
fn samples(sensors: &mut Sensors, steps: u64, stride: u64) -> Vec<Sample> {
    let mut samples = Vec::new();
    for step in 0..steps {
        sensors.observe(step, &truth(step));
        if step % stride == 0 {
            samples.push(sensors.sample(step as f64 * DT_S));
        }
    }
    samples
}

#[test]
fn nothing_is_read_in_gaps_and_the_noise_of_the_rest_stays() {
    let with = |gaps: &str| {
        let yaml =
            format!("{{pose: {{timing: {{rate_hz: 20{gaps}}}, errors: {{noise_std_m: 0.1}}}}}}");
        let readings = samples(&mut sensors(&yaml, 3), 2000, 1).into_iter();
        readings
            .filter_map(|sample| sample.pose)
            .collect::<Vec<_>>()
    };
    let (whole, torn) = (with(""), with(", gap_s: 1, gap_every_s: 4"));
    let in_gap = |time_s: f64| time_s % 4.0 > 3.0 - 1e-9;
    let expected: Vec<_> = whole
        .iter()
        .filter(|pose| !in_gap(pose.time_s))
        .copied()
        .collect();
    assert_eq!(torn, expected);
    assert_eq!((whole.len(), torn.len()), (200, 160));
}

#[test]
fn perfect_sensors_read_the_truth_of_the_moment() {
    for (i, sample) in samples(&mut Sensors::perfect(DT_S), 100, 10)
        .into_iter()
        .enumerate()
    {
        let truth = truth(10 * i as u64);
        let time_s = sample.time_s;
        assert_eq!(
            sample.tread_speeds,
            Some(Stamped {
                time_s,
                value: truth.tread_speeds
            })
        );
        assert_eq!(
            sample.attitude,
            Some(Stamped {
                time_s,
                value: truth.attitude
            })
        );
        assert_eq!(
            sample.pose,
            Some(Stamped {
                time_s,
                value: truth.pose
            })
        );
        // A gyroscope is not on every vehicle.
        assert_eq!(sample.yaw_rate, None);
    }
}

#[test]
fn a_gyroscope_has_bias_scale_and_quantisation() {
    let yaml = "yaw_rate: {timing: {rate_hz: 100}, errors: {bias_deg_s: 2, scale_error: 0.5, quantisation_deg_s: 1}}";
    let samples = samples(&mut sensors(yaml, 1), 8, 1);
    for (step, sample) in samples.iter().enumerate() {
        let read = sample.yaw_rate.map(|read| read.value.to_degrees());
        // At 100 Hz every second step of 5 ms.
        let expected = (step % 2 == 0).then(|| (1.5 * (step as f64).to_degrees() + 2.0).round());
        match (read, expected) {
            (Some(read), Some(expected)) => assert!((read - expected).abs() < 1e-9, "{read}"),
            (read, expected) => assert_eq!(read, expected),
        }
    }
}

#[test]
fn a_reading_is_delivered_once() {
    let mut sensors = Sensors::perfect(DT_S);
    sensors.observe(0, &truth(0));
    assert!(sensors.sample(0.0).pose.is_some());
    let again = sensors.sample(0.0);
    assert!(again.pose.is_none() && again.attitude.is_none() && again.tread_speeds.is_none());
}

#[test]
fn a_rate_that_does_not_divide_the_step_does_not_drift() {
    let mut sensors = sensors("{pose: {timing: {rate_hz: 30}}}", 0);
    let stamps: Vec<f64> = samples(&mut sensors, 400_001, 1)
        .iter()
        .filter_map(|sample| sample.pose.map(|pose| pose.time_s))
        .collect();
    assert_eq!(stamps.len(), 60_001);
    for (k, stamp_s) in stamps.iter().enumerate() {
        let late_s = stamp_s - k as f64 / 30.0;
        assert!(
            (-1e-7..DT_S).contains(&late_s),
            "reading {k} is {late_s} s late"
        );
    }
}

#[test]
fn a_delay_keeps_the_stamp_of_the_measurement() {
    let mut sensors = sensors("{pose: {timing: {rate_hz: 10, delay_s: 0.12}}}", 0);
    for sample in samples(&mut sensors, 2000, 10).iter().skip(10) {
        let Some(pose) = sample.pose else { continue };
        assert_eq!(pose.value.x_m * DT_S, pose.time_s);
        let age_s = sample.time_s - pose.time_s;
        assert!((age_s - 0.15).abs() < 1e-9, "age {age_s}");
    }
}

#[test]
fn readings_nobody_asks_for_do_not_pile_up() {
    let mut sensors = sensors("{attitude: {timing: {delay_s: 0.1}}}", 0);
    for step in 0..100_000 {
        sensors.observe(step, &truth(step));
        assert!(sensors.attitude.waiting() <= 22 && sensors.pose.waiting() <= 1);
    }
}

#[test]
fn dropouts_come_at_their_share_and_a_seed_repeats_them() {
    let yaml = "{attitude: {timing: {dropout_probability: 0.3}, errors: {noise_std_deg: 1}}}";
    let run = |seed| samples(&mut sensors(yaml, seed), 20_000, 1);
    let arrived = run(7)
        .iter()
        .filter(|sample| sample.attitude.is_some())
        .count();
    assert!((13_700..14_300).contains(&arrived), "{arrived}");
    assert_eq!(run(7), run(7));
    assert_ne!(run(7), run(8));
}

#[test]
fn changing_one_sensor_leaves_the_others_as_they_were() {
    let noisy = "attitude: {errors: {noise_std_deg: 1}}";
    let one = samples(&mut sensors(&format!("{{{noisy}}}"), 3), 500, 1);
    let other_config = format!(
        "{{{noisy}, pose: {{timing: {{rate_hz: 7, dropout_probability: 0.5}}, errors: {{noise_std_m: 1}}}}}}"
    );
    let other = samples(&mut sensors(&other_config, 3), 500, 1);
    assert!(
        one.iter()
            .zip(&other)
            .all(|(a, b)| a.attitude == b.attitude)
    );
    assert!(one.iter().zip(&other).any(|(a, b)| a.pose != b.pose));
    // Within a sensor, too: dropouts do not change the noise of what still arrives.
    let lossy = "{attitude: {timing: {dropout_probability: 0.5}, errors: {noise_std_deg: 1}}}";
    let lossy = samples(&mut sensors(lossy, 3), 500, 1);
    let kept = one.iter().zip(&lossy).filter(|(_, b)| b.attitude.is_some());
    assert!(kept.clone().count() > 100);
    assert!(kept.into_iter().all(|(a, b)| a.attitude == b.attitude));
}

#[test]
fn noise_and_bias_have_their_size() {
    let yaml = "{tread_speeds: {errors: {noise_std_m_s: 0.02, bias_right_m_s: 0.1}}}";
    let mut sensors = sensors(yaml, 1);
    let (mut sum, mut squares) = ([0.0; 2], [0.0; 2]);
    let count = 40_000;
    for step in 0..count {
        sensors.observe(step, &Truth::default());
        let read = sensors
            .sample(step as f64 * DT_S)
            .tread_speeds
            .unwrap()
            .value;
        for (side, value) in [read.left_m_s, read.right_m_s].into_iter().enumerate() {
            sum[side] += value;
            squares[side] += value * value;
        }
    }
    for (side, bias) in [0.0, 0.1].into_iter().enumerate() {
        let mean = sum[side] / count as f64;
        let std = (squares[side] / count as f64 - mean * mean).sqrt();
        assert!(
            (mean - bias).abs() < 5e-4 && (std - 0.02).abs() < 4e-4,
            "{mean} {std}"
        );
    }
}

#[test]
fn keys_out_of_range_or_unknown_are_named() {
    let error = |yaml| {
        serde_yaml::from_str::<SensorsConfig>(yaml)
            .unwrap_err()
            .to_string()
    };
    assert!(error("{pose: {timing: {rate_hz: 0}}}").contains("pose.timing.rate_hz: 0"));
    assert!(
        error("{attitude: {errors: {noise_std_deg: -1}}}")
            .contains("attitude.errors.noise_std_deg")
    );
    assert!(error("{pose: {timing: {dropout_probability: 1.5}}}").contains("from 0 to 1"));
    assert!(error("{pose: {errors: {noise: 1}}}").contains("noise"));
}

proptest! {
    #[test]
    fn quantised_readings_are_multiples_near_the_truth(speed in -3.0..3.0f64) {
        let mut sensors = sensors("{tread_speeds: {errors: {quantisation_m_s: 0.05}}}", 0);
        let tread_speeds = MeasuredTreadSpeeds { left_m_s: speed, right_m_s: -speed };
        sensors.observe(0, &Truth { tread_speeds, ..Truth::default() });
        let read = sensors.sample(0.0).tread_speeds.unwrap().value.left_m_s;
        prop_assert!((read - speed).abs() <= 0.025 + 1e-12);
        let multiple = read / 0.05;
        prop_assert!((multiple - multiple.round()).abs() < 1e-9);
    }
}
