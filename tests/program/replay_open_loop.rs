//! `sidehill replay --open-loop`: logs of other programs through the controller of a scenario.

use crate::{Course, assert_says, fail, repository, sidehill, stderr, stdout, succeed};
use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn open_loop(log: &Path, scenario: &Path) -> Command {
    let mut command = sidehill();
    command.arg("replay").arg(log);
    command.arg("--open-loop").arg(scenario);
    command
}

/// Returns what is printed as JSON, and the exit status.
fn json(command: &mut Command) -> (Value, i32) {
    let output = command.args(["--format", "json"]).output().unwrap();
    let text = stdout(&output);
    let value = serde_json::from_str(&text)
        .unwrap_or_else(|error| panic!("{error}: {text}{}", stderr(&output)));
    (value, output.status.code().unwrap())
}

fn number(figures: &Value, name: &str) -> f64 {
    let value = figures[name].as_f64();
    value.unwrap_or_else(|| panic!("{name} in {figures}"))
}

/// The log of a Warthog as CSV, and its bags that another program wrote, with the command that replays one.
fn warthog(course: &Course, log: &str) -> Command {
    let mut command = open_loop(&repository(log), &course.path("scenario.yaml"));
    let vehicle = repository("plant/tests/data/drive/warthog_2023/vehicle.yaml");
    command.arg("--vehicle").arg(vehicle);
    if !log.ends_with(".csv") {
        let map = repository("tests/data/bags/topics.yaml");
        command.arg("--topics").arg(map);
    }
    command
}

const CSV: &str = "plant/tests/data/drive/warthog_2023/turning.csv";
const BAG: &str = "tests/data/bags/warthog_2023/mcap";

#[test]
fn bags_of_another_program_give_the_figures_of_their_csv() {
    let course = Course::new("");
    let (csv, status) = json(&mut warthog(&course, CSV));
    assert_eq!(status, 0, "{csv}");
    assert!(number(&csv, "drives") >= 10.0, "{csv}");
    assert!(number(&csv, "cycles") > 300.0, "{csv}");
    assert_eq!(csv["vehicle"], "warthog-2023");
    let shares = csv["status"].as_object().unwrap();
    let sum: f64 = shares.values().map(|share| share.as_f64().unwrap()).sum();
    assert!((sum - 1.0).abs() < 1e-9, "{csv}");
    for bag in [BAG, "tests/data/bags/warthog_2023/by_file"] {
        let (figures, status) = json(&mut warthog(&course, bag));
        assert_eq!(status, 0, "{figures}");
        for name in ["drives", "left_out", "starting", "cycles", "different"] {
            assert_eq!(figures[name], csv[name], "{name}: {figures}\n{csv}");
        }
        for name in [
            "largest_difference_m_s",
            "traction_rms_m_s",
            "steer_rms_m_s",
            "cross_track_rms_m",
        ] {
            // Angles went through quaternions, which changes the last digits, and the MPC propagates that.
            let difference = number(&figures, name) - number(&csv, name);
            assert!(difference.abs() < 1e-4, "{name}: {figures}\n{csv}");
        }
    }
}

