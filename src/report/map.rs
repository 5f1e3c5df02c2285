//! The runs seen from above over the ground, for the map of the live page.

use super::scene::{Scene, Style};
use crate::record::{Row, Run};
use serde::Serialize;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::{Outline, Vehicle};
use std::f64::consts::FRAC_PI_2;

/// Frames of a run, at most.
const FRAMES: usize = 1500;
/// Nodes of the ground along a side.
const NODES: usize = 160;

/// What a frame holds, in this order: that of the live page. Units: s, m, rad.
const COLUMNS: [&str; 6] = ["t", "x", "y", "heading", "downhill_x", "downhill_y"];

/// The map of a page.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct PageMap {
    columns: [&'static str; COLUMNS.len()],
    pub(crate) runs: Vec<MapRun>,
    /// Path that was to be followed, x, y, x, y ..., m.
    path: Vec<f64>,
    vehicle: Outline,
    ground: Option<MapGround>,
    /// [`GeodeticOrigin::expansion`](sidehill_controller::path::GeodeticOrigin::expansion) of the origin.
    earth: Option<[[f64; 2]; 6]>,
    marks: Vec<Mark>,
}

/// Where a run went.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct MapRun {
    name: String,
    colour: &'static str,
    frames: Vec<MapFrame>,
}

type MapFrame = [Option<f64>; COLUMNS.len()];

/// A place that the map marks.
#[derive(Debug, Clone, Serialize)]
struct Mark {
    run: usize,
    x: f64,
    y: f64,
    text: String,
}

/// Heights, m, at the nodes of a grid, row by row from the corner of its lowest x and y; none where there is no ground.
#[derive(Debug, Clone, Serialize)]
struct MapGround {
    corner: [f64; 2],
    size: [f64; 2],
    nodes: [usize; 2],
    heights: Vec<Option<f64>>,
}

impl MapRun {
    /// Returns a run through poses with their times, s.
    pub(crate) fn through(
        name: &str,
        colour: &'static str,
        poses: impl ExactSizeIterator<Item = (f64, PlanarPose)>,
        gradient: impl Fn(f64, f64) -> Option<[f64; 2]>,
    ) -> Self {
        let stride = poses.len().div_ceil(FRAMES).max(1);
        let last = poses.len().saturating_sub(1);
        let kept = poses
            .enumerate()
            .filter(|(index, _)| index % stride == 0 || *index == last);
        let frame = |(_, (time_s, pose)): (usize, (f64, PlanarPose))| {
            // The horizontal part of the ground's normal points downhill; its length is the sine of the slope.
            let downhill = gradient(pose.x_m, pose.y_m).map(|[along_x, along_y]| {
                let length = (1.0 + along_x * along_x + along_y * along_y).sqrt();
                [-along_x / length, -along_y / length]
            });
            let [downhill_x, downhill_y] = downhill.unwrap_or([f64::NAN; 2]);
            [
                time_s,
                pose.x_m,
                pose.y_m,
                pose.yaw_rad + FRAC_PI_2,
                downhill_x,
                downhill_y,
            ]
            .map(short)
        };
        Self {
            name: name.to_owned(),
            colour,
            frames: kept.map(frame).collect(),
        }
    }
}

impl PageMap {
    /// Returns the map of runs of a scene.
    pub(super) fn of(scene: &Scene, runs: &[Run], styles: &[Style]) -> Self {
        let gradient = |x_m: f64, y_m: f64| {
            let surface = scene.terrain.surface(x_m, y_m).ok()?;
            Some(surface.gradient_in_world())
        };
        let marks = runs.iter().enumerate().filter_map(|(run, record)| {
            let place = record
                .summary
                .guard
                .and_then(|guard| guard.stopped_before)?;
            Some(Mark {
                run,
                x: place.x_m,
                y: place.y_m,
                text: format!(
                    "{} {:.2}, limit {:.2}",
                    place.measure, place.value, place.limit
                ),
            })
        });
        let marks: Vec<Mark> = marks.collect();
        let runs = runs.iter().zip(styles);
        let runs = runs.map(|(run, style)| {
            MapRun::through(
                &style.name,
                style.colour,
                run.rows.iter().map(tracked),
                gradient,
            )
        });
        let mut map = Self::over(runs.collect(), &scene.path, scene.vehicle);
        map.ground = Some(map.ground_of(scene.terrain));
        map.earth = scene.datum.map(|datum| datum.expansion());
        map.marks = marks;
        map
    }

    /// Returns the map of runs along a path, without ground.
    pub(crate) fn over(runs: Vec<MapRun>, path: &[[f64; 2]], vehicle: &Vehicle) -> Self {
        let path = path.as_flattened().iter();
        Self {
            columns: COLUMNS,
            runs,
            path: path.copied().filter_map(short).collect(),
            vehicle: vehicle.outline(),
            ground: None,
            earth: None,
            marks: Vec::new(),
        }
    }

    /// Returns whether there is neither a path nor a run to see.
    pub(super) fn is_empty(&self) -> bool {
        self.path.is_empty() && self.runs.iter().all(|run| run.frames.is_empty())
    }

    /// Samples the ground of all that is to be seen.
    fn ground_of(&self, terrain: &Terrain) -> MapGround {
        let frames = self.runs.iter().flat_map(|run| &run.frames);
        let driven = frames.filter_map(|frame| Some([frame[1]?, frame[2]?]));
        let path = self.path.chunks_exact(2).map(|at| [at[0], at[1]]);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for at in driven.chain(path) {
            for axis in 0..2 {
                low[axis] = low[axis].min(at[axis]);
                high[axis] = high[axis].max(at[axis]);
            }
        }
        if low[0] > high[0] {
            (low, high) = ([0.0; 2], [0.0; 2]);
        }
        // A window is broader than it is high, or the other way round. Four nodes tell a plane, also farther away.
        let (nodes, sides) = match terrain {
            Terrain::Plane(_) => (2, 20.0),
            _ => (NODES, 1.6),
        };
        let side = sides * (high[0] - low[0]).max(high[1] - low[1]) + 4.0 * self.vehicle.body[0];
        let corner = [0, 1].map(|axis| 0.5 * (low[axis] + high[axis]) - 0.5 * side);
        let at = |index: usize| side * index as f64 / (nodes - 1) as f64;
        let heights = (0..nodes * nodes).map(|node| {
            let (x_m, y_m) = (corner[0] + at(node % nodes), corner[1] + at(node / nodes));
            let surface = terrain.surface(x_m, y_m).ok()?;
            short(surface.height_m)
        });
        MapGround {
            corner,
            size: [side; 2],
            nodes: [nodes; 2],
            heights: heights.collect(),
        }
    }
}

/// Returns a number to a thousandth; none for what is not finite.
fn short(value: f64) -> Option<f64> {
    value.is_finite().then(|| (value * 1e3).round() / 1e3)
}

/// Returns time and place of what is tracked.
fn tracked(row: &Row) -> (f64, PlanarPose) {
    let pose = row.pose.planar();
    let [x_m, y_m] = row.tracked.unwrap_or([pose.x_m, pose.y_m]);
    (row.time_s, PlanarPose { x_m, y_m, ..pose })
}
