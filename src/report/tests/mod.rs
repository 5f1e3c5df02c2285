//! The page and the CSV of runs.

mod pages;
mod tables;

use super::*;
use crate::record::{Quantiles, Row, Summary};
use roxmltree::Document;
use sidehill_controller::config::ControllerConfig;
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller::{Status, StopReason};
use sidehill_controller::estimator::ContactEstimate;
use sidehill_plant::contact::ParameterVector;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::icr::TreadIcrs;
use sidehill_plant::speeds::{EncoderScale, MotorSpeeds};
use sidehill_plant::terrain::{PlaneTerrain, RoutePoint, RouteSmoothing, RouteTerrain, Terrain};
use sidehill_plant::vehicle::Vehicle;

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
        cross_track_bound_m: None,
        ahead: None,
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
            cross_track_bound_held: None,
            cross_track_ahead_bound_held: None,
            origin_cross_track_rms_m: None,
            along_track_rms_m: 0.001,
            heading_rms_rad: 0.2,
            steer_total_variation_m_s: 3.5,
            goal_error_m: 0.0,
            mean_speed_m_s: 0.456,
            time_s: 12.3,
            tread_speed_max_m_s: 0.789,
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
        datum: None,
        perfect_sensors: false,
        limits: &ControllerConfig::default().limits,
        vehicle: &Vehicle::j8(),
        period_s: 0.05,
    };
    html(&scene, runs)
}

fn plane() -> Terrain {
    Terrain::Plane(PlaneTerrain::new(10.0, 30.0).unwrap())
}

/// Parses what the page shows, which is XML as well, and checks that it stands alone.
fn checked(page: &str) -> Document<'_> {
    let (from, to) = (page.find("<main>").unwrap(), page.find("</main>").unwrap());
    let document = Document::parse(&page[from..to + "</main>".len()]).unwrap();
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
    let (style, _) = page.split_once("</style>").unwrap();
    assert!(!style.contains("url(") && !style.contains("@import"));
    document
}

/// Returns what the map shows.
fn map(page: &str) -> serde_json::Value {
    let (_, rest) = page.split_once("<script id=\"runs\"").unwrap();
    let (_, rest) = rest.split_once('>').unwrap();
    serde_json::from_str(rest.split_once("</script>").unwrap().0).unwrap()
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