#[test]
fn in_a_drive_of_its_own_the_controller_commands_much_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let scenario = repository("config/scenarios/reverse_cusp.yaml");
    let simulate = ["--controller", "icrik-mpc", "--out"];
    succeed(
        sidehill()
            .arg("simulate")
            .arg(&scenario)
            .args(simulate)
            .arg(folder.path()),
    );
    let log = folder.path().join("icrik-mpc.csv");
    let report = folder.path().join("open_loop.html");
    let (figures, status) = json(open_loop(&log, &scenario).arg("--report").arg(&report));
    assert_eq!(status, 0, "{figures}");
    // Forward to the cusp and back.
    assert_eq!(figures["drives"], 2, "{figures}");
    assert!(figures["first_stop"].is_null(), "{figures}");
    assert!(number(&figures["status"], "tracking") > 0.9, "{figures}");
    // The motors change by at most 2 m/s^2, 0.1 m/s in a period of 0.05 s, and only where the speed changes. A
    // command differs from the motion by what the motors do in a period, so its RMS is below that.
    for name in ["traction_rms_m_s", "steer_rms_m_s"] {
        assert!(number(&figures, name) < 0.1, "{name}: {figures}");
    }
    // The path is smoothed over 10 cm and stays within 2 mm of that; a curve of 3 m radius is off by 0.1^2 / (2 * 3) m more.
    assert!(number(&figures, "cross_track_rms_m") < 0.01, "{figures}");
    let page = std::fs::read_to_string(report).unwrap();
    let cycles = figures["cycles"].to_string();
    let parts = [
        "Open-loop replay",
        "measured",
        "commanded",
        "cross-track",
        "solve time",
        &cycles,
    ];
    assert_says(&page, &parts);
    let table = succeed(&mut open_loop(&log, &scenario));
    assert_says(&table, &["tracking", "first stop", "none", &cycles]);

    let tolerance = |value: &str| {
        let output = open_loop(&log, &scenario)
            .args(["--tolerance", value])
            .output();
        output.unwrap().status.code().unwrap()
    };
    assert_eq!(tolerance("10"), 0);
    assert_eq!(tolerance("1e-6"), 1);
    // Motors slower than the recorded drive.
    let (slow, _) =
        json(open_loop(&log, &scenario).args(["--set", "limits.traction.speed_m_s=0.2"]));
    assert!(
        number(&slow, "traction_rms_m_s") > 2.0 * number(&figures, "traction_rms_m_s"),
        "{slow}"
    );
}

/// Returns the error of a command that fails.
fn refused(command: &mut Command) -> String {
    assert_eq!(command.output().unwrap().status.code(), Some(2));
    fail(command)
}

#[test]
fn what_is_wrong_with_a_log_is_named() {
    let course = Course::new("");
    let scenario = course.path("scenario.yaml");
    let header = "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad";
    let rows = |row: &str| {
        (0..40)
            .map(|i| format!("{},{row}\n", 0.05 * f64::from(i)))
            .collect::<String>()
    };
    let blind = course.write("blind.csv", &format!("{header}\n{}", rows("0.5,0.5,0,0")));
    let map = course.write(
        "columns.yaml",
        "time: time_s\ntread_speed_left: v_left_m_s\ntread_speed_right: v_right_m_s\n\
         attitude: {kind: paper, roll: roll_rad, pitch: pitch_rad}\n",
    );
    let says = refused(open_loop(&blind, &scenario).arg("--columns").arg(&map));
    assert_says(&says, &["blind.csv", "no poses"]);
    let pose = format!("{header},x_m,y_m,z_m,yaw_rad\n");
    let parked = course.write("parked.csv", &format!("{pose}{}", rows("0,0,0,0,1,2,0,0")));
    let says = refused(&mut open_loop(&parked, &scenario));
    assert_says(&says, &["parked.csv", "the treads stand"]);
    let stuck = course.write(
        "stuck.csv",
        &format!("{pose}{}", rows("0.5,0.5,0,0,1,2,0,0")),
    );
    let says = refused(&mut open_loop(&stuck, &scenario));
    assert_says(&says, &["stuck.csv", "at 0.00 s", "holds no drive"]);
    let other = "tread_speeds: {kind: odometry, topic: /imu/data, track_width_m: 1}\n";
    let other = course.write("other.yaml", other);
    let bag = repository(BAG);
    let says = refused(open_loop(&bag, &scenario).arg("--topics").arg(&other));
    assert_says(
        &says,
        &[
            "/imu/data has the type sensor_msgs/msg/Imu",
            "tread_speeds",
            "other.yaml",
        ],
    );
    assert_says(&refused(&mut open_loop(&bag, &scenario)), &["--topics"]);
    let says = refused(&mut open_loop(&bag, &course.path("none.yaml")));
    assert_says(&says, &["none.yaml"]);
    let mut without = sidehill();
    let without = without.arg("replay").arg(&bag).arg("--topics").arg(&other);
    assert_says(&refused(without), &["--topics", "--open-loop SCENARIO"]);
    let says = refused(open_loop(&bag, &scenario).args(["--live", "--tolerance", "1"]));
    assert_says(&says, &["--live", "--open-loop"]);
    let says = refused(warthog(&course, BAG).arg("--tolerance=-1"));
    assert_says(&says, &["--tolerance"]);
}
