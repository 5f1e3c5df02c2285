//! What is wrong with a configuration or a bus.

use super::{configuration, run_to_end};
use crate::repository;

#[test]
fn the_bridges_files_are_valid() {
    let folder = repository("config/bridge");
    for name in [
        "can.yaml",
        "cia402.yaml",
        "run_can_ros2.yaml",
        "run_ros2.yaml",
        "run_vcan0.yaml",
        "vehicle_ros2.yaml",
        "vehicle_vcan0.yaml",
    ] {
        let output = run_to_end(&["check", folder.join(name).to_str().unwrap()]);
        let text = String::from_utf8(output.stdout).unwrap();
        assert!(
            output.status.success() && text.contains("valid"),
            "{name}: {text}"
        );
    }
}

#[test]
fn what_is_wrong_is_named_with_its_file() {
    for (file, old, new, expected) in [
        (
            "can.yaml",
            "signal: TractionSpeed",
            "signal: Tracton",
            "j8.dbc: message DriveCommand has no signal Tracton",
        ),
        (
            "can.yaml",
            "counter_skip_max",
            "counter_skip",
            "unknown field `counter_skip`",
        ),
        ("j8.dbc", "BO_ 256", "B0_ 256", "not a DBC file"),
        (
            "run_vcan0.yaml",
            "deceleration_m_s2: 2.0",
            "deceleration_m_s2: -2.0",
            "safety.deceleration_m_s2: -2 is out of range",
        ),
        (
            "run_vcan0.yaml",
            "can: can.yaml",
            "can: cam.yaml",
            "cam.yaml",
        ),
        (
            "run_vcan0.yaml",
            "decision_time_s: 0.03",
            "decision_time_s: 3",
            "cycle.decision_time_s: 3 is out of range",
        ),
    ] {
        let folder = format!("wrong_{}", new.replace(|c: char| !c.is_alphanumeric(), ""));
        let config = configuration(&folder, &[(file, old, new)]);
        let output = run_to_end(&["run", config.to_str().unwrap()]);
        let text = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{text}");
        assert!(text.contains(expected), "{text}");
        assert!(text.contains(".yaml") || text.contains(".dbc"), "{text}");
    }
}

#[test]
fn a_bus_is_not_driven_in_simulated_time() {
    let file = configuration("simulated_time", &[]);
    let file = file.with_file_name("run_can_ros2.yaml");
    let name = file.to_str().unwrap();
    let parameter = ["--ros-args", "-p", "use_sim_time:=true"];
    let by_parameter = run_to_end(&[&["run", name][..], &parameter].concat());
    let text = std::fs::read_to_string(&file).unwrap();
    let simulated = text.replace(
        "  autostart: true",
        "  use_sim_time: true\n  autostart: true",
    );
    assert_ne!(simulated, text);
    std::fs::write(&file, simulated).unwrap();
    for output in [by_parameter, run_to_end(&["check", name])] {
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{complaint}");
        for part in ["run_can_ros2.yaml", "ros2.use_sim_time"] {
            assert!(complaint.contains(part), "{complaint}");
        }
    }
}

#[test]
fn a_yaw_rate_that_nobody_reads_is_refused() {
    for (name, old, new, expected) in [
        (
            "run_can_ros2.yaml",
            "  inputs: # topics\n",
            "  inputs:\n    yaw_rate: imu\n",
            "ros2.inputs.yaw_rate: an imu is read with port: ros2 only, must be none",
        ),
        (
            "odometry_ros2.yaml",
            "  attitude: imu",
            "  yaw_rate: imu\n  attitude: imu",
            "unknown field `yaw_rate`",
        ),
    ] {
        let file = configuration("unread_yaw_rate", &[(name, old, new)]).with_file_name(name);
        let output = run_to_end(&["check", file.to_str().unwrap()]);
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert!(!output.status.success(), "{complaint}");
        for part in [name, expected] {
            assert!(complaint.contains(part), "{complaint}");
        }
    }
}

#[test]
fn a_bus_that_is_not_there_is_named_on_the_screen_and_in_json() {
    let file = configuration("no_bus", &[("run_vcan0.yaml", "vcan0", "nocan7")]);
    let run = ["run", file.to_str().unwrap(), "--duration-s", "2.5"];
    let text = run_to_end(&[&run[..], &["--format", "text"]].concat());
    let text = String::from_utf8(text.stdout).unwrap();
    for part in [
        "listens to bus nocan7",
        "traction drive",
        "waits for bus on nocan7: there is no such interface",
        "ended: stopped",
    ] {
        assert!(text.contains(part), "no `{part}` in {text}");
    }
    let json = String::from_utf8(run_to_end(&run).stdout).unwrap();
    let first: serde_json::Value = serde_json::from_str(json.lines().next().unwrap()).unwrap();
    assert_eq!(first["waits_for"][0]["input"], "bus", "{json}");
    assert_eq!(first["state"], "disarmed");
}

#[test]
fn motors_are_tested_at_a_terminal_only_and_slowly() {
    let config = repository("config/bridge/run_vcan0.yaml");
    let elsewhere = std::env::temp_dir().join("sidehill_corrected.yaml");
    for (arguments, expected) in [
        (&[][..], "standard input is no terminal"),
        (&["--speed-m-s", "0.2"], "--speed-m-s: 0.2 is out of range"),
        (
            &["--write", elsewhere.to_str().unwrap()],
            "--write: name a file beside",
        ),
    ] {
        let test = ["can", "test", config.to_str().unwrap()];
        let output = run_to_end(&[&test[..], arguments].concat());
        let complaint = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(2), "{complaint}");
        assert!(
            complaint.contains(expected),
            "no `{expected}` in {complaint}"
        );
    }
}

#[test]
fn a_file_of_another_kind_is_named() {
    let scenario = repository("config/scenarios/slalom.yaml");
    let output = run_to_end(&["run", scenario.to_str().unwrap()]);
    let complaint = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2));
    for part in ["slalom.yaml", "the file looks like a scenario"] {
        assert!(complaint.contains(part), "no `{part}` in {complaint}");
    }
}
