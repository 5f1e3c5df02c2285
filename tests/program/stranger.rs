//! A new user's first hour: common mistakes, each with a message that names file, place, cause and remedy, and
//! without loss of data.

use crate::{Course, assert_says, fail, repository, sidehill, stderr, succeed, text};
use std::process::Stdio;

/// A log of 20 s at 20 Hz: straight ahead, then wide turns, on a slight slope.
fn log() -> String {
    let mut text =
        "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad,x_m,y_m,z_m,yaw_rad\n".to_owned();
    let (mut x, mut y, mut yaw) = (0.0_f64, 0.0_f64, 0.0_f64);
    for i in 0..800 {
        let difference = if i % 200 < 100 { 0.0 } else { 0.3 };
        let (left, right) = (0.6 - 0.5 * difference, 0.6 + 0.5 * difference);
        let time = 0.05 * f64::from(i);
        text += &format!("{time:.3},{left},{right},0.03,0.02,{x:.5},{y:.5},0,{yaw:.5}\n");
        yaw += 0.05 * difference / 2.0;
        x -= 0.05 * 0.6 * yaw.sin();
        y += 0.05 * 0.6 * yaw.cos();
    }
    text
}

/// Returns the error of `check` for a file.
fn complaint(name: &str, text: &str) -> String {
    let course = Course::new("");
    let file = course.write(name, text);
    fail(sidehill().arg("check").arg(file))
}

/// Returns the error of `check` for the course's scenario with a text replaced.
fn scenario_complaint(from: &str, to: &str) -> String {
    let course = Course::new("");
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    assert!(scenario.contains(from), "{from}");
    let file = course.write("scenario.yaml", &scenario.replace(from, to));
    fail(sidehill().arg("check").arg(file))
}

#[test]
fn mistakes_in_yaml_name_the_line_and_the_cause() {
    let plane = "terrain: {kind: plane, slope_deg: 8, uphill_heading_deg: 60}";
    for (to, says) in [
        (
            "terrain: {kind: level, slope_deg: 8}",
            &["slope_deg", "line 3"][..],
        ),
        (
            "terrain: {kind: grid, file: a.asc, cell_m: 1}",
            &["cell_m", "line 3"],
        ),
        (
            "terrain: {kind: plane, slope_rad: 0.1, uphill_heading_deg: 60}",
            &["slope_rad", "slope_deg", "line 3"],
        ),
        (
            "terrain: {kind: plane, slope_deg: 95, uphill_heading_deg: 60}",
            &["slope_deg", "95", "line 3"],
        ),
        ("terrain: {kind: hill}", &["hill", "plane", "line 3"]),
        ("terrain:\n\tkind: level", &["line 4", "tab", "spaces"]),
        (
            "terrain: {kind: level}\nseed: 2",
            &["seed", "twice", "lines 4 and 8"],
        ),
        (
            "terrain: {kind: grid, file: lost.asc}",
            &["lost.asc", "named by", "scenario.yaml"],
        ),
    ] {
        let message = scenario_complaint(plane, to);
        assert_says(&message, &["scenario.yaml"]);
        assert_says(&message, says);
    }
    let message = scenario_complaint("vehicle: ", "vehicle: nowhere/");
    assert_says(&message, &["nowhere/", "named by", "scenario.yaml"]);
}

#[test]
fn a_byte_order_mark_is_no_mistake() {
    let course = Course::new("");
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let file = course.write("marked.yaml", &format!("\u{feff}{scenario}"));
    assert_says(
        &succeed(sidehill().arg("check").arg(file)),
        &["valid scenario"],
    );
    let file = course.write("marked.csv", &format!("\u{feff}{}", log()));
    assert_says(&succeed(sidehill().arg("check").arg(file)), &["valid log"]);
}

