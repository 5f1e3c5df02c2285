//! `sidehill check` on all of `config/` and on broken files.

use crate::{Course, assert_says, fail, repository, sidehill, stderr, stdout, succeed, text};
use std::path::PathBuf;

fn yaml_files(folder: &str) -> Vec<PathBuf> {
    let mut files: Vec<PathBuf> = repository(folder)
        .read_dir()
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "yaml"))
        .collect();
    files.sort();
    files
}

#[test]
fn every_vehicle_scenario_conditions_and_campaign_of_the_repository_is_valid() {
    let files = [
        yaml_files("config/vehicles"),
        yaml_files("config/scenarios"),
        yaml_files("config/conditions"),
        yaml_files("config/campaigns"),
    ]
    .concat();
    assert!(files.len() >= 16, "{files:?}");
    let lines = succeed(sidehill().arg("check").args(&files));
    for file in &files {
        assert_says(&lines, &[&format!("{}: valid", file.display())]);
    }
    assert_eq!(lines.lines().count(), files.len());
}

/// Returns the output of `check` for a file with `text`.
fn complaint(name: &str, text: &str) -> String {
    let course = Course::new("");
    let file = course.write(name, text);
    fail(sidehill().arg("check").arg(file))
}

#[test]
fn a_broken_vehicle_is_named_with_key_value_and_range() {
    let j8 = text("config/vehicles/j8.yaml");
    for (from, to, says) in [
        (
            "x_icr_right_m: 1.073",
            "x_icr_right_m: -1.073",
            &["x_icr_right_m", "-1.073", "must be"][..],
        ),
        (
            "lambda_1_s_per_rad: 1.222",
            "lambda_1_s_per_rad: -1",
            &["lambda_1_s_per_rad", "-1", "from 0 to 100"],
        ),
        (
            "correction_left: 1.004",
            "correction_left: .nan",
            &["correction_left", "NaN", "from 0.5 to 2"],
        ),
        (
            "speed_max_m_s: 1.0",
            "speed_max_m_s: fast",
            &["speed_max_m_s", "fast"],
        ),
        (
            "speed_max_m_s: 1.0",
            "speed_max_mph: 1.0",
            &["speed_max_mph"],
        ),
        ("speed_max_m_s: 1.0", "", &["speed_max_m_s", "missing"]),
        ("speed_max_m_s: 1.0", "speed_max_m_s: [1.0", &["line"]),
    ] {
        assert!(j8.contains(from), "{from}");
        let message = complaint("rover.yaml", &j8.replace(from, to));
        assert_says(&message, &["rover.yaml"]);
        assert_says(&message, says);
    }
}

#[test]
fn a_broken_scenario_is_named_with_key_value_and_range() {
    for (extra, says) in [
        ("speedy: 1\n", &["scenario.yaml", "speedy"][..]),
        (
            "speed: {speed_m_s: 90}\n",
            &["scenario.yaml", "speed.speed_m_s", "90", "from 0.01 to 20"],
        ),
        ("laps: 0\n", &["scenario.yaml", "laps", "0", "from 1 to"]),
        (
            "controller: {weights: {cross_per_m2: -5}}\n",
            &["scenario.yaml", "weights.cross_per_m2", "-5", "from 0 to"],
        ),
        ("controller: {stage: 40}\n", &["scenario.yaml", "stage"]),
        (
            "sensors: {pose: {timing: {dropout_probability: 1.5}}}\n",
            &[
                "scenario.yaml",
                "pose.timing.dropout_probability",
                "1.5",
                "from 0 to 1",
            ],
        ),
        (
            "route: {file: nowhere.gpx}\n",
            &["scenario.yaml", "course and route"],
        ),
        (
            "contact: {vehicle: a.yaml}\n",
            &["scenario.yaml", "identified"],
        ),
    ] {
        let course = Course::new(extra);
        let message = fail(sidehill().arg("check").arg(course.path("scenario.yaml")));
        assert_says(&message, says);
    }
}

#[test]
fn what_a_scenario_names_is_checked_too() {
    let course = Course::new("");
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let vehicle = repository("config/vehicles/j8.yaml").display().to_string();
    let file = course.write("other.yaml", &scenario.replace(&vehicle, "lost.yaml"));
    assert_says(&fail(sidehill().arg("check").arg(&file)), &["lost.yaml"]);
    course.write(
        "lost.yaml",
        &text("config/vehicles/j8.yaml").replace("correction_left: 1.004", "correction_left: 9"),
    );
    let message = fail(sidehill().arg("check").arg(&file));
    assert_says(
        &message,
        &["lost.yaml", "correction_left", "9", "from 0.5 to 2"],
    );
}

#[test]
fn a_file_that_is_missing_or_of_no_kind_is_named() {
    let message = fail(sidehill().args(["check", "no_such_file.yaml"]));
    assert_says(&message, &["no_such_file.yaml"]);
    let message = complaint("odd.yaml", "colour: blue\n");
    assert_says(&message, &["odd.yaml", "neither a campaign", "a scenario"]);
}

#[test]
fn one_broken_file_fails_the_lot_and_the_others_are_still_judged() {
    let good = repository("config/vehicles/lazaro.yaml");
    let output = sidehill()
        .args(["check", "no_such_file.yaml"])
        .arg(&good)
        .output()
        .unwrap();
    assert!(!output.status.success());
    assert_says(&crate::stdout(&output), &["lazaro.yaml: valid vehicle"]);
}

