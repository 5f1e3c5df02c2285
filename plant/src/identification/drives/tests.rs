use super::*;
use crate::drive_train::{DriveTrain, DriveTrainConfig};
use crate::test_support::motors;
use proptest::prelude::*;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use rand_distr::{Distribution, StandardNormal};

/// Commands that hold for random times, to `size_m_s`, through simulated drives; speeds are read at 20 Hz with noise.
fn drive(yaml: &str, size_m_s: f64, noise_m_s: f64, seed: u64) -> DriveRecord {
    const DT_S: f64 = 0.005;
    let config: DriveTrainConfig = serde_yaml::from_str(yaml).unwrap();
    let mut drives = DriveTrain::new(&config, DT_S);
    let mut random = ChaCha8Rng::seed_from_u64(seed);
    let mut record = DriveRecord::default();
    let mut command = MotorSpeeds::STOP;
    let mut until = 0;
    for step in 0..24_000_u32 {
        let time_s = f64::from(step) * DT_S;
        if step == until {
            let mut uniform = || random.next_u64() as f64 / u64::MAX as f64;
            command = motors(
                size_m_s * (2.0 * uniform() - 1.0),
                size_m_s * (2.0 * uniform() - 1.0),
            );
            // The control period is ten steps.
            until += 10 * (4.0 + 40.0 * uniform()) as u32;
        }
        if step % 10 == 0 {
            record.commands.push(TimedSpeeds {
                time_s,
                speeds: command,
            });
        }
        let speeds = drives.step(command);
        if step % 10 == 9 {
            let mut noise =
                || -> f64 { noise_m_s * Distribution::<f64>::sample(&StandardNormal, &mut random) };
            let speeds = motors(speeds.traction_m_s + noise(), speeds.steer_m_s + noise());
            record.measured.push(TimedSpeeds {
                time_s: time_s + DT_S,
                speeds,
            });
        }
    }
    record
}

fn found(record: DriveRecord) -> [MotorResponse; 2] {
    let found = identify_drives(&[record]).unwrap();
    [found.traction.unwrap(), found.steer.unwrap()]
}

fn assert_near(finding: Finding, expected: f64, tolerance: f64) {
    let Finding::Found { value, interval } = finding else {
        panic!("{finding:?}, expected {expected}");
    };
    assert!(
        (value - expected).abs() < tolerance,
        "{finding:?}, expected {expected}"
    );
    // Half a step of the simulation is inherent in when a command begins to act.
    assert!(
        interval.0 - 0.1 * tolerance - 0.006 < expected,
        "{finding:?}, expected {expected}"
    );
    assert!(
        interval.1 + 0.1 * tolerance + 0.006 > expected,
        "{finding:?}, expected {expected}"
    );
}

#[test]
fn delay_lag_gain_and_limits_of_simulated_drives_are_found() {
    let record = drive(
        "{delay_s: 0.2, traction: {time_constant_s: 0.3, gain: 0.9, speed_max_m_s: 0.4, acceleration_max_m_s2: 0.6},
          steer: {time_constant_s: 0.15, deceleration_max_m_s2: 1.0, dead_band_m_s: 0.1}}",
        0.8,
        0.01,
        1,
    );
    let [traction, steer] = found(record);
    assert_near(traction.delay_s, 0.2, 0.02);
    assert_near(traction.time_constant_s, 0.3, 0.03);
    assert_near(traction.gain, 0.9, 0.02);
    assert_near(traction.speed_max_m_s, 0.4, 0.005);
    assert_near(traction.acceleration_max_m_s2, 0.6, 0.03);
    assert!(
        matches!(traction.deceleration_max_m_s2, Finding::AtLeast(rate) if rate > 1.0),
        "{traction:?}"
    );
    assert_near(steer.delay_s, 0.2, 0.02);
    assert_near(steer.time_constant_s, 0.15, 0.02);
    assert_near(steer.gain, 1.0, 0.01);
    assert_near(steer.deceleration_max_m_s2, 1.0, 0.05);
    assert_near(steer.dead_band_m_s, 0.1, 0.02);
    assert!(
        matches!(steer.speed_max_m_s, Finding::AtLeast(speed) if speed > 0.7),
        "{steer:?}"
    );
}

#[test]
fn what_was_never_reached_is_a_bound_and_never_a_value() {
    let record = drive(
        "{traction: {speed_max_m_s: 0.5, time_constant_s: 0.1}, steer: {speed_max_m_s: 0.5, time_constant_s: 0.1}}",
        0.4,
        0.01,
        2,
    );
    for motor in found(record) {
        let bound = |finding| matches!(finding, Finding::AtLeast(_));
        assert!(
            bound(motor.speed_max_m_s) && bound(motor.acceleration_max_m_s2),
            "{motor:?}"
        );
        assert!(
            matches!(motor.speed_max_m_s, Finding::AtLeast(speed) if speed <= 0.41),
            "{motor:?}"
        );
        assert!(
            matches!(motor.dead_band_m_s, Finding::AtMost(band) if band < 0.1),
            "{motor:?}"
        );
        assert!((motor.residual_m_s - 0.01).abs() < 0.001, "{motor:?}");
    }
}