#[test]
fn mistakes_in_logs_name_row_cause_and_remedy() {
    let good = log();
    assert_eq!(complaint("empty.csv", "").lines().count(), 1);
    for (name, text, says) in [
        ("empty.csv", String::new(), &["empty", "column"][..]),
        (
            "comma.csv",
            good.replacen("0.03,0.02,", "0,03,0.02,", 1),
            &["line 2", "10 fields", "12.5, not 12,5"],
        ),
        (
            "twice.csv",
            good.replacen("roll_rad", "pitch_rad", 1),
            &["two columns are named pitch_rad"],
        ),
        (
            "lacks.csv",
            good.replacen("roll_rad", "roll", 1),
            &["no column roll_rad", "--columns"],
        ),
        (
            "degrees.csv",
            good.replace(",0.03,0.02,", ",3.0,2.0,"),
            &["row 1", "roll_rad", "degrees"],
        ),
        (
            "rpm.csv",
            good.replace(",0.6,0.6,", ",57,57,"),
            &["row 1", "v_left_m_s", "rpm"],
        ),
        (
            "word.csv",
            good.replacen("0.02", "flat", 1),
            &["row 1", "pitch_rad", "flat"],
        ),
    ] {
        let message = complaint(name, &text);
        assert_says(&message, &[name]);
        assert_says(&message, says);
    }
    let course = Course::new("");
    let swapped = good.replacen("v_left_m_s,v_right_m_s", "v_right_m_s,v_left_m_s", 1);
    let file = course.write("swapped.csv", &swapped);
    let output = sidehill().arg("check").arg(file).output().unwrap();
    assert!(output.status.success());
    assert_says(&stderr(&output), &["swapped.csv", "warning", "swapped"]);
}

#[test]
fn mistakes_in_paths_are_found_before_anything_runs() {
    assert_says(
        &complaint("route.csv", "x_m,y_m\n0,0\n12,5,3\n"),
        &["route.csv", "line 3", "12.5, not 12,5"],
    );
    assert_says(
        &complaint("route.gpx", "x_m,y_m\n0,0\n"),
        &["route.gpx", "not XML", ".csv"],
    );
    let course = Course::new("");
    let path = course.write("path.csv", "x_m,y_m\n0,0\n0,5\n0,10\n");
    let said = succeed(sidehill().arg("check").arg(&path));
    assert_eq!(said.lines().count(), 1, "{said}");
    let grid = "ncols 3\nnrows 3\nxllcorner -3\nyllcorner -3\ncellsize 3\n0 0 0\n0 0 0\n0 0 0\n";
    course.write("small.asc", grid);
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let file = course.write(
        "scenario.yaml",
        &scenario
            .replace(
                "terrain: {kind: plane, slope_deg: 8, uphill_heading_deg: 60}",
                "terrain: {kind: grid, file: small.asc}",
            )
            .replace(
                "course: {shape: straight, length_m: 2, speed_m_s: 0.5}",
                "route: {file: path.csv}\nspeed: {speed_m_s: 5}",
            ),
    );
    let message = fail(sidehill().arg("check").arg(&file));
    assert_says(
        &message,
        &["scenario.yaml", "leaves the ground", "from its start"],
    );
    let file = course.write(
        "fast.yaml",
        &scenario.replace(
            "course: {shape: straight, length_m: 2, speed_m_s: 0.5}",
            "route: {file: path.csv}\nspeed: {speed_m_s: 5}",
        ),
    );
    let output = sidehill().arg("check").arg(&file).output().unwrap();
    assert!(output.status.success(), "{}", stderr(&output));
    assert_says(&stderr(&output), &["speed.speed_m_s: 5", "speed_max_m_s"]);
}

#[test]
fn another_vehicle_is_not_replaced_by_the_j8() {
    let course = Course::new("");
    let husky =
        text("config/vehicles/j8.yaml").replace("x_icr_right_m: 1.073", "x_icr_right_m: 0.9");
    course.write("husky.yaml", &husky.replace("name: j8", "name: husky"));
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let j8 = repository("config/vehicles/j8.yaml").display().to_string();
    let file = course.write("scenario.yaml", &scenario.replace(&j8, "husky.yaml"));
    for arguments in [["--plant", "contact"], ["--conditions", "realistic"]] {
        let message = fail(sidehill().arg("simulate").arg(&file).args(arguments));
        assert_says(
            &message,
            &[
                "scenario.yaml",
                "contact: {vehicle: FILE, identified: FILE}",
                "husky",
            ],
        );
    }
}

