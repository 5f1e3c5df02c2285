//! The runs seen from above, over the ground's contour lines.

use super::frame::{PlotFrame, px, range, ticks};
use super::ground::GroundPicture;
use super::relief::{self, Labels};
use super::scene::{DRAWING_WIDTH_PX, Scene, Style};
use crate::record::{Row, Run};
use maud::{Markup, html};
use sidehill_controller::guard::SteepPlace;
use sidehill_controller::path::{GeodeticOrigin, Point2};
use sidehill_plant::frames::PlanarPose;

const LEFT_PX: f64 = 80.0;
const TOP_PX: f64 = 8.0;
const HEIGHT_MIN_PX: f64 = 340.0;
const HEIGHT_MAX_PX: f64 = 740.0;
/// Between the points of a line.
const POINT_PX: f64 = 0.5;

/// Draws contours, path, tracks and the vehicle at its start on one scale for both axes.
pub(super) fn map(scene: &Scene, runs: &[Run], styles: &[Style]) -> Markup {
    let tracks: Vec<Vec<[f64; 2]>> = runs.iter().map(track).collect();
    let frame = frame(scene, &tracks);
    let metre_px = frame.width / (frame.x[1] - frame.x[0]);
    let (x_ticks, y_ticks) = (
        ticks(frame.x, 10.0),
        ticks(frame.y, 10.0 * frame.height / frame.width),
    );
    let thin = |line: &[[f64; 2]]| frame.line(thinned(line, POINT_PX / metre_px));
    // A controller may have begun before its first pose.
    let start = runs.iter().find_map(|run| run.rows.iter().find(placed));
    let ground = GroundPicture::of(scene, &frame);
    let lines = scene.path.iter().chain(tracks.iter().flatten());
    let taken = lines.map(|point| frame.place(*point)).collect();
    let contours = relief::contours(
        &frame,
        &ground.heights,
        Labels::beside(taken, &relief::boxes(&frame)),
    );
    let view = format!("0 0 {DRAWING_WIDTH_PX} {}", px(frame.bottom() + 44.0));
    html! {
        svg viewBox=(view) data-frame=(data(&frame)) data-earth=[scene.datum.map(earth)] data-tracks=(moments(runs)) role="img" aria-label="map" {
            (frame.axis_below(&x_ticks, "world X_g (m)", true))
            (frame.axis_left(&y_ticks, "world Y_g (m)"))
            (frame.clipped("map-frame", &html! {
                @for contour in &contours { (contour.line()) }
                path.path d=(thin(&scene.path)) {}
                // The first run is drawn last: it lies on top.
                @for (run, track) in tracks.iter().enumerate().rev() {
                    g.{ "run" (run) } {
                        path.curve d=(thin(track)) stroke=(styles[run].colour) {}
                        @if let Some(end) = track.last().filter(|p| frame.contains(**p)) {
                            @let [x, y] = frame.place(*end);
                            circle cx=(px(x)) cy=(px(y)) r="4" fill=(styles[run].colour) {}
                        }
                    }
                }
                @if !ground.even {
                    (relief::arrows(&frame, scene))
                }
                @for contour in &contours { (contour.label()) }
                @for (run, refused) in runs.iter().enumerate() {
                    @if let Some(place) = refused.summary.guard.and_then(|guard| guard.stopped_before) {
                        g.{ "run" (run) } { (steep(&frame, &place)) }
                    }
                }
                @if let Some(row) = start {
                    (vehicle(&frame, scene, &row.pose.planar()))
                }
            }))
            (relief::slope_box(&frame, &ground))
            (relief::scale_bar(&frame, metre_px))
            (frame.border())
        }
    }
}

/// Returns where the frame is in the drawing and what it shows, for the script of the page.
fn data(frame: &PlotFrame) -> String {
    let numbers = [frame.left, frame.top, frame.width, frame.height];
    let all = numbers.into_iter().chain(frame.x).chain(frame.y);
    all.map(|number| number.to_string())
        .collect::<Vec<_>>()
        .join(" ")
}

/// Returns latitude and longitude, deg, of the origin and their changes over a metre along x and along y, for the script
/// of the page. Over a map of kilometres the plane is true to millimetres.
fn earth(datum: GeodeticOrigin) -> String {
    /// Length of the steps, m.
    const STEP_M: f64 = 100.0;
    let at = |x_m, y_m| datum.unproject(Point2 { x_m, y_m });
    let (origin, x, y) = (at(0.0, 0.0), at(STEP_M, 0.0), at(0.0, STEP_M));
    let steps = [x, y].map(|(latitude, longitude)| {
        [
            (latitude - origin.0) / STEP_M,
            (longitude - origin.1) / STEP_M,
        ]
    });
    let all = [[origin.0, origin.1], steps[0], steps[1]];
    all.as_flattened()
        .iter()
        .map(f64::to_string)
        .collect::<Vec<_>>()
        .join(" ")
}

/// Returns whether it is known where the vehicle was.
fn placed(row: &&Row) -> bool {
    row.pose.x_m.is_finite() && row.pose.y_m.is_finite()
}