#[test]
fn a_motor_that_was_never_driven_has_no_response() {
    let mut record = drive("{}", 0.5, 0.01, 3);
    for timed in &mut record.commands {
        timed.speeds.steer_m_s = 0.0;
    }
    let found = identify_drives(std::slice::from_ref(&record)).unwrap();
    assert!(found.traction.is_some() && found.steer.is_none());
    for timed in &mut record.commands {
        timed.speeds = MotorSpeeds::STOP;
    }
    let driven_otherwise = identify_drives(&[record]).unwrap_err();
    assert!(
        driven_otherwise
            .to_string()
            .contains("no command ever changed")
    );
    let nothing = identify_drives(&[DriveRecord::default()]).unwrap_err();
    assert!(nothing.to_string().contains("0 measured speeds"));
}

#[test]
fn a_motor_that_is_always_at_its_limit_says_nothing_of_its_gain() {
    let mut record = drive("{traction: {speed_max_m_s: 0.1}}", 0.5, 0.005, 4);
    // Full speed one way or the other.
    let full = |speeds: &mut MotorSpeeds| speeds.traction_m_s = 0.5 * speeds.traction_m_s.signum();
    record
        .commands
        .iter_mut()
        .for_each(|timed| full(&mut timed.speeds));
    for timed in &mut record.measured {
        timed.speeds.traction_m_s = 0.1 * timed.speeds.traction_m_s.signum();
    }
    let traction = identify_drives(&[record]).unwrap().traction.unwrap();
    let reaches = traction.gain.value().map_or_else(
        || traction.speed_max_m_s.value().unwrap(),
        |gain| gain * traction.command_max_m_s,
    );
    assert!((reaches - 0.1).abs() < 0.005, "{traction:?}");
}

#[test]
fn gaps_and_several_records_change_nothing() {
    let yaml = "{delay_s: 0.1, traction: {time_constant_s: 0.2, speed_max_m_s: 0.3}}";
    let whole = drive(yaml, 0.6, 0.01, 5);
    let mut torn = whole.clone();
    torn.measured.retain(|timed| timed.time_s % 20.0 > 4.0);
    for records in [vec![torn], vec![whole.clone(), drive(yaml, 0.6, 0.01, 6)]] {
        let traction = identify_drives(&records).unwrap().traction.unwrap();
        assert_near(traction.delay_s, 0.1, 0.02);
        assert_near(traction.time_constant_s, 0.2, 0.03);
        assert_near(traction.speed_max_m_s, 0.3, 0.005);
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    #[test]
    fn responses_scale_with_speed_and_mirror(seed in 10..1000u64, factor in 0.5..3.0f64) {
        let record = drive("{delay_s: 0.15, traction: {time_constant_s: 0.2, speed_max_m_s: 0.4}}", 0.6, 0.005, seed);
        let mut scaled = record.clone();
        for timed in scaled.commands.iter_mut().chain(&mut scaled.measured) {
            timed.speeds = motors(-factor * timed.speeds.traction_m_s, factor * timed.speeds.steer_m_s);
        }
        let one = found(record)[0];
        let other = found(scaled)[0];
        let near = |a: Finding, b: Finding, scale: f64| (a.value().unwrap() * scale - b.value().unwrap()).abs() < 5e-3 * scale;
        prop_assert!(near(one.delay_s, other.delay_s, 1.0), "{one:?} {other:?}");
        prop_assert!(near(one.time_constant_s, other.time_constant_s, 1.0));
        prop_assert!(near(one.gain, other.gain, 1.0));
        prop_assert!(near(one.speed_max_m_s, other.speed_max_m_s, factor));
    }
}

proptest! {
    #[test]
    fn motion_in_closed_form_is_that_of_the_drive_train_in_small_steps(
        targets in prop::collection::vec(-1.0..1.0f64, 1..6),
        lag_s in 0.02..0.5f64,
        acceleration in 0.3..5.0f64,
        deceleration in 0.3..5.0f64,
        limited in 0..4,
    ) {
        let (accelerates, brakes) = (limited & 1 == 1, limited & 2 == 2);
        let rate = |on: bool, key: &str, value: f64| if on { format!(", {key}: {value}") } else { String::new() };
        let yaml = format!(
            "{{traction: {{time_constant_s: {lag_s}{}{}}}}}",
            rate(accelerates, "acceleration_max_m_s2", acceleration),
            rate(brakes, "deceleration_max_m_s2", deceleration)
        );
        const DT_S: f64 = 1e-4;
        let mut drives = DriveTrain::new(&serde_yaml::from_str(&yaml).unwrap(), DT_S);
        let model = MotorModel {
            time_constant_s: lag_s,
            acceleration_m_s2: if accelerates { acceleration } else { f64::INFINITY },
            deceleration_m_s2: if brakes { deceleration } else { f64::INFINITY },
            ..FREE
        };
        let mut speed = 0.0;
        for target in targets {
            let reached = (0..2000).map(|_| drives.step(motors(target, 0.0)).traction_m_s).last().unwrap();
            speed = model.toward(speed, target, 2000.0 * DT_S);
            prop_assert!((speed - reached).abs() < 2e-3, "{speed} {reached} {yaml}");
            speed = reached;
        }
    }
}