#[test]
fn nothing_that_exists_is_overwritten() {
    let course = Course::new("");
    let vehicle = course.write("vehicle.yaml", &text("config/vehicles/j8.yaml"));
    let before = std::fs::read(&vehicle).unwrap();
    let message = fail(
        sidehill()
            .args(["identify", "--level", "nowhere.csv", "--vehicle"])
            .arg(&vehicle)
            .arg("--out")
            .arg(&vehicle),
    );
    assert_says(&message, &["vehicle.yaml", "exists already", "--force"]);
    assert_eq!(std::fs::read(&vehicle).unwrap(), before);
    // Found before any work is done.
    let message = fail(
        sidehill()
            .args(["identify", "--level", "nowhere.csv", "--vehicle"])
            .arg(&vehicle)
            .args(["--out", "/proc/out.yaml"]),
    );
    assert_says(&message, &["/proc/out.yaml", "cannot be written"]);
    let folder = course.path("out");
    succeed(course.simulate().arg("--out").arg(&folder));
    let report = std::fs::read(folder.join("report.html")).unwrap();
    assert_says(
        &fail(course.simulate().arg("--out").arg(&folder)),
        &["report.html", "exists already"],
    );
    assert_eq!(std::fs::read(folder.join("report.html")).unwrap(), report);
    succeed(course.simulate().arg("--out").arg(&folder).arg("--force"));
}

#[test]
fn output_that_nobody_reads_does_not_end_the_work() {
    let course = Course::new("");
    let folder = course.path("out");
    let mut child = course
        .simulate()
        .arg("--out")
        .arg(&folder)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    drop(child.stdout.take());
    drop(child.stderr.take());
    assert!(child.wait().unwrap().success());
    assert!(folder.join("report.html").exists());
}

#[test]
fn init_writes_sets_that_are_valid_and_drive() {
    for robot in [
        "husky",
        "jackal",
        "warthog",
        "scout",
        "scout-mini",
        "bunker",
        "panther",
        "j8",
        "tracks",
    ] {
        let folder = tempfile::tempdir().unwrap();
        let set = folder.path().join(robot);
        let said = succeed(sidehill().args(["init", "--vehicle", robot]).arg(&set));
        assert_says(
            &said,
            &[
                "scenario.yaml: scenario",
                "run.yaml: configuration of run",
                "README.md",
            ],
        );
        let drive = succeed(
            sidehill()
                .arg("simulate")
                .arg(set.join("scenario.yaml"))
                .args(["--controller", "icrik-mpc", "--format", "json"]),
        );
        let figures: serde_json::Value = serde_json::from_str(&drive).unwrap();
        let rms_m = figures["runs"][0]["cross_track_rms_m"].as_f64().unwrap();
        assert!(rms_m < 0.02, "{robot}: {rms_m} m");
        // A second time nothing is overwritten.
        let message = fail(sidehill().args(["init", "--vehicle", robot]).arg(&set));
        assert_says(&message, &["exists already", "--force"]);
    }
    let folder = tempfile::tempdir().unwrap();
    let said = succeed(
        sidehill()
            .args(["init", "--vehicle", "j8", "--port", "can"])
            .arg(folder.path().join("j8")),
    );
    assert_says(&said, &["can.yaml: layout of a CAN bus"]);
}

