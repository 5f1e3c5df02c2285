use super::*;
use crate::config::ControllerKind;
use crate::controller::horizon::tests::{following, sample, start};
use crate::course::{Course, Straight};

const CYCLE_S: f64 = 0.05;

/// Returns a motor that is told to reach a speed, and to gain 2 m/s^2.
fn motor(speed_m_s: f64) -> Motor {
    Motor::new(&MotorLimits {
        speed_m_s,
        acceleration_m_s2: 2.0,
        deceleration_m_s2: 2.0,
    })
}

/// Drives for a minute with commands between 0.3 and 0.7 m/s, of which no more is asked than the motor is known to
/// reach; returns the limit at the end of each second.
fn limits_m_s(speed_of: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut motor = motor(1.0);
    let mut limits_m_s = Vec::new();
    for cycle in 0..1200 {
        let wanted_m_s = 0.5 + 0.2 * (0.5 * CYCLE_S * f64::from(cycle)).sin();
        let command_m_s = wanted_m_s.min(motor.limit_m_s);
        motor.observe(speed_of(command_m_s), command_m_s, CYCLE_S);
        if cycle % 20 == 19 {
            limits_m_s.push(motor.limit_m_s);
        }
    }
    limits_m_s
}

#[test]
fn a_motor_that_reaches_less_than_it_is_told_to_has_a_limit_each_time_it_is_asked_for_more() {
    let limits_m_s = limits_m_s(|command_m_s| command_m_s.min(0.4));
    // The limit rises where the motor is asked for less, and is found again.
    assert!(
        limits_m_s[5..]
            .iter()
            .all(|limit_m_s| (0.4..0.65).contains(limit_m_s))
    );
    assert!(limits_m_s[40..].iter().any(|limit_m_s| *limit_m_s < 0.45));
}

#[test]
fn a_limit_far_below_what_was_told_is_found_and_so_is_one_that_falls() {
    let mut motor = motor(3.0);
    for (reaches_m_s, cycles) in [(0.27, 60), (0.9, 600), (0.2, 100)] {
        for _ in 0..cycles {
            let command_m_s = 1.2_f64.min(motor.limit_m_s);
            motor.observe(command_m_s.min(reaches_m_s), command_m_s, CYCLE_S);
        }
        let over_m_s = motor.limit_m_s - reaches_m_s;
        assert!((0.0..0.1).contains(&over_m_s), "{reaches_m_s}: {over_m_s}");
    }
}

#[test]
fn a_limit_that_falls_slowly_is_followed_nearly_all_the_time() {
    let (mut motor, mut over) = (motor(1.0), 0);
    for cycle in 0..3600 {
        let command_m_s = 0.46_f64.min(0.98 * motor.limit_m_s);
        let reaches_m_s = 0.228 * (1.0 - 0.005 * CYCLE_S * f64::from(cycle)).max(0.2);
        motor.observe(command_m_s.min(reaches_m_s), command_m_s, CYCLE_S);
        over += u32::from(motor.limit_m_s - reaches_m_s > 0.06);
    }
    assert!(over < 100, "{over}");
}

#[test]
fn a_motor_that_swings_late_after_its_command_has_no_limit() {
    let mut motor = motor(1.0);
    for cycle in 0..1200 {
        let at = |late_s: f64| 0.9 * (1.4 * (CYCLE_S * f64::from(cycle) - late_s)).sin();
        motor.observe(0.5 * at(0.4), at(0.0), CYCLE_S);
        assert_eq!(motor.limit_m_s, 1.0, "{cycle}");
    }
}

#[test]
fn a_motor_that_obeys_has_no_limit() {
    assert!(
        limits_m_s(|command_m_s| 0.99 * command_m_s)
            .iter()
            .all(|limit_m_s| *limit_m_s == 1.0)
    );
}

/// Holds a motor's speed and command for a time; returns the times of the readings after which it has another limit.
fn hold(motor: &mut Motor, speed_m_s: f64, command_m_s: f64, duration_s: f64) -> Vec<f64> {
    (motor.speed_m_s, motor.command_m_s) = (speed_m_s, command_m_s);
    let mut changes_s = Vec::new();
    for cycle in 1..=(duration_s / CYCLE_S).round() as u32 {
        let before_m_s = motor.limit_m_s;
        motor.observe(speed_m_s, command_m_s, CYCLE_S);
        if motor.limit_m_s != before_m_s {
            changes_s.push(CYCLE_S * f64::from(cycle));
        }
    }
    changes_s
}

