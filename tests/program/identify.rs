//! `sidehill identify`: on logs of real vehicles, and with `--contact` on those of `simulate --out`.

use crate::{Course, assert_says, repository, sidehill, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// What moved the vehicle: `config/vehicles/j8_contact.yaml`, with c_l and c_r of `j8.yaml`.
const TRUTH: [(&str, f64); 12] = [
    ("correction_left", 1.004),
    ("correction_right", 1.011),
    ("friction", 0.9),
    ("centre_of_mass_right_m", -0.034),
    ("centre_of_mass_forward_m", 0.193),
    ("centre_of_mass_height_m", 0.4),
    ("inner_load_share", 0.743),
    ("inner_stiffness", 1.0),
    ("lateral_share", 1.0),
    ("slip_scale_m_s", 0.02),
    ("rolling_resistance", 0.02),
    ("patch_radius_m", 0.09),
];

/// Returns the log of a scenario driven on wheels with friction.
fn log(scenario: &str, folder: &Path) -> PathBuf {
    let out = folder.join(scenario);
    let file = repository(&format!("config/scenarios/{scenario}.yaml"));
    succeed(
        sidehill()
            .arg("simulate")
            .arg(file)
            .args([
                "--plant",
                "contact",
                "--controller",
                "pure-pursuit",
                "--out",
            ])
            .arg(&out),
    );
    out.join("pure-pursuit.csv")
}

/// Returns what identification prints, from the base rectangle alone.
fn identify(logs: &[&PathBuf], folder: &Path, format: &str) -> String {
    succeed(
        sidehill()
            .args(["identify", "--contact", "--segment-s", "2", "--force"])
            .args(["--format", format, "--slope"])
            .args(logs)
            .arg("--vehicle")
            .arg(repository("config/vehicles/j8.yaml"))
            .arg("--out")
            .arg(folder.join("found.yaml")),
    )
}

#[test]
fn the_wheels_come_back_within_their_intervals_and_what_is_not_told_apart_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let figure_eight = log("figure_eight", folder.path());
    let slalom = log("slalom", folder.path());
    let steeper = log("figure_eight_10deg", folder.path());

    // On one course at one slope some parameters have the effect of others.
    let alone = identify(&[&figure_eight], folder.path(), "table");
    assert_says(&alone, &["the logs cannot tell apart "]);
    let written = || std::fs::read_to_string(folder.path().join("found.yaml")).unwrap();
    assert_says(
        &written(),
        &[
            "drawn to the guess it started from: patch_radius_m",
            "drawn to the guess it started from: inner_stiffness",
        ],
    );
    let all = identify(&[&figure_eight, &slalom, &steeper], folder.path(), "json");
    let figures: Value = serde_json::from_str(&all).unwrap();
    let contact = &figures["contact"];
    assert_eq!(contact["settled"], true);
    let pairs = contact["not_told_apart"].as_array().unwrap();
    assert!(pairs.len() <= 1, "{pairs:?}");
    let mut inside = 0;
    for (name, truth) in TRUTH {
        let estimate = &contact["estimates"][name];
        let ends: Vec<f64> = serde_json::from_value(estimate["interval_95"].clone()).unwrap();
        let value = estimate["value"].as_f64().unwrap();
        assert_eq!(estimate["determined"], true, "{name}: {estimate}");
        inside += usize::from((ends[0]..=ends[1]).contains(&truth));
        // Intervals of 95 % may miss a truth, but not by far.
        let half_width = 0.5 * (ends[1] - ends[0]);
        assert!(
            (value - truth).abs() < 2.0 * half_width,
            "{name}: {estimate}"
        );
    }
    assert!(inside >= 11, "{inside} of {}: {contact}", TRUTH.len());

    // contact-mpc starts from the identified parameters.
    let vehicle: Value = serde_yaml::from_str(&written()).unwrap();
    let found = vehicle["contact"]["friction"].as_f64().unwrap();
    let printed = contact["estimates"]["friction"]["value"].as_f64().unwrap();
    assert!((found - printed).abs() < 1e-9, "{found} {printed}");
}