#[test]
fn a_route_over_steep_ground_is_refused_with_place_and_figure() {
    let scenario = repository("config/scenarios/steep_ground.yaml");
    let course = Course::new("");
    let route = |name: &str, rise: f64| {
        let rows: Vec<String> = (0..30)
            .map(|i| {
                let x_m = f64::from(i);
                format!("{x_m},0,{}", (rise * (x_m - 15.0)).max(0.0))
            })
            .collect();
        course.write(name, &format!("x_m,y_m,z_m\n{}\n", rows.join("\n")))
    };
    let judged = |file: PathBuf| {
        let mut command = sidehill();
        command.arg("check").arg(&scenario).arg("--route").arg(file);
        command
    };
    let said = fail(&mut judged(route("steep.csv", 0.8)));
    assert_says(
        &said,
        &["steep.csv", "refused, too steep", "m along the path at ("],
    );
    let said = succeed(&mut judged(route("gentle.csv", 0.1)));
    assert_says(&said, &["valid scenario"]);
    let mut off = sidehill();
    off.arg("check")
        .arg(repository("config/scenarios/slalom.yaml"));
    off.arg("--route").arg(route("other.csv", 0.1));
    assert_says(&fail(&mut off), &["slalom.yaml", "guard is off"]);
}

#[test]
fn a_can_database_in_windows_1252_is_read_as_its_editor_wrote_it() {
    let folder = tempfile::tempdir().unwrap();
    let layout = std::fs::read_to_string(repository("config/bridge/can.yaml")).unwrap();
    std::fs::write(folder.path().join("can.yaml"), layout).unwrap();
    let mut database = std::fs::read(repository("config/bridge/j8.dbc")).unwrap();
    // A degree sign and a curved quote.
    database.extend(b"\nCM_ \"Roll in \xb0, the vehicle\x92s own\";\n");
    std::fs::write(folder.path().join("j8.dbc"), database).unwrap();
    succeed(sidehill().arg("check").arg(folder.path().join("can.yaml")));
}

#[test]
fn of_a_folder_all_configurations_are_checked_and_other_files_are_named() {
    let lines = succeed(sidehill().args(["check", repository("config").to_str().unwrap()]));
    for says in [
        "config/vehicles/j8.yaml: valid vehicle\n",
        "config/scenarios/slalom.yaml: valid scenario\n",
        "config/bridge/run_ros2.yaml: valid configuration of run\n",
    ] {
        assert!(lines.contains(says), "{says}{lines}");
    }
    let course = Course::new("");
    let folder = course.path("all");
    for inner in ["deep/er", ".hidden"] {
        std::fs::create_dir_all(folder.join(inner)).unwrap();
    }
    std::os::unix::fs::symlink(&folder, folder.join("again")).unwrap();
    let j8 = text("config/vehicles/j8.yaml");
    for (name, text) in [
        ("all/good.yaml", j8.clone()),
        ("all/wrong.yml", j8.replace("y_icr", "z_icr")),
        ("all/deep/er/syntax.yaml", "controllers: [".to_owned()),
        ("all/.hidden/wrong.yaml", "axles: 1".to_owned()),
        ("all/other.yaml", "services: {web: {}}".to_owned()),
        ("all/list.yaml", "- a\n- b\n".to_owned()),
        (
            "all/two.yaml",
            "---\nkind: A\n---\nkind: B\n---\nkind: C\n".to_owned(),
        ),
        ("all/notes.txt", "axles: 1".to_owned()),
    ] {
        course.write(name, &text);
    }
    let output = sidehill().arg("check").arg(&folder).output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    let (lines, errors) = (stdout(&output), stderr(&output));
    let mut said: Vec<String> = lines
        .lines()
        .map(|line| line.replace(folder.to_str().unwrap(), ""))
        .collect();
    said.sort();
    assert_eq!(
        said,
        [
            "/good.yaml: valid vehicle",
            "/list.yaml: skipped, not of Sidehill",
            "/other.yaml: skipped, not of Sidehill",
            "/two.yaml: skipped, not of Sidehill",
        ]
    );
    assert_says(&errors, &["wrong.yml: ", "deep/er/syntax.yaml: "]);
    assert_eq!(errors.lines().count(), 2, "{errors}");

    std::fs::remove_file(folder.join("good.yaml")).unwrap();
    std::fs::remove_file(folder.join("wrong.yml")).unwrap();
    std::fs::remove_dir_all(folder.join("deep")).unwrap();
    let errors = fail(sidehill().arg("check").arg(&folder));
    assert_says(&errors, &["has no YAML file of Sidehill"]);
}

#[test]
fn a_folder_that_is_no_folder_of_configurations_is_refused() {
    let course = Course::new("");
    let deep = course.path("deep").join("a/b/c/d/e/f/g/h/i/j/k");
    std::fs::create_dir_all(deep).unwrap();
    let errors = fail(sidehill().arg("check").arg(course.path("deep")));
    assert_says(&errors, &["more than 10 folders"]);
    let route = ["--route", "path.csv"];
    let errors = fail(sidehill().arg("check").arg(course.path("deep")).args(route));
    assert_says(&errors, &["--route", "not its folder"]);
}