#[test]
fn a_motor_has_a_limit_where_it_stays_short_of_its_command() {
    for (speed_m_s, command_m_s, limit_m_s) in [
        (0.355, 0.4, Some(0.365)),
        (0.365, 0.4, None),
        (-0.355, -0.4, Some(0.365)),
        (-0.365, -0.4, None),
        (0.78, 0.85, Some(0.79)),
        (0.795, 0.85, None),
        // It turns the other way, or friction holds it.
        (-0.2, 0.4, None),
        (0.0, 0.4, None),
        (0.015, 0.4, None),
        (0.025, 0.4, Some(0.1)),
    ] {
        let what = format!("{speed_m_s} of {command_m_s}");
        let mut motor = motor(1.0);
        let changes_s = hold(&mut motor, speed_m_s, command_m_s, 5.0);
        let Some(limit_m_s) = limit_m_s else {
            assert_eq!((motor.limit_m_s, motor.asked_m_s), (1.0, 0.0), "{what}");
            continue;
        };
        assert_eq!(changes_s.len(), 1, "{what}");
        assert!((0.4..0.46).contains(&changes_s[0]), "{what}: {changes_s:?}");
        assert!(
            (motor.limit_m_s - limit_m_s).abs() < 1e-9,
            "{what}: {motor:?}"
        );
        assert_eq!(motor.asked_m_s, command_m_s.abs(), "{what}");
    }
}

#[test]
fn a_motor_on_its_way_to_its_command_has_no_limit() {
    for (rate_m_s2, limited) in [(0.09, true), (0.11, false), (-0.09, true), (-0.11, false)] {
        let mut motor = motor(1.0);
        // Smoothed it is late.
        (motor.speed_m_s, motor.command_m_s) = (0.3 - 0.15 * rate_m_s2, 0.9);
        for cycle in 1..=20 {
            let speed_m_s = 0.3 + rate_m_s2 * CYCLE_S * f64::from(cycle);
            motor.observe(speed_m_s, 0.9, CYCLE_S);
        }
        assert_eq!(motor.limit_m_s < 1.0, limited, "{rate_m_s2}");
    }
}

#[test]
fn speeds_are_smoothed_over_a_fifth_of_a_second() {
    for (elapsed_s, share) in [(0.05, 0.25), (0.1, 0.5), (0.6, 1.0)] {
        let mut motor = motor(1.0);
        (motor.speed_m_s, motor.command_m_s) = (0.2, -0.2);
        motor.observe(0.4, 0.4, elapsed_s);
        assert!((motor.speed_m_s - (0.2 + 0.2 * share)).abs() < 1e-12);
        assert!((motor.command_m_s - (-0.2 + 0.6 * share)).abs() < 1e-12);
    }
}

#[test]
fn times_in_which_a_motor_obeys_count_against_those_in_which_it_is_short() {
    let mut motor = motor(1.0);
    assert!(hold(&mut motor, 0.3, 0.5, 0.3).is_empty());
    assert!(hold(&mut motor, 0.5, 0.5, 0.2).is_empty());
    let changes_s = hold(&mut motor, 0.3, 0.5, 0.5);
    assert!((0.3..0.36).contains(&changes_s[0]), "{changes_s:?}");
    // No more than 0.4 s are counted.
    hold(&mut motor, 0.3, 0.5, 5.0);
    hold(&mut motor, 0.5, 0.5, 0.4);
    motor.limit_m_s = 1.0;
    let changes_s = hold(&mut motor, 0.3, 0.5, 1.0);
    assert!((0.35..0.5).contains(&changes_s[0]), "{changes_s:?}");
}

#[test]
fn a_limit_rises_slowly_while_the_motor_obeys_and_is_forgotten_where_nothing_is_left_of_it() {
    let mut motor = motor(0.6);
    hold(&mut motor, 0.4, 0.55, 1.0);
    hold(&mut motor, 0.35, 0.45, 1.0);
    assert!((motor.limit_m_s - 0.36).abs() < 1e-9, "{motor:?}");
    // What it was once short of is told.
    assert_eq!(motor.asked_m_s, 0.55);
    hold(&mut motor, 0.3, 0.3, 2.0);
    assert!((motor.limit_m_s - 0.42).abs() < 1e-9, "{motor:?}");
    assert_eq!(motor.asked_m_s, 0.55);
    hold(&mut motor, 0.3, 0.3, 7.0);
    assert_eq!((motor.limit_m_s, motor.asked_m_s), (0.6, 0.0));
}

