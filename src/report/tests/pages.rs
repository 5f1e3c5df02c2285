//! The HTML page.

use super::*;

#[test]
fn the_page_has_every_controller_and_section() {
    let runs = [run("icrik-mpc", rows(1200)), run("pure-pursuit", rows(900))];
    let page = page(&plane(), &runs);
    let document = checked(&page);
    let headings: Vec<_> = document
        .descendants()
        .filter(|node| node.tag_name().name() == "h2")
        .filter_map(|node| node.text())
        .collect();
    let sections = [
        "Cross-track error",
        "Cross-track error by size",
        "Commands",
        "Attitude",
        "Tread ICRs",
        "Solve time",
    ];
    assert_eq!(headings, sections);
    assert_eq!(named(&document, "canvas").len(), 1, "map");
    let plots = named(&document, "div")
        .into_iter()
        .filter(|node| node.attribute("class") == Some("plot"));
    // With what differs of error and commands, and what is in the order of its size.
    assert_eq!(plots.count(), 2 + 1 + 4 + 2 + 3 + 1);
    let text = text(&document);
    for part in [
        "icrik-mpc",
        "pure-pursuit",
        "1.2",
        "Steer variation",
        "limit 1 m/s",
    ] {
        assert!(text.contains(part), "{part} is missing");
    }
    let map = map(&page);
    let names: Vec<_> = map["runs"]
        .as_array()
        .unwrap()
        .iter()
        .map(|run| run["name"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["icrik-mpc", "pure-pursuit"]);
    let ground = &map["ground"];
    let heights: [f64; 4] = serde_json::from_value(ground["heights"].clone()).unwrap();
    let side_m = ground["size"][0].as_f64().unwrap();
    let [along_x, along_y] = [1, 2].map(|node| (heights[node] - heights[0]) / side_m);
    assert!((along_x.hypot(along_y) - 10_f64.to_radians().tan()).abs() < 1e-4);
    // A frame is time, place, heading and downhill; its heading is counter-clockwise from x.
    let frame: [f64; 6] = serde_json::from_value(map["runs"][0]["frames"][0].clone()).unwrap();
    assert_eq!(frame[..4], [0.0, 3.0, 0.0, 1.571]);
    assert!((frame[4].hypot(frame[5]) - 10_f64.to_radians().sin()).abs() < 2e-3);
}

#[test]
fn names_are_escaped() {
    let name = "<b onload=\"x\">&'";
    let mut run = run(name, rows(50));
    run.summary.completed = false;
    run.summary.ended_by = Some("speed < 0 & more".to_owned());
    let page = page(&plane(), &[run]);
    let text = text(&checked(&page));
    assert!(text.contains(name) && text.contains("speed < 0 & more"));
    assert!(page.contains("A circle &amp; more") && page.contains("on &lt;a&gt; slope"));
}

#[test]
fn nothing_to_show_is_shown() {
    let text_of = |runs: &[Run]| text(&checked(&page(&plane(), runs)));
    assert!(text_of(&[]).contains("no run"));
    assert!(text_of(&[run("icrik-mpc", Vec::new())]).contains("No run solved a QP"));
    assert!(text_of(&[run("icrik-mpc", rows(1))]).contains("icrik-mpc"));
}

/// Returns the values of the first run in the plot of the cross-track error.
fn cross_track(document: &Document<'_>) -> Vec<Option<f64>> {
    let plots = named(document, "div");
    let plot = plots
        .iter()
        .find(|node| {
            node.attribute("aria-label")
                .is_some_and(|label| label.starts_with("cross-track (cm)"))
        })
        .unwrap();
    let data = plot.descendants().find_map(|node| node.text()).unwrap();
    let data: serde_json::Value = serde_json::from_str(data).unwrap();
    assert_eq!(data["lines"][0]["run"], 0);
    serde_json::from_value(data["lines"][0]["y"].clone()).unwrap()
}

#[test]
fn values_that_are_not_finite_leave_gaps() {
    let mut run = run("icrik-mpc", rows(300));
    for row in &mut run.rows[100..200] {
        row.cross_track_m = f64::NAN;
        row.pose.x_m = f64::INFINITY;
        row.solve_us = f64::NAN;
        row.attitude.roll_rad = f64::NEG_INFINITY;
    }
    run.summary.cross_track_rms_m = f64::NAN;
    run.summary.cross_track_max_m = f64::NAN;
    let page = page(&plane(), &[run]);
    let document = checked(&page);
    let values = cross_track(&document);
    let gaps: Vec<usize> = (0..values.len()).filter(|i| values[*i].is_none()).collect();
    assert_eq!(gaps, (100..200).collect::<Vec<_>>());
}

#[test]
fn ground_known_along_a_route_only_is_shown_there() {
    let point = |i: u32| RoutePoint {
        x_m: 3.0,
        y_m: f64::from(i) - 3.0,
        z_m: 0.2 * f64::from(i),
    };
    let points: Vec<_> = (0..7).map(point).collect();
    let smoothing = RouteSmoothing::new(2.0, 1.0).unwrap();
    let terrain = Terrain::Route(RouteTerrain::new(&points, smoothing).unwrap());
    let page = page(&terrain, &[run("icrik-mpc", rows(100))]);
    let grid = &map(&page)["ground"];
    let [corner, _]: [f64; 2] = serde_json::from_value(grid["corner"].clone()).unwrap();
    let side = grid["size"][0].as_f64().unwrap();
    let heights = grid["heights"].as_array().unwrap();
    let nodes = grid["nodes"][0].as_u64().unwrap() as usize;
    let known = (0..heights.len()).filter(|node| heights[*node].is_number());
    let known: Vec<f64> = known
        .map(|node| corner + side * (node % nodes) as f64 / (nodes - 1) as f64)
        .collect();
    // The corridor is 2 m wide.
    assert!(known.len() > 100);
    assert!(known.iter().all(|x_m| (1.9..=4.1).contains(x_m)));
}

#[test]
fn long_runs_make_a_page_of_bounded_size_that_keeps_the_extremes() {
    let mut long = rows(20_000);
    for (index, row) in long.iter_mut().enumerate() {
        row.cross_track_m = 1e-3 * (index as f64 * 0.7).sin();
    }
    long[12_345].cross_track_m = 0.5;
    let names = ["icrik-mpc", "icrhk-mpc", "diffdrive-mpc", "pure-pursuit"];
    let runs = names.map(|name| run(name, long.clone()));
    let page = page(&plane(), &runs);
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
    let document = checked(&page);
    let values = cross_track(&document).into_iter().flatten();
    assert_eq!(values.fold(0.0, f64::max), 50.0);
}

#[test]
fn runs_have_colours_of_their_own_that_stay_with_their_controllers() {
    let names = ["pure-pursuit", "icrik-mpc", "mine", "icrik-mpc"];
    let runs = names.map(|name| run(name, Vec::new()));
    let colours: Vec<_> = styles(&runs).iter().map(|style| style.colour).collect();
    let own = |name: &str| {
        let mut kinds = ControllerKind::ALL.iter();
        COLOURS[kinds.position(|kind| kind.name() == name).unwrap()]
    };
    assert_eq!(colours[..2], [own("pure-pursuit"), own("icrik-mpc")]);
    let distinct: std::collections::BTreeSet<_> = colours.iter().collect();
    assert_eq!(distinct.len(), names.len());
}
