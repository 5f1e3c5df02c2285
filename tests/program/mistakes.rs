//! Mistakes beyond those of `stranger.rs`, each with a message that names file, place, cause and remedy.

use crate::{Course, assert_says, fail, repository, sidehill, stderr, text};
use std::path::PathBuf;

/// Returns the error of `check` for a file with these bytes.
fn complaint(name: &str, bytes: &[u8]) -> String {
    let course = Course::new("");
    let file = course.path(name);
    std::fs::write(&file, bytes).unwrap();
    fail(sidehill().arg("check").arg(file))
}

const HEADER: &str = "time_s,v_left_m_s,v_right_m_s,roll_rad,pitch_rad,x_m,y_m,z_m,yaw_rad";

/// A log of 5 s straight ahead.
fn log() -> String {
    let rows = (0..100).map(|i| {
        let time_s = 0.05 * f64::from(i);
        format!("{time_s:.2},0.6,0.6,0.03,0.02,0,{:.3},0,0\n", 0.6 * time_s)
    });
    format!("{HEADER}\n{}", rows.collect::<String>())
}

/// Returns a text as Windows programs save it as "Unicode".
fn utf_16(text: &str) -> Vec<u8> {
    let units = std::iter::once(0xFEFF).chain(text.encode_utf16());
    units.flat_map(u16::to_le_bytes).collect()
}

#[test]
fn files_of_another_format_are_recognised() {
    for (name, bytes, says) in [
        ("u16.csv", utf_16(&log()), "is UTF-16"),
        ("u16.yaml", utf_16("name: a\n"), "save it as UTF-8"),
        (
            "packed.csv",
            vec![0x1F, 0x8B, 8, 0, 0],
            "is compressed by gzip; unpack it",
        ),
        ("sheet.csv", b"PK\x03\x04rest".to_vec(), "a spreadsheet"),
        (
            "empty.csv",
            Vec::new(),
            "is empty: the first line must name the columns",
        ),
        (
            "semicolons.csv",
            log().replace(',', ";").into_bytes(),
            "separated by semicolons or tabs; separate them by commas",
        ),
        (
            "semicolons_path.csv",
            b"x_m;y_m\n0;0\n1;0\n".to_vec(),
            "separate fields by commas",
        ),
        (
            "numbers.csv",
            b"0.0,0.0\n1.0,0.0\n".to_vec(),
            "the first line must name the columns",
        ),
        (
            "degrees.csv",
            b"lat,lon\n45.1,7.6\n45.2,7.6\n".to_vec(),
            "give latitude and longitude as GPX",
        ),
        (
            "receiver.csv",
            b"$GNGGA,1,4500.0,N,00700.0,E,4,12,0.8,210.0,M,48.0,M,1.0,0000*5E\r\n".to_vec(),
            "is NMEA; `gpsbabel -i nmea",
        ),
        (
            "track.gpx",
            b"<?xml version=\"1.0\"?>\n<kml><Document/></kml>".to_vec(),
            "is KML; `gpsbabel -i kml",
        ),
        (
            "umlaut.yaml",
            b"name: a\nslope_deg: 5 # 5\xB0\n".to_vec(),
            "line 2: is not UTF-8 text; save it as UTF-8",
        ),
        (
            "umlaut.csv",
            [log().as_bytes(), b"5,0.6,0.6,0.03,0.02,0,\xFC,0,0\n"].concat(),
            "line 102: is not UTF-8 text; save it as UTF-8",
        ),
        (
            "echo.csv",
            b"1700000000,0,odom,base_link,0.0,0.0,0.0\n".to_vec(),
            "the first line must name the columns",
        ),
        (
            "excel.csv",
            format!("sep=,\r\n{}", log()).into_bytes(),
            "remove this line, which is one for spreadsheets",
        ),
        (
            "excel_path.csv",
            b"sep=;\nx_m;y_m\n0;0\n1;0\n".to_vec(),
            "remove this line",
        ),
        (
            "prose.yaml",
            "to be written ".repeat(9000).into_bytes(),
            "has no keys",
        ),
        (
            "to_do.yaml",
            b"# to be written\n".to_vec(),
            "`sidehill init` writes files",
        ),
        (
            "declared.gpx",
            b"<?xml version=\"1.0\"?>\n<!DOCTYPE gpx>\n<gpx/>".to_vec(),
            "remove its line <!DOCTYPE",
        ),
        (
            "waypoints.gpx",
            b"<gpx version=\"1.1\"><wpt lat=\"45\" lon=\"7\"/></gpx>".to_vec(),
            "waypoints are no path",
        ),
    ] {
        let message = complaint(name, &bytes);
        assert_says(&message, &[name, says]);
        assert!(message.len() < 1000, "{message}");
    }
    let folder = repository("config/vehicles");
    let message = fail(sidehill().arg("simulate").arg(&folder));
    assert_says(&message, &["config/vehicles", "is a folder", "*.yaml"]);
}

