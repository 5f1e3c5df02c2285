//! `sidehill simulate --path`: routes from CSV and GPX, good and bad.

use crate::{Course, assert_says, fail, succeed};

#[test]
fn a_csv_path_replaces_the_course() {
    let course = Course::new("");
    let path = course.write("line.csv", "x_m,y_m\n0,0\n0.5,1\n1,2\n");
    let table = succeed(course.simulate().arg("--path").arg(&path));
    assert_says(&table, &["line.csv: 3 points, path of 2.2 m"]);
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