#[test]
fn a_limit_that_is_met_stays() {
    let mut motor = motor(1.0);
    motor.limit_m_s = 0.205;
    assert!(hold(&mut motor, 0.2, 0.3, 1.0).is_empty());
}

#[test]
fn motors_that_do_not_as_commanded_are_named() {
    let motor = |speed_max_m_s| LearnedMotor {
        speed_max_m_s,
        asked_m_s: 0.0,
        acceleration_max_m_s2: 1.0,
        gain: 1.0,
    };
    let mut response = DriveResponse {
        traction: motor(0.6),
        steer: motor(0.4),
        share: 1.0,
        delay_s: 0.1,
    };
    assert_eq!(response.to_string(), "");
    response.steer.asked_m_s = 0.4;
    assert_eq!(response.to_string(), "");
    response.steer.asked_m_s = 0.5;
    let steer = "the steer motor reaches 0.40 m/s of 0.50 commanded";
    assert_eq!(response.to_string(), steer);
    response.traction.asked_m_s = 0.8;
    let traction = "the traction motor reaches 0.60 m/s of 0.80 commanded";
    assert_eq!(response.to_string(), format!("{traction}; {steer}"));
    (response.traction.asked_m_s, response.share) = (0.0, 0.4);
    let scaled = "commands are scaled down to 40 %";
    assert_eq!(response.to_string(), format!("{steer}; {scaled}"));
    // What is within a tenth is no news.
    (response.steer.asked_m_s, response.share) = (0.0, 1.0);
    (response.traction.gain, response.steer.gain) = (1.09, 0.91);
    assert_eq!(response.to_string(), "");
    (response.traction.gain, response.steer.gain) = (1.2, 0.7);
    let gains = "the traction motor runs at 120 % of its commands; the steer motor runs at 70 % of its commands";
    assert_eq!(response.to_string(), gains);
}

/// Traction and steer, of which no more is commanded than they are known to reach, at speeds that lag by `lag_s` behind
/// `reached` of the command; returns the last speeds.
fn follow(
    drives: &mut Drives,
    wanted: MotorSpeeds,
    lag_s: f64,
    duration_s: f64,
    reached_m_s: impl Fn(f64) -> f64,
) -> MotorSpeeds {
    let configured = ControllerConfig::default().limits;
    let mut speeds = MotorSpeeds {
        traction_m_s: drives.traction.speed_m_s,
        steer_m_s: drives.steer.speed_m_s,
    };
    for _ in 0..(duration_s / CYCLE_S).round() as u32 {
        let limits = drives.limits(&configured);
        let command = MotorSpeeds {
            traction_m_s: wanted.traction_m_s.min(limits.traction.speed_m_s),
            steer_m_s: wanted.steer_m_s.min(limits.steer.speed_m_s),
        };
        let gain = CYCLE_S / lag_s;
        speeds.traction_m_s += gain * (reached_m_s(command.traction_m_s) - speeds.traction_m_s);
        speeds.steer_m_s += gain * (reached_m_s(command.steer_m_s) - speeds.steer_m_s);
        drives.observe_motors(speeds, command, CYCLE_S);
    }
    speeds
}

fn wanted(traction_m_s: f64) -> MotorSpeeds {
    MotorSpeeds {
        traction_m_s,
        steer_m_s: 0.5 * traction_m_s,
    }
}

#[test]
fn drives_whose_commands_are_scaled_down_go_on_as_commanded() {
    for (ratio, wanted_m_s) in [(0.25, 0.8), (0.4, 0.4), (0.6, 0.4), (0.8, 0.6), (0.8, 0.8)] {
        for lag_s in [0.1, 0.2] {
            let mut drives = Drives::new(&ControllerConfig::default());
            let share = |command_m_s: f64| ratio * command_m_s;
            follow(&mut drives, wanted(wanted_m_s), lag_s, 10.0, share);
            for _ in 0..20 {
                let speeds = follow(&mut drives, wanted(wanted_m_s), lag_s, 3.0, share);
                let what = format!("{ratio} of {wanted_m_s}, {lag_s} s: {drives:?}");
                assert!(
                    (speeds.traction_m_s - ratio * wanted_m_s).abs() < 0.01,
                    "{what}"
                );
                assert!(
                    (speeds.steer_m_s - 0.5 * speeds.traction_m_s).abs() < 0.01,
                    "{what}"
                );
                assert!((drives.response().share - ratio).abs() < 0.05, "{what}");
            }
        }
    }
}