#[test]
fn mistakes_in_logs_name_the_likely_unit() {
    let nanoseconds: String = log()
        .lines()
        .skip(1)
        .enumerate()
        .map(|(i, line)| {
            let (_, rest) = line.split_once(',').unwrap();
            format!(
                "{},{rest}\n",
                1_700_000_000_000_000_000_i64 + 50_000_000 * i as i64
            )
        })
        .collect();
    for (name, text, says) in [
        (
            "nan.csv",
            log().replacen("0.02,", "nan,", 1),
            &["row 1", "pitch_rad", "leave out rows without a value"][..],
        ),
        (
            "nanoseconds.csv",
            format!("{HEADER}\n{nanoseconds}"),
            &["row 1", "time_s", "nanoseconds"],
        ),
        (
            "backwards.csv",
            log().replacen("\n0.50,", "\n0.10,", 1),
            &["row 11", "time 0.1 s goes back from 0.45 s"],
        ),
        (
            "comma.csv",
            log().replacen("0.02,", "\"0,02\",", 1),
            &[
                "row 1",
                "pitch_rad",
                "\"0,02\"",
                "decimals are written with a point",
            ],
        ),
        (
            "clock.csv",
            log().replacen("0.05,", "10:00:00.05,", 1),
            &["row 2", "time_s", "a time is a number of seconds"],
        ),
        (
            "cut.csv",
            log()[..log().len() - 12].to_owned(),
            &["line 101", "if the file was cut off there, remove the line"],
        ),
        (
            "header.csv",
            format!("{HEADER}\n"),
            &["0 rows, at least 2 are needed"],
        ),
    ] {
        assert_says(&complaint(name, text.as_bytes()), &[name]);
        assert_says(&complaint(name, text.as_bytes()), says);
    }
}

#[test]
fn a_file_of_another_kind_is_named() {
    let course = Course::new("");
    let vehicle = repository("config/vehicles/j8.yaml");
    let contact = repository("config/vehicles/j8_contact.yaml");
    let log = course.write("log.csv", &log());
    let scenario = course.path("scenario.yaml");
    let say = |arguments: &[&str], files: &[&PathBuf]| {
        let mut command = sidehill();
        let mut files = files.iter();
        for argument in arguments {
            match *argument {
                "FILE" => command.arg(files.next().unwrap()),
                argument => command.arg(argument),
            };
        }
        fail(&mut command)
    };
    for (message, says) in [
        (
            say(&["simulate", "FILE"], &[&vehicle]),
            "the file looks like a vehicle",
        ),
        (
            say(
                &["odometry", "FILE", "--vehicle", "FILE"],
                &[&log, &scenario],
            ),
            "the file looks like a scenario",
        ),
        (
            say(
                &["odometry", "FILE", "--vehicle", "FILE"],
                &[&log, &contact],
            ),
            "the file looks like a contact vehicle",
        ),
    ] {
        assert_says(&message, &[".yaml", says]);
    }
}

#[test]
fn mistakes_in_yaml_say_what_to_look_for() {
    let course = Course::new("");
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    for (from, to, says) in [
        ("seed: 1", "  seed: 1", &["line 7", "indented too far"][..]),
        ("seed: 1", "seed:1", &["line 7", "a space after the colon"]),
        (
            "shape: straight",
            "kind: straight",
            &["course", "missing field `shape`", "line 4"],
        ),
        (
            "controllers: [icrik-mpc",
            "controllers: [icrik",
            &["controllers[0]", "`icrik-mpc`", "line 5"],
        ),
        (
            "terrain: {kind: plane, slope_deg: 8, uphill_heading_deg: 60}",
            "terrain: {kind: level, slope_deg: 8}",
            &["slope_deg", "this kind has no further keys", "line 3"],
        ),
        (
            "slope_deg: 8,",
            "slope_deg: 8,5,",
            &["a number stands in place of a key", "with a point"],
        ),
        (
            "slope_deg: 8,",
            "slope_deg: \"8,5\",",
            &["`slope_deg` (line 3)", "with a point"],
        ),
        ("slope_deg: 8,", "slope_deg: 8 deg,", &["without a unit"]),
        ("seed: 1", "seed:", &["line 7", "the key has no value"]),
        ("seed: 1", "<<: {seed: 1}", &["merge keys are not read"]),
        (
            "seed: 1",
            "seed: 1\n---\nseed: 2",
            &["remove the line `---`"],
        ),
        ("seed: 1", "seed: 1\u{7}", &["line 7", "not visible"]),
    ] {
        assert!(scenario.contains(from), "{from}");
        let message = complaint("changed.yaml", scenario.replace(from, to).as_bytes());
        assert_says(&message, &["changed.yaml"]);
        assert_says(&message, says);
    }
    let ros2 = text("config/bridge/run_ros2.yaml")
        .replace("../", &format!("{}/", repository("config").display()));
    let wrong = ros2.replace("use_orientations: false", "use_orientations: off");
    assert_ne!(wrong, ros2);
    let message = complaint("run.yaml", wrong.as_bytes());
    assert_says(
        &message,
        &["use_orientations", "\"off\"", "write true or false"],
    );
    let wrong = ros2.replace("odometry: odom # nav", "odometry: my odom # nav");
    assert_ne!(wrong, ros2);
    let message = complaint("run.yaml", wrong.as_bytes());
    assert_says(&message, &["run.yaml", "ros2.inputs.odometry", "my odom"]);
}