#[test]
fn init_writes_a_set_for_any_robot_from_its_measures() {
    const TINY: &str = "--length 0.25 --width 0.3 --wheel-radius 0.05 --mass 4 --speed 0.3";
    const FARM: &str =
        "--length 1.8 --width 1.4 --wheel-radius 0.35 --mass 900 --speed 1.5 --name farm-2";
    let folder = tempfile::tempdir().unwrap();
    let init = |measures: &str, set: &str| {
        let mut init = sidehill();
        init.arg("init").args(measures.split(' '));
        init.arg(folder.path().join(set));
        init
    };
    for (measures, port, name, mass) in [
        (TINY, "ros2", "rover", "4.0"),
        (FARM, "can", "farm-2", "900.0"),
    ] {
        let said = succeed(init(measures, name).args(["--port", port]));
        assert_says(&said, &["run.yaml: configuration of run"]);
        let text =
            |file: &str| std::fs::read_to_string(folder.path().join(name).join(file)).unwrap();
        assert_says(&text("vehicle.yaml"), &[&format!("name: {name}\n")]);
        assert_says(&text("contact.yaml"), &[&format!("mass_kg: {mass}\n")]);
        // Limits of a path follow from the vehicle.
        assert!(!text("run.yaml").contains("max_curvature_per_m"));
        let scenario = folder.path().join(name).join("scenario.yaml");
        let drive = succeed(sidehill().arg("simulate").arg(scenario).args([
            "--controller",
            "icrik-mpc",
            "--format",
            "json",
        ]));
        let figures: serde_json::Value = serde_json::from_str(&drive).unwrap();
        let run = &figures["runs"][0];
        assert!(run["cross_track_rms_m"].as_f64().unwrap() < 0.02, "{run}");
        let limit_m_s = if name == "rover" { 0.3 } else { 1.5 };
        assert!(run["tread_speed_max_m_s"].as_f64().unwrap() < 1.01 * limit_m_s);
    }
    for (measures, says) in [
        ("--length 1", "--wheel-radius"),
        (&format!("--vehicle jackal {TINY}"), "--vehicle"),
        (
            &TINY.replace("--mass 4", "--mass 4e6"),
            "--mass: 4000000 is out of range",
        ),
        (
            &TINY.replace("--width 0.3", "--width nan"),
            "--width: NaN is out of range",
        ),
        (&format!("{TINY} --name a:b"), "--name"),
    ] {
        let message = fail(&mut init(measures, "none"));
        assert_says(&message, &[says]);
    }
    assert!(!folder.path().join("none").exists());
}

#[test]
fn what_simulate_writes_is_a_log() {
    let course = Course::new("");
    let folder = course.path("out");
    succeed(course.simulate().arg("--out").arg(&folder));
    let log = folder.join("icrik-mpc.csv");
    let valid = succeed(sidehill().arg("check").arg(&log));
    assert_says(&valid, &["valid log"]);
    let figures = succeed(
        sidehill()
            .arg("odometry")
            .arg(&log)
            .arg("--vehicle")
            .arg(repository("config/vehicles/j8.yaml"))
            .args(["--format", "json"]),
    );
    let figures: serde_json::Value = serde_json::from_str(&figures).unwrap();
    // 2 m on a slope of 8 degrees: the model that drove finds the slide, the flat one does not.
    let error = |model: &str, key: &str| figures[model][key].as_f64().unwrap();
    assert!(error("icrik", "j_over_n") < 1e-3, "{figures}");
    assert!(
        error("icrik", "mse_x") < 0.05 * error("icrhk", "mse_x"),
        "{figures}"
    );
}

#[test]
fn poses_may_come_in_some_rows_only() {
    let course = Course::new("");
    let mut rows: Vec<String> = log().lines().map(str::to_owned).collect();
    for (index, row) in rows.iter_mut().enumerate().skip(1) {
        if index % 5 != 0 {
            let cells: Vec<&str> = row.split(',').take(5).collect();
            *row = format!("{},,,,", cells.join(","));
        }
    }
    let file = course.write("sparse.csv", &(rows.join("\n") + "\n"));
    assert_says(&succeed(sidehill().arg("check").arg(&file)), &["valid log"]);
    let said = succeed(
        sidehill()
            .args(["identify", "--segment-s", "2", "--level"])
            .arg(&file)
            .arg("--vehicle")
            .arg(repository("config/vehicles/j8.yaml"))
            .arg("--out")
            .arg(course.path("identified.yaml")),
    );
    assert_says(&said, &["level:", "verdict:"]);
}