#[test]
fn limits_of_commands_are_those_of_the_motor_over_its_share() {
    let configured = MotorLimits {
        speed_m_s: 2.0,
        acceleration_m_s2: 2.0,
        deceleration_m_s2: 2.0,
    };
    let mut slow = slow(1.0);
    slow.limit_m_s = 0.5;
    let rate_m_s2 = slow.rate.limit_m_s2();
    for (share, speed_m_s, acceleration_m_s2) in [
        (1.0, 0.5, rate_m_s2),
        (0.5, 1.0, 2.0 * rate_m_s2),
        (0.1, 2.0, 2.0),
    ] {
        let limits = slow.limits(&configured, share);
        assert!((limits.speed_m_s - speed_m_s).abs() < 1e-9, "{limits:?}");
        assert!(
            (limits.acceleration_m_s2 - acceleration_m_s2).abs() < 1e-9,
            "{limits:?}"
        );
    }
}

/// Traction and steer that swing, in metres per second, as the controller asks for them; returns the drives, whose
/// motors run at gains of the commands within largest speeds, and the last speeds and what was asked for then.
fn swing(
    gains: (f64, f64),
    largest: (f64, f64),
    duration_s: f64,
) -> (Drives, MotorSpeeds, MotorSpeeds) {
    let config = ControllerConfig::default();
    let mut drives = Drives::new(&config);
    let (mut speeds, mut asked) = (MotorSpeeds::STOP, MotorSpeeds::STOP);
    for cycle in 0..(duration_s / CYCLE_S).round() as u32 {
        let time_s = CYCLE_S * f64::from(cycle);
        let limits = drives.limits(&config.limits);
        let within = |wanted_m_s: f64, limit_m_s: f64| wanted_m_s.clamp(-limit_m_s, limit_m_s);
        asked = MotorSpeeds {
            traction_m_s: within(0.4 + 0.1 * (0.3 * time_s).sin(), limits.traction.speed_m_s),
            steer_m_s: within(0.25 * (0.5 * time_s).sin(), limits.steer.speed_m_s),
        };
        let command = drives.command(asked);
        let reached = |gain: f64, command_m_s: f64, largest_m_s: f64, before_m_s: f64| {
            before_m_s + 0.5 * (within(gain * command_m_s, largest_m_s) - before_m_s)
        };
        speeds = MotorSpeeds {
            traction_m_s: reached(
                gains.0,
                command.traction_m_s,
                largest.0,
                speeds.traction_m_s,
            ),
            steer_m_s: reached(gains.1, command.steer_m_s, largest.1, speeds.steer_m_s),
        };
        drives.observe_motors(speeds, command, CYCLE_S);
    }
    (drives, speeds, asked)
}

#[test]
fn motors_that_run_at_a_gain_of_their_commands_do_as_they_are_asked() {
    for gains in [
        (1.0, 1.0),
        (1.0, 0.5),
        (1.0, 0.7),
        (1.0, 1.5),
        (1.2, 1.0),
        (1.5, 1.0),
        (1.3, 0.7),
    ] {
        let (drives, speeds, asked) = swing(gains, (9.0, 9.0), 40.8);
        let response = drives.response();
        let found = (response.traction.gain, response.steer.gain);
        assert!((found.0 - gains.0).abs() < 0.03, "{gains:?}: {found:?}");
        assert!((found.1 - gains.1).abs() < 0.03, "{gains:?}: {found:?}");
        assert_eq!(response.share, 1.0, "{gains:?}");
        for (speed_m_s, asked_m_s) in [
            (speeds.traction_m_s, asked.traction_m_s),
            (speeds.steer_m_s, asked.steer_m_s),
        ] {
            let off_m_s = speed_m_s - asked_m_s;
            assert!(off_m_s.abs() < 0.02, "{gains:?}: {speeds:?} of {asked:?}");
        }
        assert!(asked.steer_m_s.abs() > 0.2, "{asked:?}");
    }
}

