//! `sidehill report`: figures, limits, page and track of a recorded drive.

use crate::{Course, assert_says, fail, sidehill, stdout, succeed};
use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Records the course with one controller.
fn record(course: &Course) -> PathBuf {
    let file = course.path("drive.mcap");
    let mut command = course.simulate();
    command.args(["--controller", "icrik-mpc", "--seed", "3", "--record"]);
    succeed(command.arg(&file));
    file
}

fn report(file: &Path, arguments: &[&str]) -> Command {
    let mut command = sidehill();
    command.arg("report").arg(file).args(arguments);
    command
}

fn json(command: &mut Command) -> (Value, Option<i32>) {
    let output = command.args(["--format", "json"]).output().unwrap();
    let text = stdout(&output);
    let value = serde_json::from_str(&text).unwrap_or_else(|e| panic!("{e}: {text}"));
    (value, output.status.code())
}

#[test]
fn a_drive_is_judged_by_limits() {
    let course = Course::new("");
    let file = record(&course);
    let (facts, code) = json(&mut report(&file, &[]));
    assert_eq!((code, &facts["passed"]), (Some(0), &Value::Null), "{facts}");
    // The course is 2 m long and driven to its end.
    let along_m = facts["driven"]["along_path_m"].as_f64().unwrap();
    assert!((1.8..2.1).contains(&along_m), "{facts}");
    assert_eq!(facts["stops"][0]["kind"], "arrived", "{facts}");
    let most_m = facts["cross_track"]["max_m"].as_f64().unwrap();
    assert_eq!(
        facts["worst"][0]["cross_track_m"].as_f64().unwrap().abs(),
        most_m
    );
    let pose = &facts["sensors"][0];
    assert_eq!(pose["name"], "pose");
    assert!(pose["rate_hz"].as_f64().unwrap() > 1.0, "{pose}");

    // A limit at the figure itself is kept, one below is not.
    let limit = |limit_m: f64| {
        json(&mut report(
            &file,
            &["--max-cross-track-m", &limit_m.to_string()],
        ))
    };
    let (facts, code) = limit(most_m);
    assert_eq!(
        (code, &facts["passed"]),
        (Some(0), &Value::Bool(true)),
        "{facts}"
    );
    let (facts, code) = limit(0.99 * most_m);
    assert_eq!(
        (code, &facts["passed"]),
        (Some(1), &Value::Bool(false)),
        "{facts}"
    );
    assert_eq!(facts["limits"][0]["found"].as_f64(), Some(most_m));
    // What the recording does not tell has not passed.
    let (facts, code) = json(&mut report(&file, &["--min-tip-over-margin", "0.1"]));
    assert_eq!(
        (code, &facts["limits"][0]["found"]),
        (Some(1), &Value::Null),
        "{facts}"
    );
}

#[test]
fn a_page_holds_the_figures_and_needs_no_network() {
    let course = Course::new("");
    let file = record(&course);
    let page = course.path("drive.html");
    let (facts, _) = json(report(&file, &["--out"]).arg(&page));
    let text = std::fs::read_to_string(&page).unwrap();
    let begin = text
        .split_once("<script id=\"facts\" type=\"application/json\">")
        .unwrap()
        .1;
    let held: Value = serde_json::from_str(begin.split_once("</script>").unwrap().0).unwrap();
    assert_eq!(held, facts);
    for bad in ["src=\"", "href=\"http", "@import", "fetch("] {
        assert!(!text.contains(bad), "{bad}");
    }
    assert_says(
        &fail(report(&file, &["--out"]).arg(&page)),
        &["drive.html: exists already", "--force"],
    );
    assert_says(
        &fail(report(&course.path("no.mcap"), &[]).arg("--force")),
        &["no.mcap"],
    );
}

#[test]
fn what_was_driven_is_put_on_earth_where_it_has_a_place() {
    let course = Course::new("");
    let file = record(&course);
    let geojson = course.path("drive.geojson");
    let message = fail(report(&file, &["--geojson"]).arg(&geojson));
    assert_says(&message, &["drive.mcap", "datum"]);
    assert!(!geojson.exists());
    let map = |file: &Path| {
        let mut command = report(file, &["--map", "no/field.mbtiles", "--out"]);
        fail(command.arg(course.path("drive.html")))
    };
    assert_says(&map(&file), &["drive.mcap", "datum"]);

    let placed = Course::new("datum: {latitude_deg: 36.717, longitude_deg: -4.489}\n");
    let file = record(&placed);
    assert_says(&map(&file), &["no/field.mbtiles", "No such file"]);
    let [geojson, kml] = ["drive.geojson", "drive.kml"].map(|name| placed.path(name));
    let mut command = report(&file, &["--geojson"]);
    let (facts, _) = json(command.arg(&geojson).arg("--kml").arg(&kml));
    let track: Value = serde_json::from_str(&std::fs::read_to_string(&geojson).unwrap()).unwrap();
    let line = track["features"][0]["geometry"]["coordinates"][0]
        .as_array()
        .unwrap();
    let metres = |from: &Value, to: &Value| {
        let degrees = |axis: usize| to[axis].as_f64().unwrap() - from[axis].as_f64().unwrap();
        f64::hypot(
            111_320.0 * 36.717_f64.to_radians().cos() * degrees(0),
            111_000.0 * degrees(1),
        )
    };
    let length_m: f64 = line.windows(2).map(|pair| metres(&pair[0], &pair[1])).sum();
    let along_m = facts["driven"]["along_path_m"].as_f64().unwrap();
    assert!(
        (length_m / along_m - 1.0).abs() < 0.1,
        "{length_m} m, {along_m} m"
    );
    let places = track["features"].as_array().unwrap();
    let stop = places
        .iter()
        .find(|place| place["properties"]["kind"] == "stop")
        .unwrap();
    assert_eq!(
        stop["geometry"]["coordinates"][1],
        facts["stops"][0]["latitude_deg"]
    );
    let text = std::fs::read_to_string(&kml).unwrap();
    let document = roxmltree::Document::parse(&text).unwrap();
    let marks = document
        .descendants()
        .filter(|node| node.has_tag_name(("http://www.opengis.net/kml/2.2", "Placemark")));
    assert_eq!(marks.count(), places.len());
}
