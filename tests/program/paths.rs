//! `sidehill simulate --path`: routes from CSV and GPX, good and bad.

use crate::{Course, assert_says, fail, sidehill, stderr, stdout, succeed};

#[test]
fn a_csv_path_replaces_the_course() {
    let course = Course::new("");
    let path = course.write("line.csv", "x_m,y_m\n0,0\n0.5,1\n1,2\n");
    let table = succeed(course.simulate().arg("--path").arg(&path));
    assert_says(&table, &["line.csv: 3 points, path of 2.2 m"]);
}

/// A straight route of 12 m with a slow stretch from 4 m to 8 m and two actions.
const SLOW_STRETCH: &str = "x_m,y_m,speed_m_s,action\n0,0,,start\n0,4,0.2,\n0,8,5,probe\n0,12,,\n";

#[test]
fn every_controller_keeps_the_speed_of_a_stretch() {
    let course = Course::new("");
    let path = course.write("slow.csv", SLOW_STRETCH);
    succeed(sidehill().arg("check").arg(&path));
    let out = course.path("out");
    let table = succeed(
        course
            .simulate()
            .args(["--controller", "contact-mpc", "--controller", "icrik-mpc"])
            .args(["--controller", "pure-pursuit", "--path"])
            .arg(&path)
            .arg("--out")
            .arg(&out),
    );
    assert_says(&table, &["its slowest stretch at up to 0.2 m/s, 2 actions"]);
    for name in ["contact-mpc", "icrik-mpc", "pure-pursuit"] {
        let mut rows = csv::Reader::from_path(out.join(format!("{name}.csv"))).unwrap();
        let header = rows.headers().unwrap().clone();
        let column = |name: &str| header.iter().position(|column| column == name).unwrap();
        let (y, traction) = (column("y_m"), column("motor_traction_m_s"));
        let (mut slow_m_s, mut fast_m_s) = (0.0f64, 0.0f64);
        for row in rows.records().map(Result::unwrap) {
            let value = |column: usize| row[column].parse::<f64>().unwrap();
            match value(y) {
                4.0..8.0 => slow_m_s = slow_m_s.max(value(traction)),
                9.0.. => fast_m_s = fast_m_s.max(value(traction)),
                _ => {}
            }
        }
        assert!((0.19..0.21).contains(&slow_m_s), "{name}: {slow_m_s}");
        assert!(fast_m_s > 0.7, "{name}: {fast_m_s}");
    }
}

#[test]
fn a_gpx_path_is_driven_in_metres_on_its_own_elevation() {
    let course = Course::new("");
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let plane = "terrain: {kind: plane, slope_deg: 8, uphill_heading_deg: 60}";
    let route = "terrain: {kind: route, smoothing_length_m: 2, distance_max_m: 4}";
    course.write("scenario.yaml", &scenario.replace(plane, route));
    // 1e-5 degrees of latitude are 1.11 m.
    let places = [0, 1, 2, 3].map(|i| {
        let elevation = 40.0 + 0.1 * f64::from(i);
        format!(
            "<trkpt lat=\"36.{}\" lon=\"-4.5\"><ele>{elevation}</ele></trkpt>\n",
            70_000 + i
        )
    });
    let gpx = format!(
        "<gpx version=\"1.1\"><trk><trkseg>\n{}</trkseg></trk></gpx>",
        places.concat()
    );
    let path = course.write("hill.gpx", &gpx);
    let table = succeed(course.simulate().arg("--path").arg(&path));
    assert_says(&table, &["hill.gpx: 4 points, path of 3.3 m"]);
}

