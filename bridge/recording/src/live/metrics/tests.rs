use super::*;
use sidehill_bridge::ros2::message::cdr::to_cdr;
use sidehill_bridge::ros2::message::{DiagnosticStatus, KeyValue};
use sidehill_bridge::safety::StopCause;
use sidehill_controller::controller::StopReason;

fn put(metrics: &mut Metrics, topic: Topic, time_s: u64, message: &impl serde::Serialize) {
    metrics.take(&TopicMessage {
        topic,
        time_ns: time_s * 1_000_000_000,
        message: to_cdr(message).unwrap().into(),
    });
}

fn cycle() -> LoopCycle {
    LoopCycle {
        lateness_s: 0.0003,
        slack_s: 0.04,
        state: "driving".to_owned(),
        sent: true,
        feedback_age_s: 0.01,
        skipped: 3,
        ..LoopCycle::default()
    }
}

/// Returns diagnostics of the controller.
fn diagnostics(values: &[(&str, &str)]) -> DiagnosticArray {
    let values = values.iter().map(|(key, value)| KeyValue {
        key: (*key).to_owned(),
        value: (*value).to_owned(),
    });
    DiagnosticArray {
        status: vec![DiagnosticStatus {
            name: "sidehill: controller".to_owned(),
            values: values.collect(),
            ..DiagnosticStatus::default()
        }],
        ..DiagnosticArray::default()
    }
}

#[track_caller]
fn assert_has(text: &str, lines: &[&str]) {
    for line in lines {
        assert!(text.lines().any(|other| other == *line), "{line}\n{text}");
    }
}

#[test]
fn cycles_are_counted_and_the_newest_is_shown() {
    let mut metrics = Metrics::default();
    put(&mut metrics, Topic::LoopCycle, 1, &cycle());
    let late = LoopCycle {
        lateness_s: 0.3,
        sent: false,
        ..cycle()
    };
    put(&mut metrics, Topic::LoopCycle, 2, &late);
    let text = metrics.text(Form::OpenMetrics);
    assert_has(
        &text,
        &[
            "# TYPE sidehill_lateness_seconds histogram",
            "# UNIT sidehill_lateness_seconds seconds",
            "sidehill_lateness_seconds_bucket{le=\"0.0002\"} 0",
            "sidehill_lateness_seconds_bucket{le=\"0.0005\"} 1",
            "sidehill_lateness_seconds_bucket{le=\"0.2\"} 1",
            "sidehill_lateness_seconds_bucket{le=\"+Inf\"} 2",
            "sidehill_lateness_seconds_count 2",
            "# TYPE sidehill_cycles counter",
            "sidehill_cycles_total 2",
            "sidehill_cycles_skipped_total 3",
            "sidehill_commands_unsent_total 1",
            "sidehill_slack_seconds 0.04",
            "sidehill_feedback_age_seconds 0.01",
            "sidehill_safety{state=\"driving\"} 1.0",
            "sidehill_safety{state=\"latched\"} 0.0",
        ],
    );
    assert!(text.ends_with("# EOF\n"), "{text}");
    // In the format of Prometheus the name of the family is that of the sample.
    assert_has(
        &metrics.text(Form::Prometheus),
        &[
            "# TYPE sidehill_cycles_total counter",
            "sidehill_cycles_total 2",
        ],
    );
}

#[test]
fn figures_have_the_names_of_the_diagnostics_with_base_units() {
    let mut metrics = Metrics::default();
    let step = ControllerCycle {
        solve_us: 150.0,
        ..ControllerCycle::default()
    };
    put(&mut metrics, Topic::ControllerCycle, 1, &step);
    let values = [
        ("pose_age_s", "0.25"),
        ("cross_track_m", "-0.031"),
        ("heading_error_rad", "NaN"),
        ("gyro_bias_rad_s", "0.001"),
        ("traction_reached_m_s", "1.250"),
        ("traction_acceleration_m_s2", "0.300"),
        ("drives", "the steer motor reaches 0.3 m/s of 0.5 m/s"),
        ("learned_friction", "0.6500 (0.5000 to 0.8000)"),
        ("solve_us", "150"),
    ];
    put(&mut metrics, Topic::Diagnostics, 1, &diagnostics(&values));
    let text = metrics.text(Form::OpenMetrics);
    assert_has(
        &text,
        &[
            "sidehill_pose_age_seconds 0.25",
            "sidehill_cross_track_meters -0.031",
            "sidehill_gyro_bias_radians_per_second 0.001",
            "sidehill_traction_reached_meters_per_second 1.25",
            "sidehill_traction_acceleration_meters_per_second_squared 0.3",
            "sidehill_learned_friction 0.65",
            "sidehill_solve_seconds_bucket{le=\"0.0001\"} 0",
            "sidehill_solve_seconds_bucket{le=\"0.0002\"} 1",
        ],
    );
    for absent in ["heading_error", "sidehill_drives", "sidehill_solve_us"] {
        assert!(!text.contains(absent), "{absent}: {text}");
    }
}