#[test]
fn a_motor_at_its_largest_speed_has_no_gain() {
    for largest_m_s in [0.05, 0.12, 0.2] {
        let (drives, ..) = swing((1.0, 1.0), (9.0, largest_m_s), 60.0);
        assert_eq!(drives.response().steer.gain, 1.0, "{largest_m_s}");
    }
}

#[test]
fn what_slows_both_motors_down_is_no_gain() {
    for share in [0.4, 0.7] {
        let (drives, speeds, asked) = swing((share, share), (9.0, 9.0), 40.8);
        let response = drives.response();
        assert!((response.share - share).abs() < 0.03, "{response:?}");
        assert!((response.steer.gain - 1.0).abs() < 0.05, "{response:?}");
        // Nothing is commanded more for it.
        let command = drives.command(asked);
        assert_eq!(command.traction_m_s, asked.traction_m_s);
        assert!((speeds.traction_m_s - share * asked.traction_m_s).abs() < 0.02);
    }
}

#[test]
fn the_gain_of_a_motor_is_not_learned_where_the_other_tells_of_no_slow_down() {
    let mut drives = Drives::new(&ControllerConfig::default());
    for cycle in 0..600 {
        let command = of_steer(0.25 * (0.5 * CYCLE_S * f64::from(cycle)).sin());
        let speeds = of_steer(0.5 * command.steer_m_s);
        drives.observe_motors(speeds, command, CYCLE_S);
    }
    assert_eq!(drives.response().steer.gain, 1.0);
}

#[test]
fn commands_are_bounded_as_configured_at_every_gain() {
    let configured = ControllerConfig::default().limits;
    let limits = |gains| swing(gains, (9.0, 9.0), 40.8).0.limits(&configured);
    let slower = limits((1.0, 0.5));
    assert_eq!(slower.traction, configured.traction);
    for (found, told) in [
        (slower.steer.speed_m_s, configured.steer.speed_m_s),
        (
            slower.steer.acceleration_m_s2,
            configured.steer.acceleration_m_s2,
        ),
        (
            slower.steer.deceleration_m_s2,
            configured.steer.deceleration_m_s2,
        ),
        (slower.tread_speed_m_s, configured.tread_speed_m_s),
    ] {
        assert!((found / told - 0.5).abs() < 0.02, "{slower:?}");
    }
    assert_eq!(limits((1.5, 1.5)), configured);
}

#[test]
fn a_limit_that_was_known_before_holds_while_commands_are_scaled_down_and_after() {
    let mut drives = Drives::new(&ControllerConfig::default());
    let weak = |command_m_s: f64| command_m_s.min(0.4);
    follow(&mut drives, wanted(0.7), 0.1, 4.0, weak);
    assert!(
        (drives.traction.limit_m_s - 0.41).abs() < 0.03,
        "{drives:?}"
    );
    follow(&mut drives, wanted(0.4), 0.1, 20.0, |command| 0.5 * command);
    assert!(drives.scale.is_scaled(), "{drives:?}");
    let limit_m_s = drives.traction.limit_m_s;
    assert!((0.4..0.6).contains(&limit_m_s), "{drives:?}");
    // Commands may be as much more.
    let allowed_m_s = drives
        .limits(&ControllerConfig::default().limits)
        .traction
        .speed_m_s;
    assert!(
        allowed_m_s > 1.8 * limit_m_s || allowed_m_s == 0.8,
        "{allowed_m_s}"
    );
    follow(&mut drives, wanted(0.7), 0.1, 4.0, weak);
    assert_eq!(drives.response().share, 1.0);
    assert!(
        (drives.traction.limit_m_s - 0.41).abs() < 0.03,
        "{drives:?}"
    );
}

#[test]
fn drives_that_are_no_longer_scaled_down_are_known_to_be_in_two_seconds() {
    let mut before = Drives::new(&ControllerConfig::default());
    follow(&mut before, wanted(0.7), 0.1, 10.0, |command| 0.4 * command);
    assert!(before.scale.is_scaled());
    for reached_m_s in [0.2, 0.5, 1.0] {
        let mut drives = before.clone();
        let reached = |command: f64| command.min(reached_m_s);
        follow(&mut drives, wanted(0.7), 0.1, 2.0, reached);
        assert_eq!(drives.response().share, 1.0, "{reached_m_s}");
        let over_m_s = drives.traction.limit_m_s - reached_m_s;
        assert!((0.0..0.15).contains(&over_m_s), "{drives:?}");
    }
}