/// Moments of each run that the script of the page knows, at most.
const MOMENTS: usize = 1500;

/// Returns time, x and y of each run as JSON, for the script of the page.
fn moments(runs: &[Run]) -> String {
    let moments = runs.iter().map(|run| {
        let rows = run
            .rows
            .iter()
            .step_by(run.rows.len().div_ceil(MOMENTS).max(1))
            .filter(placed);
        let texts = rows.map(|row| {
            let [x_m, y_m] = row.tracked.unwrap_or([row.pose.x_m, row.pose.y_m]);
            format!("[{:.2},{x_m:.2},{y_m:.2}]", row.time_s)
        });
        format!("[{}]", texts.collect::<Vec<_>>().join(","))
    });
    format!("[{}]", moments.collect::<Vec<_>>().join(","))
}

fn track(run: &Run) -> Vec<[f64; 2]> {
    let poses = run
        .rows
        .iter()
        .map(|row| row.tracked.unwrap_or([row.pose.x_m, row.pose.y_m]));
    poses
        .filter(|p| p[0].is_finite() && p[1].is_finite())
        .collect()
}

/// Returns a frame that contains everything at one scale for both axes.
fn frame(scene: &Scene, tracks: &[Vec<[f64; 2]>]) -> PlotFrame {
    let points = || tracks.iter().flatten().chain(&scene.path);
    let around = 1.2 * scene.base_half_length_m.hypot(scene.base_half_width_m);
    let extent = |axis: usize| {
        let [low, high] = range(points().map(|point| point[axis]), 0.06);
        [low - around, high + around]
    };
    let (x, y) = (extent(0), extent(1));
    let width = DRAWING_WIDTH_PX - LEFT_PX - 20.0;
    let aspect = (y[1] - y[0]) / (x[1] - x[0]);
    let height = (width * aspect).clamp(HEIGHT_MIN_PX, HEIGHT_MAX_PX);
    let metre_px = (width / (x[1] - x[0])).min(height / (y[1] - y[0]));
    let widened = |[low, high]: [f64; 2], length_px: f64| {
        let (middle, half) = (0.5 * (low + high), 0.5 * length_px / metre_px);
        [middle - half, middle + half]
    };
    PlotFrame {
        left: LEFT_PX,
        top: TOP_PX,
        width,
        height,
        x: widened(x, width),
        y: widened(y, height),
    }
}

/// Draws a cross at a place before which the guard stops, with the limit exceeded there.
fn steep(frame: &PlotFrame, place: &SteepPlace) -> Markup {
    let [x, y] = frame.place([place.x_m, place.y_m]);
    let line = |dx: f64, dy: f64| {
        html! {
            line.steep x1=(px(x - dx)) y1=(px(y - dy)) x2=(px(x + dx)) y2=(px(y + dy)) {}
        }
    };
    let text = format!(
        "{} {:.2}, limit {}",
        place.measure, place.value, place.limit
    );
    html! {
        (line(7.0, 7.0)) (line(7.0, -7.0))
        text.halo.strong x=(px(x + 12.0)) y=(px(y - 10.0)) { (text) }
    }
}

/// Returns a line without the points that are nearer than `least_m` to the one before; the last
/// one stays.
fn thinned(line: &[[f64; 2]], least_m: f64) -> Vec<[f64; 2]> {
    let mut kept: Vec<[f64; 2]> = Vec::new();
    for (index, point) in line.iter().enumerate() {
        let near = kept
            .last()
            .is_some_and(|k| (point[0] - k[0]).hypot(point[1] - k[1]) < least_m);
        if !near || index + 1 == line.len() {
            kept.push(*point);
        }
    }
    kept
}

/// Draws the rectangle of the wheels' contact points with a wedge at its front.
fn vehicle(frame: &PlotFrame, scene: &Scene, pose: &PlanarPose) -> Markup {
    let (sin, cos) = pose.yaw_rad.sin_cos();
    let place = |right: f64, forward: f64| {
        let (right, forward) = (
            right * scene.base_half_width_m,
            forward * scene.base_half_length_m,
        );
        [
            pose.x_m + cos * right - sin * forward,
            pose.y_m + sin * right + cos * forward,
        ]
    };
    let closed = |points: &[[f64; 2]]| frame.line(points.iter().copied()) + "Z";
    let base = [
        place(-1.0, -1.0),
        place(1.0, -1.0),
        place(1.0, 1.0),
        place(-1.0, 1.0),
    ];
    let wedge = [place(-0.6, 0.35), place(0.6, 0.35), place(0.0, 0.9)];
    let [x, y] = frame.place([pose.x_m, pose.y_m]);
    let half_px = frame.width / (frame.x[1] - frame.x[0]) * scene.base_half_length_m;
    html! {
        path.vehicle d=(closed(&base)) {}
        path.front d=(closed(&wedge)) {}
        @if half_px < 6.0 {
            circle.vehicle cx=(px(x)) cy=(px(y)) r="8" {}
        }
        text.halo.strong x=(px(x)) y=(px(y + half_px.max(8.0) + 16.0)) text-anchor="middle" { "start" }
    }
}
