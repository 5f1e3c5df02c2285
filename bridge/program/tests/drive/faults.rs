//! Faults in simulated time.

use serde_json::Value;
use std::process::Command;

fn faults(arguments: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_sidehill-drive"))
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .args(["faults", "config/bridge/run_vcan0.yaml"])
        .args(arguments)
        .output()
        .unwrap();
    (
        output.status.code(),
        String::from_utf8(output.stdout).unwrap(),
    )
}

#[test]
fn the_same_seed_gives_the_same_runs_and_each_can_be_driven_again() {
    let arguments = ["--runs", "40", "--seed", "7", "--format", "json"];
    let (status, first) = faults(&arguments);
    assert_eq!(faults(&arguments), (status, first.clone()));
    let summary: Value = serde_json::from_str(&first).unwrap();
    assert_eq!(summary["all"]["runs"], 40);
    let unsafe_runs = summary["all"]["unsafe_runs"].as_array().unwrap();
    assert_eq!(status, Some(i32::from(!unsafe_runs.is_empty())));
    let worst = summary["all"]["worst_run"].to_string();
    let again = ["--seed", "7", "--run", &worst, "--format", "json"];
    let run: Value = serde_json::from_str(&faults(&again).1).unwrap();
    let way_m = run["stop_way_m"].as_f64().unwrap_or(0.0);
    let largest_m = summary["all"]["stop_way_m"]["max"].as_f64().unwrap();
    assert!(way_m <= largest_m);
    assert!(run["off_path_m"].as_f64() <= summary["all"]["off_path_max_m"].as_f64());
}

#[test]
fn faults_that_switch_off_stop_and_those_that_say_nothing_drive_on() {
    let only = |kind: &str| -> Value {
        let (_, text) = faults(&["--runs", "20", "--only", kind, "--format", "json"]);
        serde_json::from_str::<Value>(&text).unwrap()["faults"][0].clone()
    };
    for kind in [
        "emergency-stop",
        "drive-fault",
        "foreign",
        "link-down",
        "feedback-ahead",
    ] {
        let row = only(kind);
        assert_eq!(row["fault"], kind);
        assert_eq!(row["drove_on"], 0, "{row}");
        // Detection, a cycle, and a ramp of 0.5 s.
        assert!(row["stop_time_s"]["max"].as_f64().unwrap() < 0.8, "{row}");
        assert_eq!(row["unsafe_runs"], Value::Array(Vec::new()));
    }
    let row = only("gyroscope-silent");
    assert_eq!(row["drove_on"], row["runs"], "{row}");
}

#[test]
fn a_port_that_has_no_such_faults_is_refused() {
    let output = Command::new(env!("CARGO_BIN_EXE_sidehill-drive"))
        .current_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."))
        .args(["faults", "config/bridge/run_ros2.yaml"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(
        error.contains("run_ros2.yaml") && error.contains("port: ros2"),
        "{error}"
    );
}