#[test]
fn a_bad_path_is_named_with_its_line_and_value() {
    let course = Course::new("");
    for (name, text, says) in [
        (
            "number.csv",
            "x_m,y_m\n0,0\n1,north\n",
            &["line 3", "y_m", "north"][..],
        ),
        (
            "nan.csv",
            "x_m,y_m\n0,0\nNaN,1\n",
            &["line 3", "x_m", "NaN"],
        ),
        ("column.csv", "x_m,z_m\n0,0\n", &["line 1", "y_m"]),
        (
            "stands.csv",
            "x_m,y_m,speed_m_s\n0,0,0.5\n1,0,0\n",
            &[
                "line 3",
                "speed_m_s: `0` would let the vehicle stand",
                "leave it empty",
            ],
        ),
        ("short.csv", "x_m,y_m\n0,0\n1\n", &["line 3"]),
        ("none.csv", "x_m,y_m\n", &["no points"]),
        ("still.csv", "x_m,y_m\n1,1\n1,1\n", &["no length"]),
        (
            "open.gpx",
            "<gpx><trk>\n<trkseg>\n</trk></gpx>",
            &["line 3"],
        ),
        (
            "latitude.gpx",
            "<gpx><trk><trkseg>\n<trkpt lat=\"36.7\" lon=\"-4.5\"/>\n<trkpt lat=\"367\" lon=\"-4.5\"/>\n</trkseg></trk></gpx>",
            &["line 3", "lat", "367"],
        ),
        ("path.txt", "0 0\n1 1\n", &[".csv or .gpx"]),
    ] {
        let path = course.write(name, text);
        let message = fail(course.simulate().arg("--path").arg(&path));
        assert_says(&message, &[name]);
        assert_says(&message, says);
    }
}

/// A straight GPX track to the north with these elevations, 1.1 m from point to point.
fn track(elevations: &[f64]) -> String {
    let points: String = elevations
        .iter()
        .enumerate()
        .map(|(i, elevation)| {
            format!(
                "<trkpt lat=\"48.{:05}\" lon=\"11.6\"><ele>{elevation}</ele></trkpt>\n",
                i + 100
            )
        })
        .collect();
    format!(
        "<gpx version=\"1.1\"><trk><name>H\u{fc}gel \u{2013} Nord</name><trkseg>\n{points}</trkseg></trk></gpx>\n"
    )
}

#[test]
fn a_gpx_is_read_in_the_encoding_that_it_declares() {
    let course = Course::new("");
    let encoded = |name: &str, label: &str, encode: fn(char) -> Vec<u8>| {
        let text = format!(
            "<?xml version='1.0' encoding='{label}'?>\n{}",
            track(&[500.0; 6])
        );
        let path = course.path(name);
        std::fs::write(&path, text.chars().flat_map(encode).collect::<Vec<u8>>()).unwrap();
        path
    };
    let windows = |c: char| vec![if c == '\u{2013}' { 0x96 } else { c as u8 }];
    for (name, label) in [("w.gpx", "windows-1252"), ("l.gpx", "ISO-8859-1")] {
        let path = encoded(name, label, windows);
        assert_says(
            &succeed(sidehill().arg("check").arg(path)),
            &["valid route"],
        );
    }
    // Saved as Windows does it, but declared, or by default, as UTF-8.
    let message = fail(
        sidehill()
            .arg("check")
            .arg(encoded("u.gpx", "UTF-8", windows)),
    );
    assert_says(&message, &["u.gpx", "line 2", "UTF-8", "windows-1252"]);
    let message = fail(
        sidehill()
            .arg("check")
            .arg(encoded("x.gpx", "klingon", windows)),
    );
    assert_says(&message, &["x.gpx", "line 1", "klingon"]);
}