#[test]
fn what_is_old_is_not_shown_as_the_present() {
    let mut metrics = Metrics::default();
    put(
        &mut metrics,
        Topic::ControllerCycle,
        1,
        &ControllerCycle::default(),
    );
    put(&mut metrics, Topic::LoopCycle, 1, &cycle());
    let ages = diagnostics(&[("pose_age_s", "0.1")]);
    put(&mut metrics, Topic::Diagnostics, 1, &ages);
    let shown = |metrics: &Metrics, name: &str| metrics.text(Form::OpenMetrics).contains(name);
    assert!(shown(&metrics, "sidehill_pose_age_seconds"));
    // The controller has stopped deciding, the loop goes on.
    put(&mut metrics, Topic::LoopCycle, 3, &cycle());
    put(&mut metrics, Topic::Diagnostics, 3, &ages);
    assert!(!shown(&metrics, "sidehill_pose_age_seconds"));
    assert!(shown(&metrics, "sidehill_feedback_age_seconds"));
    // The loop, too.
    put(&mut metrics, Topic::Diagnostics, 5, &ages);
    assert!(!shown(&metrics, "sidehill_feedback_age_seconds"));
    assert!(shown(&metrics, "sidehill_cycles_total 2"));
}

#[test]
fn stops_while_driving_are_counted_by_cause() {
    let mut metrics = Metrics::default();
    let mut change = |from, to, reason| {
        metrics.transition(&Transition {
            time_s: 0.0,
            from,
            to,
            reason,
        });
    };
    use SafetyState::{Driving, Enabling, Latched, Stopping};
    let stale = StopReason::AttitudeStale { age_s: 0.4 };
    for _ in 0..2 {
        let why = Reason::ControllerStopped { why: stale };
        change(Driving, Stopping, why);
        change(Stopping, Latched, Reason::RampEnded);
    }
    let operator = Reason::Requested(StopCause::Operator);
    change(Driving, Stopping, operator);
    change(Driving, Latched, Reason::FeedbackTimeout { age_s: 0.3 });
    // The vehicle did not drive.
    change(Enabling, Latched, Reason::DriveFault);
    assert_has(
        &metrics.text(Form::OpenMetrics),
        &[
            "# TYPE sidehill_stops counter",
            "sidehill_stops_total{cause=\"attitude_stale\"} 2",
            "sidehill_stops_total{cause=\"operator\"} 1",
            "sidehill_stops_total{cause=\"feedback_timeout\"} 1",
            "sidehill_stops_total{cause=\"drive_fault\"} 0",
        ],
    );
    for cause in NO_STOPS {
        assert!(Reason::causes().any(|known| known == cause), "{cause}");
        let line = format!("sidehill_stops_total{{cause=\"{cause}\"}}");
        assert!(!metrics.text(Form::OpenMetrics).contains(&line), "{line}");
    }
}

#[test]
fn the_format_of_prometheus_is_for_who_reads_that_only() {
    for (accept, form) in [
        ("", Form::OpenMetrics),
        ("*/*", Form::OpenMetrics),
        (
            "application/openmetrics-text;version=1.0.0,text/plain;version=0.0.4;q=0.5,*/*;q=0.1",
            Form::OpenMetrics,
        ),
        ("text/plain;version=0.0.4", Form::Prometheus),
    ] {
        assert_eq!(Form::accepted(accept), form, "{accept}");
    }
}
