use super::*;
use crate::record::{Quantiles, Summary};
use roxmltree::{Document, ParsingOptions};
use sidehill_controller::config::ControllerConfig;
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::estimator::ContactEstimate;
use sidehill_plant::contact::ParameterVector;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::icr::TreadIcrs;
use sidehill_plant::speeds::{EncoderScale, MotorSpeeds};
use sidehill_plant::terrain::{PlaneTerrain, RoutePoint, RouteSmoothing, RouteTerrain, Terrain};

/// A cycle on a circle of 3 m radius.
fn row(index: usize) -> Row {
    let time_s = 0.05 * index as f64;
    let (sin, cos) = (0.1 * time_s).sin_cos();
    let motors = MotorSpeeds {
        traction_m_s: 0.3,
        steer_m_s: 0.1 * sin,
    };
    Row {
        time_s,
        pose: Pose {
            x_m: 3.0 * cos,
            y_m: 3.0 * sin,
            z_m: 0.1,
            yaw_rad: 0.1 * time_s,
        },
        attitude: Attitude {
            roll_rad: 0.1 * cos,
            pitch_rad: 0.1 * sin,
        },
        estimate: None,
        reference: PlanarPose {
            x_m: 3.0 * cos,
            y_m: 3.0 * sin,
            yaw_rad: 0.1 * time_s,
        },
        slope: None,
        tracked: None,
        cross_track_m: 0.01 * (7.3 * time_s).sin(),
        along_track_m: 1e-3,
        heading_error_rad: -0.2,
        command: motors,
        motors,
        tread_speeds: EncoderScale {
            left: 1.0,
            right: 1.0,
        }
        .invert(motors.into()),
        icrs: TreadIcrs {
            left_m: -1.0,
            right_m: 1.1,
            forward_m: 0.2,
        },
        contact: None,
        status: Status::Tracking,
        qp_iterations: 6,
        qp_path: None,
        solve_us: 200.0 + index as f64 % 90.0,
        cycle_us: 230.0,
    }
}

fn run(controller: &str, rows: Vec<Row>) -> Run {
    let solve_us = Quantiles::of(rows.iter().map(|row| row.solve_us).collect());
    Run {
        summary: Summary {
            controller: controller.to_owned(),
            plant: "icrik".to_owned(),
            scenario: "circle".to_owned(),
            seed: 0,
            completed: true,
            ended_by: None,
            cross_track_rms_m: 0.004,
            cross_track_p95_m: 0.009,
            cross_track_max_m: 0.012_345,
            laps: Vec::new(),
            guard: None,
            origin_cross_track_rms_m: None,
            along_track_rms_m: 0.001,
            heading_rms_rad: 0.2,
            steer_total_variation_m_s: 3.5,
            goal_error_m: 0.0,
            constraint_violations: 0,
            fallbacks: 3,
            deadline_misses: 0,
            qp_iterations_mean: 6.0,
            qp_working_set: 0,
            qp_interior_point: 0,
            qp_cut_short: 0,
            solve_us,
            cycle_us: solve_us,
        },
        rows,
        learned: None,
    }
}

fn page(terrain: &Terrain, runs: &[Run]) -> String {
    let circle = |i: u32| (f64::from(i) / 100.0).sin_cos();
    let scene = Scene {
        title: "A circle & more".to_owned(),
        subtitle: "on <a> slope".to_owned(),
        path: (0..629)
            .map(circle)
            .map(|(s, c)| [3.0 * c, 3.0 * s])
            .collect(),
        terrain,
        guard: None,
        limits: &ControllerConfig::default().limits,
        base_half_width_m: 0.6,
        base_half_length_m: 1.06,
        period_s: 0.05,
    };
    html(&scene, runs)
}

fn plane() -> Terrain {
    Terrain::Plane(PlaneTerrain::new(10.0, 30.0).unwrap())
}

/// Parses the page strictly, and checks that it stands alone.
fn checked(page: &str) -> Document<'_> {
    let options = ParsingOptions {
        allow_dtd: true,
        ..ParsingOptions::default()
    };
    let document = Document::parse_with_options(page, options).unwrap();
    for node in document.descendants().filter(|node| node.is_element()) {
        let name = node.tag_name().name();
        assert!(!["link", "img", "iframe", "image"].contains(&name));
        for attribute in node.attributes() {
            let (name, value) = (attribute.name(), attribute.value());
            assert!(!["src", "href"].contains(&name), "{name}={value}");
            for bad in ["NaN", "inf", "http"] {
                assert!(!value.contains(bad), "{name}={value}");
            }
        }
    }
    for style in named(&document, "style") {
        let css = style.text().unwrap();
        assert!(!css.contains("url(") && !css.contains("@import"));
    }
    document
}

/// Returns the elements of a name.
fn named<'a>(document: &'a Document<'_>, name: &str) -> Vec<roxmltree::Node<'a, 'a>> {
    let nodes = document.descendants();
    nodes
        .filter(|node| node.tag_name().name() == name)
        .collect()
}

fn text(document: &Document) -> String {
    let texts = document.descendants().filter(roxmltree::Node::is_text);
    texts
        .filter_map(|node| node.text())
        .collect::<Vec<_>>()
        .join(" ")
}