#[test]
fn a_gain_that_the_logs_do_not_determine_is_said_to_be_so() {
    let course = Course::new("");
    let logs = repository("plant/tests/data/trento_ramps");
    let out = course.path("identified.yaml");
    // A log of level ground, given as one of a slope.
    let said = succeed(
        sidehill()
            .arg("identify")
            .arg("--slope")
            .arg(logs.join("flat_left_5.48.csv"))
            .args(["--segment-s", "4", "--columns"])
            .arg(logs.join("columns.yaml"))
            .arg("--vehicle")
            .arg(logs.join("vehicle.yaml"))
            .arg("--out")
            .arg(&out),
    );
    assert_says(
        &said,
        &[
            "not determined by these logs, stays at 0.2",
            "lambda_1_s_per_rad",
            "verdict: good enough to drive at up to 2 deg",
            "the slope logs were made on 0.0 deg",
        ],
    );
    // An unknown value is not written as if it were known: that of the start vehicle is kept.
    let yaml = std::fs::read_to_string(out).unwrap();
    assert_says(
        &yaml,
        &[
            "# NOT DETERMINED by these logs",
            "\nlambda_1_s_per_rad: 0.2\n",
        ],
    );
}

/// Returns what `identify --format json` says of logs of real vehicles.
fn identified(folder: &str, level: &[&str], slope: &[&str], segment_s: &str) -> serde_json::Value {
    let course = Course::new("");
    let logs = repository("plant/tests/data").join(folder);
    let mut command = sidehill();
    command.args(["identify", "--format", "json", "--segment-s", segment_s]);
    for (option, names) in [("--level", level), ("--slope", slope)] {
        for name in names {
            command.arg(option).arg(logs.join(name));
        }
    }
    let columns = [logs.join("columns.yaml"), logs.join("vehicle.yaml")];
    command.arg("--columns").arg(&columns[0]);
    command.arg("--vehicle").arg(&columns[1]);
    command.arg("--out").arg(course.path("identified.yaml"));
    serde_json::from_str(&succeed(&mut command)).unwrap()
}

#[test]
fn an_identification_ends_with_a_verdict_and_its_reasons() {
    let level = [
        "flat_left_-5.48.csv",
        "flat_left_5.48.csv",
        "flat_left_10.17.csv",
    ];
    let slope = ["ramp_0.150_left_18.0.csv", "ramp_0.150_left_-18.0.csv"];
    let good = identified("trento_ramps", &level, &slope, "4");
    let max_slope_deg = good["verdict"]["max_slope_deg"].as_f64().unwrap();
    assert!((8.0..=14.0).contains(&max_slope_deg), "{good}");
    let gain = &good["slope"]["estimates"]["lambda_1_s_per_rad"]["value"];
    assert_eq!(good["vehicle"]["lambda_1_s_per_rad"], *gain);
    // On ramps lambda_2 is 0 within its interval.
    let unknown = &good["slope"]["undetermined"]["lambda_2_s_per_rad"];
    assert_eq!(unknown["kept"], 0.1);
    assert_eq!(good["vehicle"]["lambda_2_s_per_rad"], 0.1);

    // 20 segments on grass hardly distinguish the ICRs from the wheels' factors.
    let poor = identified("warthog_grass", &["train.csv"], &[], "2");
    assert_eq!(poor["verdict"]["max_slope_deg"], 0.0, "{poor}");
    let reasons = poor["verdict"]["reasons"].to_string();
    assert_says(&reasons, &["do not determine x_icr", "no slope logs"]);
    assert_eq!(poor["vehicle"]["x_icr_right_m"], 0.8);
    let shown = &poor["level"]["undetermined"]["x_icr_right_m"]["half_width_95"];
    assert!(shown.as_f64().unwrap() > 0.3, "{poor}");
}