#[test]
fn a_motor_that_is_short_of_slow_commands_is_not_tried() {
    let mut drives = Drives::new(&ControllerConfig::default());
    let reached = |command: f64| 0.6 * command;
    follow(&mut drives, wanted(0.11), 0.1, 5.0, reached);
    let before = drives.response().traction;
    assert!((before.speed_max_m_s - 0.1).abs() < 1e-9, "{before:?}");
    for _ in 0..100 {
        follow(&mut drives, wanted(0.11), 0.1, CYCLE_S, reached);
        assert_eq!(drives.response().traction, before);
    }
}

#[test]
fn a_motor_too_slow_for_any_limit_is_tried_once_in_ten_seconds_at_most() {
    let mut drives = Drives::new(&ControllerConfig::default());
    let slow = |command: f64| command.min(0.05);
    follow(&mut drives, wanted(0.6), 0.1, 10.0, slow);
    let mut released = 0;
    for _ in 0..1200 {
        let before_m_s = drives.traction.limit_m_s;
        follow(&mut drives, wanted(0.6), 0.1, CYCLE_S, slow);
        released += u32::from(drives.traction.limit_m_s > before_m_s + 0.1);
    }
    assert!((1..=6).contains(&released), "{released}");
}

/// Returns a motor that has gained speed at 0.3 m/s^2 for two seconds, in the sense of `sign`.
fn slow(sign: f64) -> Motor {
    let mut motor = motor(2.0);
    for cycle in 1..=40 {
        motor.observe(sign * 0.3 * CYCLE_S * f64::from(cycle), sign * 1.5, CYCLE_S);
    }
    motor
}

#[test]
fn a_motor_that_gains_speed_slowly_has_a_rate_and_follows_no_command_far_ahead() {
    for sign in [1.0, -1.0] {
        let motor = slow(sign);
        let rate_m_s2 = motor.rate.limit_m_s2();
        assert!((rate_m_s2 - 0.36).abs() < 0.01, "{rate_m_s2}");
        assert_eq!(motor.limit_m_s, 2.0);
        let speed_m_s = motor.speed_m_s.abs();
        let lead_m_s = 0.1 + rate_m_s2 * (0.3 + 0.2);
        for (command_m_s, followed_m_s) in [
            (1.5, speed_m_s + lead_m_s),
            (speed_m_s + 0.5 * lead_m_s, speed_m_s + 0.5 * lead_m_s),
            // It is slowed down as ever.
            (0.1, 0.1),
            (0.0, 0.0),
            (-1.5, -1.5),
        ] {
            let found_m_s = sign * motor.followed(sign * command_m_s, 0.3);
            assert!(
                (found_m_s - followed_m_s).abs() < 1e-9,
                "{command_m_s}: {found_m_s}"
            );
        }
    }
    // A motor that does as told follows every command.
    assert_eq!(motor(2.0).followed(1.5, 0.3), 1.5);
    let mut sudden = motor(2.0);
    for _ in 0..40 {
        sudden.observe(0.5, 0.52, CYCLE_S);
    }
    assert_eq!(sudden.followed(1.5, 0.3), 1.5);
}

#[test]
fn the_rate_of_one_motor_is_a_limit_of_that_motor_alone() {
    let config = ControllerConfig::default();
    let mut drives = Drives::new(&config);
    assert_eq!(drives.limits(&config.limits), config.limits);
    drives.steer = slow(1.0);
    let limits = drives.limits(&config.limits);
    assert_eq!(limits.traction, config.limits.traction);
    assert_eq!(
        limits.steer.acceleration_m_s2,
        drives.steer.rate.limit_m_s2()
    );
    let deceleration_m_s2 = config.limits.steer.deceleration_m_s2;
    assert_eq!(limits.steer.deceleration_m_s2, deceleration_m_s2);
    let command = MotorSpeeds {
        traction_m_s: 1.5,
        steer_m_s: 1.5,
    };
    let followed = drives.followed(command);
    assert_eq!(followed.traction_m_s, 1.5);
    assert!(followed.steer_m_s < 1.0, "{followed:?}");
}

/// Drives of the default limits whose commands are told to act 0.1 s later, in a vehicle that is driven by them.
struct Driven {
    drives: Drives,
    issued: IssuedCommands,
    cycle: u32,
}