fn rows(count: usize) -> Vec<Row> {
    (0..count).map(row).collect()
}

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
        "Map",
        "Cross-track error",
        "Commands",
        "Attitude",
        "Tread ICRs",
        "Solve time",
    ];
    assert_eq!(headings, sections);
    assert_eq!(named(&document, "svg").len(), 2, "map and solve time");
    let plots = named(&document, "div")
        .into_iter()
        .filter(|node| node.attribute("class") == Some("plot"));
    assert_eq!(plots.count(), 1 + 2 + 2 + 3);
    let text = text(&document);
    for part in [
        "icrik-mpc",
        "pure-pursuit",
        "1.23",
        "uphill",
        "slope 10.0\u{b0}",
        "0.5 m",
        "limit 1 m/s",
        "p99 2",
    ] {
        assert!(text.contains(part), "{part} is missing");
    }
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
    assert!(text.contains("A circle & more") && text.contains("on <a> slope"));
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
        .find(|node| node.attribute("aria-label") == Some("cross-track (cm)"))
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
fn ground_known_along_a_route_only_has_contours_there() {
    let point = |i: u32| RoutePoint {
        x_m: 3.0,
        y_m: f64::from(i) - 3.0,
        z_m: 0.2 * f64::from(i),
    };
    let points: Vec<_> = (0..7).map(point).collect();
    let smoothing = RouteSmoothing::new(2.0, 1.0).unwrap();
    let terrain = Terrain::Route(RouteTerrain::new(&points, smoothing).unwrap());
    let page = page(&terrain, &[run("icrik-mpc", rows(100))]);
    let document = checked(&page);
    let contours: Vec<_> = document
        .descendants()
        .filter(|node| node.attribute("class") == Some("contour"))
        .filter_map(|node| node.attribute("d"))
        .collect();
    assert!(contours.len() > 3);
    // 960 px show at least 12 m, the corridor is 2 m wide on the right of the middle.
    for number in contours.iter().flat_map(|d| d.split(['M', 'L'])) {
        if let Some((x, _)) = number.split_once(',') {
            assert!(x.parse::<f64>().unwrap() > 500.0, "{x}");
        }
    }
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

#[test]
fn a_csv_reads_back_bit_for_bit() {
    let mut run = run("icrik-mpc", rows(100));
    run.rows[3].cross_track_m = f64::NAN;
    run.rows[4].status = Status::Stopping(StopReason::OffPath { cross_track_m: 2.5 });
    let mut bytes = Vec::new();
    write_csv(&run, &mut bytes).unwrap();
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|header| header == name).unwrap();
    let records: Vec<_> = reader.records().map(Result::unwrap).collect();
    assert_eq!(records.len(), run.rows.len());
    for (record, row) in records.iter().zip(&run.rows) {
        let number = |name: &str| record[column(name)].parse::<f64>().unwrap().to_bits();
        assert_eq!(number("time_s"), row.time_s.to_bits());
        assert_eq!(number("y_m"), row.pose.y_m.to_bits());
        assert_eq!(number("pitch_rad"), row.attitude.pitch_rad.to_bits());
        assert_eq!(&record[column("estimate_yaw_rad")], "");
        assert_eq!(number("reference_x_m"), row.reference.x_m.to_bits());
        assert_eq!(number("cross_track_m"), row.cross_track_m.to_bits());
        assert_eq!(number("command_steer_m_s"), row.command.steer_m_s.to_bits());
        assert_eq!(number("icr_right_m"), row.icrs.right_m.to_bits());
        assert_eq!(number("solve_us"), row.solve_us.to_bits());
    }
    assert_eq!(&records[3][column("status")], "tracking");
    assert_eq!(&records[4][column("status")], "stopping");
    assert!(records[4][column("reason")].contains("2.50 m off the path"));
}

#[test]
fn learned_parameters_are_in_csv_and_report_with_their_intervals() {
    let mut run = run("contact-mpc", rows(20));
    let learned = |friction: f64| ContactEstimate {
        parameters: ParameterVector::repeat(friction.ln()),
        sigma: ParameterVector::repeat(0.1),
        prior_sigma: ParameterVector::from_fn(|i, _| if i == 0 { 1.0 } else { 0.1 }),
    };
    for row in &mut run.rows[5..] {
        row.contact = Some(learned(0.8));
    }
    let mut bytes = Vec::new();
    write_csv(&run, &mut bytes).unwrap();
    let mut reader = csv::Reader::from_reader(bytes.as_slice());
    let headers = reader.headers().unwrap().clone();
    let column = |name: &str| headers.iter().position(|header| header == name).unwrap();
    let records: Vec<_> = reader.records().map(Result::unwrap).collect();
    assert_eq!(&records[4][column("learned_friction")], "");
    let number = |name: &str| records[9][column(name)].parse::<f64>().unwrap();
    assert!((number("learned_friction") - 0.8).abs() < 1e-12);
    assert!((number("learned_friction_low") - 0.8 * (-0.196_f64).exp()).abs() < 1e-12);
    assert!((number("learned_friction_high") - 0.8 * 0.196_f64.exp()).abs() < 1e-12);
    let unobserved = &records[9][column("learned_unobserved")];
    assert!(!unobserved.contains("friction"), "{unobserved}");
    assert!(unobserved.contains("slip_scale_m_s"), "{unobserved}");
    let page = page(&plane(), &[run]);
    assert!(page.contains("slip_scale_m_s") && page.contains("not excited"));
}

#[test]
fn a_csv_without_rows_has_its_header() {
    let mut bytes = Vec::new();
    write_csv(&run("icrik-mpc", Vec::new()), &mut bytes).unwrap();
    let text = String::from_utf8(bytes).unwrap();
    assert!(text.starts_with("time_s,x_m,") && text.lines().count() == 1);
}