#[test]
fn the_origin_of_a_gpx_is_said_and_a_datum_sets_it() {
    let course = Course::new("");
    let path = course.write("hill.gpx", &track(&[500.0; 12]));
    let table = succeed(course.simulate().arg("--path").arg(&path));
    let datum =
        "datum: {latitude_deg: 48.001000000, longitude_deg: 11.600000000, altitude_m: 500.000}";
    assert_says(&table, &["its first point", datum]);
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    course.write("scenario.yaml", &format!("{scenario}{datum}\n"));
    let last = |text: &str| {
        let path = course.write("part.gpx", text);
        let out = course.path("out");
        let mut command = course.simulate();
        let table = succeed(
            command
                .arg("--path")
                .arg(&path)
                .arg("--force")
                .arg("--out")
                .arg(&out),
        );
        assert!(!table.contains("its first point"), "{table}");
        let csv = std::fs::read_dir(&out)
            .unwrap()
            .map(|entry| entry.unwrap().path());
        let csv = csv
            .into_iter()
            .find(|path| path.extension().is_some_and(|e| e == "csv"))
            .unwrap();
        let text = std::fs::read_to_string(csv).unwrap();
        let row = text.lines().last().unwrap();
        let values: Vec<f64> = row
            .split(',')
            .take(3)
            .map(|value| value.parse().unwrap())
            .collect();
        (values[1], values[2])
    };
    let whole = track(&[500.0; 12]);
    let trimmed: String = whole
        .lines()
        .enumerate()
        .filter(|(i, _)| !(1..4).contains(i))
        .map(|(_, line)| format!("{line}\n"))
        .collect();
    let (whole, trimmed) = (last(&whole), last(&trimmed));
    let off_m = (whole.0 - trimmed.0).hypot(whole.1 - trimmed.1);
    assert!(off_m < 0.05, "{whole:?} {trimmed:?}");
}

#[test]
fn an_elevation_that_jumps_is_found_by_check() {
    let course = Course::new("");
    let mut elevations = [420.0; 20];
    elevations[9] = 0.0;
    let path = course.write("outlier.gpx", &track(&elevations));
    let message = fail(sidehill().arg("check").arg(&path));
    assert_says(&message, &["outlier.gpx", "-420.0 m", "points 8 and 9"]);
}

#[test]
fn turning_back_is_said() {
    let course = Course::new("");
    let path = course.write("v.csv", "x_m,y_m\n0,0\n0,6\n3,1\n");
    let output = sidehill().arg("check").arg(&path).output().unwrap();
    assert_says(&stdout(&output), &["valid route"]);
    assert_says(&stderr(&output), &["v.csv", "y = 6.00 m", "in reverse"]);
    let marked = course.write(
        "m.csv",
        "x_m,y_m,direction\n0,0,forward\n0,6,reverse\n3,1,\n",
    );
    assert_eq!(
        stderr(&sidehill().arg("check").arg(&marked).output().unwrap()),
        ""
    );
}

#[test]
fn a_grid_with_a_spike_is_doubted_and_one_under_the_path_refused() {
    let course = Course::new("");
    let grid = |spike: Option<usize>| {
        let header =
            "ncols 21\nnrows 21\nxllcenter -10\nyllcenter -10\ndx 1\ndy 1\nNODATA_value nan\n";
        let cells = (0..441).map(|i| if Some(i) == spike { "90 " } else { "20 " });
        format!("{header}{}", cells.collect::<String>())
    };
    // Row 8 from the north is y = 3, column 11 is x = 0.
    let file = course.write("dem.asc", &grid(Some(7 * 21 + 10)));
    let output = sidehill().arg("check").arg(&file).output().unwrap();
    assert_says(
        &stderr(&output),
        &["dem.asc", "row 8, column 11", "70.0 m above"],
    );
    let scenario = std::fs::read_to_string(course.path("scenario.yaml")).unwrap();
    let plane = "terrain: {kind: plane, slope_deg: 8, uphill_heading_deg: 60}";
    assert!(scenario.contains(plane));
    course.write(
        "scenario.yaml",
        &scenario.replace(plane, "terrain: {kind: grid, file: dem.asc}"),
    );
    let path = course.write("line.csv", "x_m,y_m\n0,0\n0,6\n");
    let message = fail(course.simulate().arg("--path").arg(&path));
    assert_says(&message, &["terrain", "deg steep", "column 11"]);
    course.write("dem.asc", &grid(None));
    succeed(course.simulate().arg("--path").arg(&path));
}