impl Driven {
    fn new() -> Self {
        let config = ControllerConfig {
            command_delay_s: 0.06,
            motor_lag_s: 0.04,
            ..ControllerConfig::default()
        };
        Self {
            drives: Drives::new(&config),
            issued: IssuedCommands::new(CYCLE_S),
            cycle: 0,
        }
    }

    /// Drives for so many cycles by commands of a time, with speeds of a time.
    fn drive(
        &mut self,
        cycles: u32,
        command: impl Fn(f64) -> MotorSpeeds,
        speeds: impl Fn(f64) -> MotorSpeeds,
    ) {
        for _ in 0..cycles {
            let time_s = CYCLE_S * f64::from(self.cycle);
            self.cycle += 1;
            self.issued.push(time_s, command(time_s));
            // Rounding does not decide which command is in force.
            self.drives
                .observe(speeds(time_s), time_s + 1e-4, &self.issued);
        }
    }

    fn delay_s(&self) -> f64 {
        self.drives.response().delay_s
    }
}

fn of_traction(speed_m_s: f64) -> MotorSpeeds {
    MotorSpeeds {
        traction_m_s: speed_m_s,
        steer_m_s: 0.0,
    }
}

fn of_steer(speed_m_s: f64) -> MotorSpeeds {
    MotorSpeeds {
        traction_m_s: 0.0,
        steer_m_s: speed_m_s,
    }
}

#[test]
fn the_delay_becomes_that_with_which_either_motor_follows() {
    for of in [of_traction, of_steer] {
        for late_s in [0.0, 0.07, 0.33, 0.9] {
            let command = |time_s: f64| of(0.3 * (1.5 * time_s).sin());
            let mut driven = Driven::new();
            driven.drive(600, command, |time_s| command(time_s - late_s));
            let delay_s = driven.delay_s();
            // What was told counts for little.
            assert!((delay_s - late_s).abs() < 0.012, "{late_s}: {delay_s}");
        }
    }
}

#[test]
fn the_delay_stays_as_it_was_told_while_nothing_tells_of_it() {
    for speed_m_s in [0.0, 0.3] {
        let mut driven = Driven::new();
        let same = |_| of_traction(speed_m_s);
        driven.drive(200, same, same);
        let delay_s = driven.delay_s();
        assert!((delay_s - 0.1).abs() < 1e-9, "{speed_m_s}: {delay_s}");
    }
}

#[test]
fn motors_near_the_commands_that_they_can_reach_tell_of_the_delay() {
    let mut issued = IssuedCommands::new(CYCLE_S);
    let command = MotorSpeeds {
        traction_m_s: -0.5,
        steer_m_s: 0.3,
    };
    for cycle in 0..23 {
        issued.push(CYCLE_S * f64::from(cycle), command);
    }
    // (speeds, limit of steer, what the misfits become)
    for (traction_m_s, steer_m_s, limit_m_s, expected) in [
        (-0.44, 0.2, 0.8, 0.06 * 0.06 + 0.1 * 0.1),
        (-0.3, 0.2, 0.8, 0.1 * 0.1),
        (-0.7, 0.2, 0.8, 0.1 * 0.1),
        (-0.44, 0.1, 0.8, 0.06 * 0.06),
        (-0.44, 0.1, 0.22, 0.06 * 0.06 + 0.12 * 0.12),
        (-0.3, 0.1, 0.8, 0.0),
    ] {
        let mut drives = Driven::new().drives;
        let speeds = MotorSpeeds {
            traction_m_s,
            steer_m_s,
        };
        for (motor, speed_m_s, command_m_s) in [
            (&mut drives.traction, traction_m_s, -0.5),
            (&mut drives.steer, steer_m_s, 0.3),
        ] {
            (motor.speed_m_s, motor.command_m_s) = (speed_m_s, command_m_s);
        }
        drives.steer.limit_m_s = limit_m_s;
        drives.observe(speeds, 1.0, &issued);
        drives.observe(speeds, 1.05, &issued);
        for misfit in drives.misfits {
            assert!((misfit - expected).abs() < 1e-3, "{speeds:?}: {misfit}");
        }
    }
}

