use super::*;
use crate::server::test_data::{decision, j8, loop_status};
use sidehill_bridge::control_loop::channel::LoopStatus;
use sidehill_controller::estimator::ContactEstimate;
use sidehill_controller::mpc::{Residuals, SolvePath, SolveReport};
use sidehill_plant::contact::{Parameter, ParameterVector};

const SERVER: ServerStatus<'_> = ServerStatus {
    lifecycle: "active",
    rejected: 3,
    last_rejection: "odom: it is in map, must be in odom",
    inputs: &[],
    emergency_stop: None,
    blocked_by: None,
    tracking: None,
    goals: 2,
    last_end: Some((GoalEnd::Succeeded, "")),
    recording: RecordingState::On,
    drives: None,
};

fn report(status: &LoopStatus, decision: &Decision, server: &ServerStatus<'_>) -> DiagnosticStatus {
    let solves = SolveStats::default();
    diagnostic_status("/server", &j8(), status, decision, &solves, server)
}

#[track_caller]
fn value<'a>(status: &'a DiagnosticStatus, key: &str) -> &'a str {
    let found = status.values.iter().find(|value| value.key == key);
    &found.expect(key).value
}

#[test]
fn the_level_says_whether_somebody_has_to_look() {
    let tracking = decision(1.0, 0.0, 0.0);
    let of = |state, decision: &Decision, reason| {
        let mut status = loop_status(state);
        status.stopped_by = reason;
        report(&status, decision, &SERVER).level
    };
    assert_eq!(of(SafetyState::Driving, &tracking, None), level::OK);
    assert_eq!(of(SafetyState::Stopping, &tracking, None), level::WARN);
    let fallback = Decision {
        status: Status::Fallback {
            reason: QpFailure::Infeasible,
            cycles: 1,
        },
        ..tracking
    };
    assert_eq!(of(SafetyState::Driving, &fallback, None), level::WARN);
    let waiting = Decision {
        status: Status::Waiting,
        ..tracking
    };
    assert_eq!(of(SafetyState::Disarmed, &waiting, None), level::STALE);
    for (reason, expected) in [
        (Reason::Finished, level::OK),
        (Reason::Requested(StopCause::Cancelled), level::OK),
        (Reason::Requested(StopCause::FrameLost), level::ERROR),
        (Reason::CommandTimeout { age_s: 0.2 }, level::ERROR),
    ] {
        let found = of(SafetyState::Latched, &tracking, Some(reason));
        assert_eq!(found, expected, "{reason}");
    }
    let pressed = ServerStatus {
        emergency_stop: Some(StopCause::EmergencyStop),
        ..SERVER
    };
    let status = report(&loop_status(SafetyState::Latched), &tracking, &pressed);
    assert_eq!(status.level, level::ERROR);
    assert_eq!(status.message, StopCause::EmergencyStop.to_string());
    assert_eq!(value(&status, "emergency_stop"), "true");
}

#[test]
fn a_missing_input_is_named_while_the_vehicle_stands() {
    let missing = [Input {
        input: "odometry".to_owned(),
        source: "/odom (nav_msgs/msg/Odometry)".to_owned(),
        missing: Some("no publisher; this type is on /wheels/odom".to_owned()),
    }];
    let server = ServerStatus {
        inputs: &missing,
        ..SERVER
    };
    let waiting = Decision {
        status: Status::Waiting,
        ..decision(1.0, 0.0, 0.0)
    };
    for (decision, expected) in [
        (waiting, level::STALE),
        (decision(1.0, 0.0, 0.0), level::WARN),
    ] {
        let status = report(&loop_status(SafetyState::Disarmed), &decision, &server);
        assert_eq!(status.level, expected);
        let whole = missing[0].to_string();
        assert!(status.message.contains(&whole), "{}", status.message);
        assert_eq!(value(&status, "waits_for"), whole);
    }
    let mut stopped = loop_status(SafetyState::Latched);
    stopped.stopped_by = Some(Reason::CommandTimeout { age_s: 0.2 });
    let status = report(&stopped, &decision(1.0, 0.0, 0.0), &server);
    assert_eq!(status.level, level::ERROR);
}

#[test]
fn values_are_those_of_the_loop_the_controller_and_the_server() {
    let status = report(
        &loop_status(SafetyState::Driving),
        &decision(1.0, 0.0, 0.0),
        &SERVER,
    );
    assert_eq!(status.name, "/server: path tracking");
    for (key, expected) in [
        ("lifecycle", "active"),
        ("safety", "driving"),
        ("stopped_by", ""),
        ("goals", "2"),
        ("last_goal", "Succeeded"),
        ("refused", "3"),
        ("solve_p99_us", "NaN"),
        ("slide_right_m_s", "0.000000"),
    ] {
        assert_eq!(value(&status, key), expected, "{key}");
    }
}

#[test]
fn learned_parameters_come_with_their_intervals_and_what_is_not_excited() {
    let mut decision = decision(1.0, 0.0, 0.0);
    let without = report(&loop_status(SafetyState::Driving), &decision, &SERVER);
    assert!(
        without
            .values
            .iter()
            .all(|v| !v.key.starts_with("learned_"))
    );
    let mut sigma = ParameterVector::repeat(0.01);
    sigma[Parameter::SlipScale.index()] = 0.1;
    let mut parameters = ParameterVector::repeat(0.2);
    parameters[Parameter::Friction.index()] = 0.5_f64.ln();
    let contact = ContactEstimate {
        parameters,
        sigma,
        prior_sigma: ParameterVector::repeat(0.1),
    };
    decision.estimate.as_mut().unwrap().contact = Some(contact);
    let status = report(&loop_status(SafetyState::Driving), &decision, &SERVER);
    assert_eq!(
        value(&status, "learned_friction"),
        "0.5000 (0.4903 to 0.5099)"
    );
    assert!(value(&status, "learned_slip_scale_m_s").ends_with("not excited: prior)"));
}

#[test]
fn solve_times_are_counted_once_and_the_oldest_are_dropped() {
    let mut solves = SolveStats::default();
    let mut newest = decision(0.0, 0.0, 0.0);
    for index in 1..=SOLVES + 100 {
        newest.time_s = index as f64;
        newest.solve = Some(SolveReport {
            iterations: 5,
            path: SolvePath::ActiveSet,
            residuals: Residuals {
                primal: 0.0,
                dual: 0.0,
                gap: 0.0,
            },
            solve_time_s: 1e-6 * index as f64,
        });
        assert!(solves.take(&newest));
        assert!(!solves.take(&newest), "the same decision");
    }
    let [p50, p99, max] = solves.quantiles_us();
    assert!(
        (p50 - 300.0).abs() < 1e-6 && (p99 - 496.0).abs() < 1e-6,
        "{p50} {p99}"
    );
    assert!((max - 500.0).abs() < 1e-6);
    newest.time_s += 1.0;
    newest.status = Status::Fallback {
        reason: QpFailure::Infeasible,
        cycles: 1,
    };
    solves.take(&newest);
    assert_eq!((solves.fallbacks, solves.deadlines), (1, 0));
}