#[test]
fn drives_are_found_from_a_log_and_from_a_recording_and_conditions_are_written() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let weak = std::fs::read_to_string(repository("config/conditions/realistic.yaml")).unwrap();
    let weak = weak
        .replace(
            "delay_s: 0.1\n  traction: {",
            "delay_s: 0.3\n  traction: {speed_max_m_s: 0.4, ",
        )
        .replace(
            "steer: {time_constant_s: 0.15",
            "steer: {time_constant_s: 0.4",
        );
    std::fs::write(at("weak.yaml"), weak).unwrap();
    let mut simulate = sidehill();
    simulate
        .arg("simulate")
        .arg(repository("config/scenarios/slalom.yaml"))
        .args(["--controller", "pure-pursuit", "--conditions"])
        .arg(at("weak.yaml"))
        .arg("--out")
        .arg(at("out"))
        .arg("--record")
        .arg(at("run.mcap"));
    simulate.output().unwrap();
    for log in [at("out/pure-pursuit.csv"), at("run.mcap")] {
        let identify = |format: &str| {
            succeed(
                sidehill()
                    .args(["identify", "--force", "--format", format, "--drives"])
                    .arg(&log)
                    .arg("--vehicle")
                    .arg(repository("config/vehicles/j8.yaml"))
                    .arg("--out")
                    .arg(at("found.yaml")),
            )
        };
        let found: Value = serde_json::from_str(&identify("json")).unwrap();
        for (motor, key, expected) in [
            ("traction", "delay_s", 0.3),
            ("steer", "delay_s", 0.3),
            ("traction", "speed_max_m_s", 0.4),
            ("steer", "time_constant_s", 0.4),
        ] {
            let value = found["drives"][motor][key]["value"].as_f64().unwrap();
            assert!((value - expected).abs() < 0.02, "{motor} {key} {value}");
        }
        assert!(
            found["drives"]["steer"]["speed_max_m_s"]["at_least"]
                .as_f64()
                .unwrap()
                > 0.1
        );
        assert_says(
            &identify("table"),
            &["the traction motor reaches 0.40 m/s of"],
        );
        // What was found is what a controller reads.
        let written = std::fs::read_to_string(at("found.yaml")).unwrap();
        assert_says(&written, &["speed_m_s: 0.4"]);
        let (_, delay) = written.split_once("command_delay_s: ").unwrap();
        let delay_s: f64 = delay.lines().next().unwrap().parse().unwrap();
        assert!((delay_s - 0.3).abs() < 0.01, "{delay_s}");
        assert_eq!(found["controller"]["command_delay_s"], delay_s);
        succeed(sidehill().arg("check").arg(at("found.yaml")));
    }
    let mut wrong = sidehill();
    wrong
        .args(["identify", "--drives"])
        .arg(repository("plant/tests/data/drive/columns.yaml"))
        .arg("--vehicle")
        .arg(repository("config/vehicles/j8.yaml"))
        .arg("--out")
        .arg(at("none.yaml"));
    assert_says(&crate::fail(&mut wrong), &["columns.yaml", "no column"]);
    assert!(!at("none.yaml").exists());
}

/// Returns a log of 60 s in arcs of both senses on ground of this slope, which the vehicle drives as ideal
/// differential drive.
fn arcs(folder: &Path, name: &str, slope_rad: f64) -> PathBuf {
    let mut text =
        "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad,x_m,y_m,z_m,yaw_rad\n".to_owned();
    let (mut x_m, mut y_m, mut yaw_rad) = (0.0, 0.0, 0.0_f64);
    for step in 0..1200 {
        let steer_m_s = if step % 200 < 100 { 0.2 } else { -0.1 };
        text += &format!(
            "{},{},{},0,{slope_rad},{x_m},{y_m},0,{yaw_rad}\n",
            0.05 * f64::from(step),
            0.5 - steer_m_s,
            0.5 + steer_m_s
        );
        x_m -= 0.05 * 0.5 * yaw_rad.sin();
        y_m += 0.05 * 0.5 * yaw_rad.cos();
        yaw_rad += 0.05 * steer_m_s / 0.8;
    }
    let path = folder.join(name);
    std::fs::write(&path, text).unwrap();
    path
}

#[test]
fn logs_of_level_and_sloping_ground_that_are_exchanged_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let level = arcs(folder.path(), "level.csv", 0.0);
    let slope = arcs(folder.path(), "slope.csv", 0.14);
    let mut command = sidehill();
    command
        .arg("identify")
        .arg("--level")
        .arg(&slope)
        .arg("--slope")
        .arg(&level);
    command
        .arg("--vehicle")
        .arg(repository("config/vehicles/j8.yaml"));
    command.arg("--out").arg(folder.path().join("found.yaml"));
    let says = crate::fail(&mut command);
    assert_says(
        &says,
        &[
            "slope.csv is from ground of 8.0 deg",
            "level.csv",
            "exchanged?",
        ],
    );
}