#[test]
fn a_wrong_value_is_named_by_its_key() {
    let course = Course::new("");
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let wrong = scenario.replace("slope_deg: 8", "slope_deg: eight");
    assert_ne!(wrong, scenario);
    let message = complaint("text.yaml", wrong.as_bytes());
    assert_says(
        &message,
        &["text.yaml", "\"eight\"", "`slope_deg`", "line 3"],
    );
}

#[test]
fn nesting_and_size_have_limits() {
    for deep in ["[".repeat(300), "{a: ".repeat(300), "- ".repeat(60_000)] {
        let message = complaint("deep.yaml", format!("name: a\nx:\n  {deep}").as_bytes());
        assert_says(
            &message,
            &["deep.yaml", "line 3", "nested more than 100 deep"],
        );
    }
    let course = Course::new("");
    let path = course.path("large.gpx");
    std::fs::File::create(&path)
        .unwrap()
        .set_len(2_000_000_000)
        .unwrap();
    assert_says(
        &fail(sidehill().arg("check").arg(&path)),
        &["large.gpx", "64 MB"],
    );
    let far = course.write("far.csv", "x_m,y_m\n0,0\n0,90000\n");
    let message = fail(course.simulate().arg("--path").arg(&far));
    assert_says(&message, &["far.csv", "at most 20000 m"]);
    let slow = Course::new("speed: {speed_m_s: 0.1}\n");
    let long = slow.write("long.csv", "x_m,y_m\n0,0\n0,9000\n");
    let message = fail(slow.simulate().arg("--path").arg(&long));
    assert_says(&message, &["million cycles", "shorten the path"]);
}

#[test]
fn files_and_options_at_the_wrong_place_name_the_right_one() {
    let course = Course::new("");
    let tuned = course.write(
        "tuned.yaml",
        "name: tuned\ncontroller: {weights: {cross_per_m2: 40}}\n",
    );
    let message = fail(sidehill().arg("simulate").arg(&tuned));
    assert_says(&message, &["tuned.yaml", "--conditions"]);
    let message = fail(
        course
            .simulate()
            .arg("--conditions")
            .arg(&tuned)
            .args(["--conditions", "realistic"]),
    );
    assert_says(&message, &["--conditions", "given 2 times", "one file"]);
    let track = course.write("track.gpx", "<gpx/>");
    let out = course.path("r.csv");
    let message = fail(sidehill().arg("route").arg(&track).arg("--out").arg(&out));
    assert_says(&message, &["track.gpx", "is a path already", "--path"]);
    let run = repository("config/bridge/run_ros2.yaml");
    let out = course.path("found.yaml");
    let message = fail(sidehill().arg("tune").arg(&run).arg("--out").arg(&out));
    assert_says(
        &message,
        &["run_ros2.yaml", "looks like a configuration of run"],
    );
}

#[test]
fn what_identification_lacks_is_said() {
    let course = Course::new("");
    let identify = |text: &str, out: &str| {
        let file = course.write("log.csv", text);
        fail(
            sidehill()
                .args(["identify", "--level"])
                .arg(file)
                .arg("--vehicle")
                .arg(repository("config/vehicles/j8.yaml"))
                .arg("--out")
                .arg(course.path(out)),
        )
    };
    let without_poses: String = log()
        .lines()
        .map(|line| line.split(',').take(5).collect::<Vec<_>>().join(",") + "\n")
        .collect();
    assert_says(
        &identify(&without_poses, "out.yaml"),
        &["log.csv", "the log has no poses", "yaw_rad"],
    );
    assert_says(
        &identify(&log(), "out.yaml"),
        &["at least 10 are needed", "log longer"],
    );
    assert_says(
        &identify(&log(), "lost/out.yaml"),
        &[
            "out.yaml: cannot be written",
            "there is no folder",
            "make it first",
        ],
    );
}

#[test]
fn a_path_in_degrees_is_warned_of() {
    let course = Course::new("");
    let file = course.write(
        "path.csv",
        "x_m,y_m\n45.10001,7.60001\n45.10002,7.60002\n45.10003,7.60002\n",
    );
    let output = sidehill().arg("check").arg(file).output().unwrap();
    assert_says(&stderr(&output), &["path.csv", "warning", "degrees", "GPX"]);
}

#[test]
fn output_that_cannot_be_written_is_an_error() {
    let full = || {
        std::fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap()
    };
    let csv = repository("plant/tests/data/trento_ramps/vehicle.yaml");
    for format in ["table", "json"] {
        let course = Course::new("");
        let mut command = course.simulate();
        let output = command
            .args(["--controller", "pure-pursuit", "--format", format])
            .stdout(full())
            .output()
            .unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert_says(&stderr(&output), &["standard output", "No space left"]);
    }
    let output = sidehill()
        .arg("check")
        .arg(csv)
        .stdout(full())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
}