#[test]
fn the_delay_in_use_follows_the_one_that_fits_best_within_a_second() {
    // The vertex of the parabola through the least misfit and those beside it: 0.3 s and a quarter of a step.
    let mut best = [100.0; DELAYS];
    (best[5], best[6], best[7]) = (30.0, 10.0, 20.0);
    let vertex_s = 0.3 + 0.05 / 6.0;
    for elapsed_s in [0.05, 0.25] {
        let mut driven = Driven::new();
        for cycle in 0..24 {
            driven
                .issued
                .push(0.05 * f64::from(cycle), MotorSpeeds::STOP);
        }
        driven
            .drives
            .observe(MotorSpeeds::STOP, 1.0, &driven.issued);
        driven.drives.misfits = best;
        driven
            .drives
            .observe(MotorSpeeds::STOP, 1.0 + elapsed_s, &driven.issued);
        let expected_s = 0.1 + elapsed_s * (vertex_s - 0.1);
        let delay_s = driven.delay_s();
        assert!(
            (delay_s - expected_s).abs() < 1e-4,
            "{elapsed_s}: {delay_s}"
        );
        // Over ten seconds they are forgotten.
        let kept = driven.drives.misfits[0] / best[0];
        assert!((kept - (1.0 - elapsed_s / 10.0)).abs() < 1e-12, "{kept}");
    }
}

#[test]
fn readings_that_are_not_later_or_a_second_later_tell_nothing() {
    let mut issued = IssuedCommands::new(CYCLE_S);
    for cycle in 0..23 {
        issued.push(2.0 + CYCLE_S * f64::from(cycle), of_traction(0.5));
    }
    let mut drives = Driven::new().drives;
    drives.observe(MotorSpeeds::STOP, 2.0, &issued);
    for read_s in [2.0, 1.5, 2.5, 2.5, 3.5] {
        let before = drives.clone();
        drives.observe(of_traction(0.25), read_s, &issued);
        let taken = drives.traction.command_m_s != before.traction.command_m_s
            || drives.misfits != before.misfits;
        // From 1.5 s to 2.5 s it is a second, too.
        assert!(!taken, "{read_s}");
    }
    drives.observe(of_traction(0.25), 3.6, &issued);
    assert!(drives.traction.command_m_s > 0.2 && drives.misfits[0] > 0.0);
}

#[test]
fn limits_and_response_are_those_of_each_motor() {
    let config = ControllerConfig::default();
    let mut drives = Drives::new(&config);
    for motor in [&mut drives.traction, &mut drives.steer] {
        for _ in 0..40 {
            motor.observe(0.2, 0.3, CYCLE_S);
        }
    }
    for _ in 0..40 {
        drives.steer.observe(0.16, 0.3, CYCLE_S);
    }
    let (limits, response) = (drives.limits(&config.limits), drives.response());
    assert!((limits.traction.speed_m_s - 0.21).abs() < 2e-3);
    assert!((limits.steer.speed_m_s - 0.17).abs() < 2e-3);
    assert_eq!(response.traction.speed_max_m_s, limits.traction.speed_m_s);
    assert_eq!(response.steer.speed_max_m_s, limits.steer.speed_m_s);
    assert!((response.traction.asked_m_s - 0.3).abs() < 2e-3);
    assert!((response.steer.asked_m_s - 0.3).abs() < 2e-3);
}

#[test]
fn commands_that_are_scaled_down_pass_on_what_the_motor_does() {
    let mut drives = Driven::new().drives;
    assert_eq!(drives.passed_on_m_s(), f64::INFINITY);
    let speeds = follow(&mut drives, wanted(0.6), 0.1, 8.0, |command| 0.5 * command);
    let passed_m_s = drives.passed_on_m_s();
    assert!(
        (passed_m_s - speeds.traction_m_s).abs() < 0.01,
        "{passed_m_s}"
    );
}

#[test]
fn a_controller_learns_of_its_drives_from_the_speeds_that_it_sees() {
    let course = Course::Straight(Straight::default());
    let mut controller = following(ControllerKind::IcrikMpc, &course, 0.0, 0, start);
    let mut pose = start(controller.reference.as_ref().unwrap());
    for cycle in 0..80 {
        let mut sample = sample(CYCLE_S * f64::from(cycle), &pose);
        let reading = sample.tread_speeds.as_mut().unwrap();
        (reading.value.left_m_s, reading.value.right_m_s) = (0.2, 0.2);
        controller.step(&sample, None);
        pose.y_m += 0.2 * CYCLE_S;
    }
    let response = controller.drives.response();
    assert!(response.traction.speed_max_m_s < 0.25, "{response:?}");
    assert!(response.traction.asked_m_s > 0.3, "{response:?}");
}
