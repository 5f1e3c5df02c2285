//! Every fault stops in time and keeps the vehicle stopped.

use super::*;

/// How it is told what is broken, what is, after which time-out, s, and whether it ends the drive at
/// once.
type Break = (&'static str, fn(&mut SafetyInputs), f64, bool);

const BREAKS: [Break; 21] = [
    (
        "the emergency stop is pressed",
        |s| s.requests.halt = Some(StopCause::EmergencyStop),
        0.0,
        true,
    ),
    (
        "the program ends",
        |s| s.requests.halt = Some(StopCause::ProgramEnds),
        0.0,
        true,
    ),
    (
        "the drives report an emergency stop",
        |s| set_mode(s, DriveMode::EmergencyStop),
        0.0,
        true,
    ),
    (
        "a drive reports a fault",
        |s| set_mode(s, DriveMode::Fault),
        0.0,
        true,
    ),
    (
        "a drive is off that was told to be on",
        |s| set_mode(s, DriveMode::Disabled),
        0.0,
        true,
    ),
    (
        "a drive takes no commands",
        |s| set_mode(s, DriveMode::NotOperational),
        0.0,
        true,
    ),
    (
        "a drive does not follow speeds",
        |s| set_mode(s, DriveMode::OtherMode),
        0.0,
        true,
    ),
    (
        "a drive's reported speed stays the same",
        |s| set_mode(s, DriveMode::Frozen),
        0.0,
        false,
    ),
    (
        "the edge of the geofence is near",
        |s| s.leaves_geofence = true,
        0.0,
        false,
    ),
    (
        "the goal was cancelled",
        |s| s.requests.stop = Some(StopCause::Cancelled),
        0.0,
        false,
    ),
    (
        "the link to the drives is BusOff",
        |s| s.link = LinkState::BusOff,
        0.0,
        false,
    ),
    (
        "the link to the drives is Down",
        |s| s.link = LinkState::Down,
        0.0,
        false,
    ),
    (
        "another node sends with this program's identifiers",
        |s| s.link = LinkState::Foreign,
        0.0,
        true,
    ),
    (
        "the command is not finite",
        |s| set_command(s, f64::NAN),
        0.0,
        false,
    ),
    (
        "nothing could be sent for 0.",
        |s| s.unsent_since_s = Some(1.05),
        0.15,
        false,
    ),
    (
        "the feedback is 0.2",
        |s| set_feedback_time(s, 1.05),
        0.2,
        false,
    ),
    (
        "the feedback is stamped 10.000 s ahead",
        |s| set_feedback_time(s, s.time_s + 10.0),
        0.0,
        false,
    ),
    (
        "another node sends with this program's identifiers",
        |s| {
            set_mode(s, DriveMode::Frozen);
            s.link = LinkState::Foreign;
        },
        0.0,
        true,
    ),
    ("there is no feedback", |s| s.feedback = None, 0.0, false),
    (
        "the command is 0.",
        |s| set_command_time(s, 1.05),
        0.15,
        false,
    ),
    (
        "traction differs by 0.300 m/s",
        |s| set_speed(s, 0.9),
        0.3,
        false,
    ),
];

fn set_mode(inputs: &mut SafetyInputs, mode: DriveMode) {
    inputs.feedback.as_mut().unwrap().value.mode = mode;
}

fn set_command(inputs: &mut SafetyInputs, traction_m_s: f64) {
    inputs.controller.as_mut().unwrap().command.traction_m_s = traction_m_s;
}

fn set_feedback_time(inputs: &mut SafetyInputs, time_s: f64) {
    inputs.feedback.as_mut().unwrap().time_s = time_s;
}

fn set_speed(inputs: &mut SafetyInputs, traction_m_s: f64) {
    inputs.feedback.as_mut().unwrap().value.speeds.traction_m_s = traction_m_s;
}

#[test]
fn every_fault_stops_in_time_and_stays_stopped_until_re_armed() {
    for (name, fault, after_s, at_once) in BREAKS {
        let mut bench = Bench::driving(speeds(0.6, -0.3));
        // 22 cycles have passed: what breaks now was good until 1.1 s.
        let ramp_s = if at_once { 0.0 } else { 0.6 / 2.0 };
        let cycles = ((after_s + ramp_s) / PERIOD_S).ceil() as u32 + 2;
        let mut previous = 0.6;
        for _ in 0..cycles {
            let order = bench.step(speeds(0.6, -0.3), fault);
            assert!(order.speeds.traction_m_s <= previous, "{name}");
            previous = order.speeds.traction_m_s;
            if at_once {
                assert_eq!(order, DriveCommand::OFF, "{name}");
            }
        }
        assert_eq!(
            bench.command.speeds,
            MotorSpeeds::STOP,
            "{name}: {:?}",
            bench.events
        );
        bench.step(speeds(0.6, -0.3), |_| {});
        assert_eq!(bench.safety.state(), SafetyState::Latched, "{name}");
        let mut ends = bench.events.iter();
        let end = ends
            .find(|event| event.from == SafetyState::Driving)
            .unwrap();
        assert!(end.reason.to_string().starts_with(name), "{}", end.reason);
        // The fault is gone; the arm level still stands.
        for _ in 0..100 {
            bench.inputs.leaves_geofence = false;
            bench.inputs.requests = OperatorRequests {
                arm: true,
                stop: None,
                halt: None,
            };
            bench.inputs.link = LinkState::Active;
            bench.inputs.unsent_since_s = None;
            assert_eq!(
                bench.step(speeds(0.6, -0.3), |_| {}),
                DriveCommand::OFF,
                "{name}"
            );
        }
        bench.arm();
        for _ in 0..20 {
            bench.step(speeds(0.6, -0.3), |_| {});
        }
        assert_eq!(bench.safety.state(), SafetyState::Driving, "{name}");
    }
}

#[test]
fn arming_is_refused_while_the_fault_lasts() {
    for (name, fault, ..) in BREAKS {
        let no_matter = ["the command is", "a drive is off", "traction differs"];
        if no_matter.iter().any(|start| name.starts_with(start)) {
            continue; // To a vehicle that stands, off.
        }
        let mut bench = Bench::new();
        for _ in 0..40 {
            bench.step(MotorSpeeds::STOP, |_| {});
        }
        bench.arm();
        for _ in 0..40 {
            let order = bench.step(speeds(0.5, 0.0), fault);
            assert_eq!(order.speeds, MotorSpeeds::STOP, "{name}");
            assert!(!order.enable, "{name}");
        }
        assert_eq!(bench.safety.state(), SafetyState::Latched, "{name}");
    }
}

/// Returns the time from the fault to the ramp, s, for feedback that is `factor` times the command of 0.65 m/s.
fn found_after_s(period_s: f64, factor: f64) -> f64 {
    let mut bench = Bench::driving(speeds(0.65, 0.0));
    let start_s = f64::from(bench.steps) * PERIOD_S;
    for cycle in 1..100 {
        let time_s = start_s + f64::from(cycle) * period_s;
        bench.step(speeds(0.65, 0.0), |inputs| {
            inputs.time_s = time_s;
            set_command_time(inputs, time_s);
            // One report in 0.05 s.
            let report_s = start_s + PERIOD_S * ((time_s - start_s) / PERIOD_S + 1e-9).floor();
            set_feedback_time(inputs, report_s);
            set_speed(inputs, 0.65 * factor);
        });
        if bench.safety.state() == SafetyState::Stopping {
            return time_s - start_s;
        }
    }
    f64::INFINITY
}

#[test]
fn feedback_is_judged_the_sooner_the_further_it_is_off() {
    for period_s in [0.05, 0.01] {
        // 0.11 m/s off, mirrored, and a drive that is blocked.
        let (little, mirrored, blocked) = (
            found_after_s(period_s, 1.17),
            found_after_s(period_s, -1.0),
            found_after_s(period_s, 0.0),
        );
        assert!((0.25..=0.36).contains(&little), "{little}");
        assert!((0.05..=0.11).contains(&mirrored), "{mirrored}");
        assert!((0.05..=0.11).contains(&blocked), "{blocked}");
    }
}

#[test]
fn a_single_report_that_is_far_off_does_not_stop() {
    let mut bench = Bench::driving(speeds(0.65, 0.0));
    for _ in 0..10 {
        bench.step(speeds(0.65, 0.0), |inputs| set_speed(inputs, -0.65));
        for _ in 0..3 {
            bench.step(speeds(0.65, 0.0), |_| {});
        }
    }
    assert_eq!(bench.safety.state(), SafetyState::Driving);
}
