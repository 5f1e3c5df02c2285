//! The scene that is shown live, as markers of visualization_msgs.

use nalgebra::Matrix3;
use sidehill_bridge::ros2::message::{Header, Point, Pose, Quaternion, Time, Vector3, wire};
use sidehill_controller::guard::GuardView;
use sidehill_plant::frames::{Attitude, Pose as Pose3};
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::{Outline, Vehicle};

wire! {
    /// Red, green, blue and opacity, 0 to 1.
    Colour { r: f32, g: f32, b: f32, a: f32 }
    /// sensor_msgs/CompressedImage.
    Image { header: Header, format: String, data: Vec<u8> }
    /// visualization_msgs/UVCoordinate.
    TexturePoint { u: f32, v: f32 }
    /// visualization_msgs/MeshFile.
    MeshFile { filename: String, data: Vec<u8> }
    /// visualization_msgs/Marker.
    Marker {
        header: Header,
        ns: String,
        id: i32,
        kind: i32,
        action: i32,
        pose: Pose,
        scale: Vector3,
        color: Colour,
        lifetime: Time,
        frame_locked: bool,
        points: Vec<Point>,
        colors: Vec<Colour>,
        texture_resource: String,
        texture: Image,
        uv_coordinates: Vec<TexturePoint>,
        text: String,
        mesh_resource: String,
        mesh_file: MeshFile,
        mesh_use_embedded_materials: bool,
    }
    /// Markers.
    MarkerArray = "visualization_msgs" / "MarkerArray" { markers: Vec<Marker> }
}

/// Frame of the world.
pub(super) const WORLD: &str = "world";
/// Frame of the vehicle, with the axes of REP-103.
pub(super) const BASE: &str = "base_link";
const ARROW: i32 = 0;
pub(super) const CUBE: i32 = 1;
const SPHERE: i32 = 2;
const CYLINDER: i32 = 3;
const LINES: i32 = 5;
const TEXT: i32 = 9;
const TRIANGLES: i32 = 11;
/// Points along a side of the ground that is shown.
const GROUND_POINTS: usize = 40;
/// Height of the bars of margins above the ground, in lengths of the vehicle.
const BARS_HEIGHT: f64 = 0.8;
/// Thickness of these bars, m.
const BAR_M: f64 = 0.08;
/// Height of their letters, m.
const TEXT_M: f64 = 0.2;
/// How long a slide of 1 m/s is drawn, m.
pub(super) const SLIDE_SCALE_S: f64 = 10.0;

/// Draws a vehicle and its motion.
pub(super) struct SceneParts {
    vehicle: Vehicle,
}

impl SceneParts {
    pub(super) fn new(vehicle: &Vehicle) -> Self {
        Self {
            vehicle: vehicle.clone(),
        }
    }

    /// Returns body and wheels, in the vehicle's frame.
    pub(super) fn vehicle(&self) -> Vec<Marker> {
        let Outline { body, wheels } = self.vehicle.outline();
        let radius_m = wheels
            .first()
            .map_or(0.0, |[_, _, diameter_m, _]| 0.5 * diameter_m);
        let mut markers = vec![Marker {
            pose: at(0.0, 0.0, 2.0 * radius_m),
            scale: vector(body[0], body[1], radius_m),
            ..marker("vehicle", 0, CUBE, [0.1, 0.3, 0.7, 0.9])
        }];
        for [forward_m, left_m, diameter_m, width_m] in wheels {
            let mut pose = at(forward_m, left_m, radius_m);
            // Its axis along the axle.
            let half = std::f64::consts::FRAC_1_SQRT_2;
            pose.orientation = Quaternion {
                x: half,
                y: 0.0,
                z: 0.0,
                w: half,
            };
            let id = markers.len() as i32;
            markers.push(Marker {
                pose,
                scale: vector(diameter_m, diameter_m, width_m),
                ..marker("vehicle", id, CYLINDER, [0.15, 0.15, 0.15, 1.0])
            });
        }
        for marker in &mut markers {
            marker.header.frame_id = BASE.to_owned();
            marker.frame_locked = true;
        }
        markers
    }

    /// Returns slide and tread ICRs, in the vehicle's frame: how ICRIK's velocity differs from that on
    /// level ground, and where the treads' contacts have no velocity across.
    pub(super) fn motion(&self, attitude: Attitude, treads: TreadSpeeds) -> Vec<Marker> {
        let vehicle = &self.vehicle;
        let sliding = vehicle.body_velocity(attitude, treads);
        let level = vehicle.icrhk().body_velocity(treads);
        let to = Point {
            x: SLIDE_SCALE_S * (sliding.forward_m_s - level.forward_m_s),
            y: -SLIDE_SCALE_S * (sliding.right_m_s - level.right_m_s),
            z: 0.5,
        };
        let from = Point {
            z: 0.5,
            ..Point::default()
        };
        let icrs = vehicle.icrik(attitude, treads);
        let icr = |id, right_m: f64| Marker {
            pose: at(icrs.forward_m, -right_m, 0.0),
            scale: vector(0.15, 0.15, 0.15),
            ..marker("icr", id, SPHERE, [0.9, 0.5, 0.0, 1.0])
        };
        let mut markers = vec![
            Marker {
                points: vec![from, to],
                scale: vector(0.05, 0.1, 0.1),
                ..marker("slide", 0, ARROW, [0.9, 0.1, 0.1, 1.0])
            },
            icr(0, icrs.left_m),
            icr(1, icrs.right_m),
        ];
        for marker in &mut markers {
            marker.frame_locked = true;
        }
        markers
    }

    /// Returns the ellipse in which the vehicle is with a probability of 95 %, in the world.
    pub(super) fn uncertainty(&self, pose: &Pose3, covariance: &Matrix3<f64>) -> Marker {
        /// Radius of that ellipse in standard deviations: the root of the 95 % quantile of chi squared with two
        /// degrees of freedom.
        const SIGMAS: f64 = 2.448;
        let (xx, xy, yy) = (covariance[(0, 0)], covariance[(0, 1)], covariance[(1, 1)]);
        let (mean, half) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
        let axis = |variance: f64| 2.0 * SIGMAS * variance.max(0.0).sqrt();
        let heading_rad = 0.5 * (2.0 * xy).atan2(xx - yy);
        let mut at = at(pose.x_m, pose.y_m, pose.z_m);
        (at.orientation.w, at.orientation.z) =
            ((0.5 * heading_rad).cos(), (0.5 * heading_rad).sin());
        let mut marker = Marker {
            pose: at,
            scale: vector(axis(mean + half), axis(mean - half), 0.01),
            ..marker("uncertainty", 0, CYLINDER, [0.0, 0.45, 0.7, 0.4])
        };
        marker.header.frame_id = WORLD.to_owned();
        marker
    }

    /// Returns the margins against tipping over and sliding off, in the vehicle's frame: two bars above it that
    /// are as long as the vehicle at a margin of 1, green to red, and their figures.
    pub(super) fn margins(&self, guard: &GuardView) -> Vec<Marker> {
        let length_m = 2.0 * self.vehicle.base_half_length_m;
        let height_m = BARS_HEIGHT * length_m;
        let bar = |id: i32, margin: f64| {
            let left = margin.clamp(0.0, 1.0);
            let shown_m = (left * length_m).max(0.01);
            let colour = [1.0 - left as f32, 0.8 * left as f32, 0.1, 0.9];
            Marker {
                pose: at(
                    0.5 * (shown_m - length_m),
                    0.0,
                    height_m + BAR_M * 2.0 * f64::from(id),
                ),
                scale: vector(shown_m, BAR_M, BAR_M),
                ..marker("margins", id, CUBE, colour)
            }
        };
        let text = Marker {
            pose: at(0.0, 0.0, height_m + 6.0 * BAR_M),
            scale: vector(0.0, 0.0, TEXT_M),
            text: format!(
                "tip-over margin {:.2}\nfriction used {:.2}\nspeed {:.0} %",
                guard.rollover_margin,
                guard.friction_use,
                100.0 * guard.speed_share
            ),
            ..marker("margins", 2, TEXT, [0.9, 0.9, 0.9, 1.0])
        };
        let mut markers = vec![
            bar(0, guard.rollover_margin),
            bar(1, 1.0 - guard.friction_use),
            text,
        ];
        for marker in &mut markers {
            marker.frame_locked = true;
        }
        markers
    }

    /// Returns the markers with their stamp; those without a frame get that of the header.
    pub(super) fn stamped(&self, mut markers: Vec<Marker>, header: &Header) -> MarkerArray {
        for marker in &mut markers {
            marker.header.stamp = header.stamp;
            if marker.header.frame_id.is_empty() {
                marker.header.frame_id.clone_from(&header.frame_id);
            }
        }
        MarkerArray { markers }
    }
}

/// Cells of a costmap that block, at places of the world, m.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Obstacles {
    /// Side of a cell.
    pub cell_m: f64,
    /// Rows of cells: both ends of their middle lines.
    pub rows: Vec<[[f64; 2]; 2]>,
}

/// Returns obstacles as lines as broad as a cell; none takes those before away.
pub(super) fn obstacles(obstacles: &Obstacles, z: f64) -> Marker {
    /// The action that deletes a marker.
    const DELETE: i32 = 2;
    let places = obstacles.rows.iter().flatten();
    Marker {
        action: if obstacles.rows.is_empty() { DELETE } else { 0 },
        scale: vector(obstacles.cell_m, 0.0, 0.0),
        points: places.map(|[x, y]| Point { x: *x, y: *y, z }).collect(),
        ..marker("obstacles", 0, LINES, [0.6, 0.1, 0.1, 0.9])
    }
}

/// Returns the mark of a place where the vehicle has dug in, by its number.
pub(super) fn dug_in(number: i32, pose: &Pose3) -> Marker {
    Marker {
        pose: at(pose.x_m, pose.y_m, pose.z_m),
        scale: vector(0.5, 0.5, 0.05),
        ..marker("dug_in", number, CYLINDER, [0.8, 0.1, 0.2, 0.9])
    }
}

/// Returns the ground in a rectangle from (x, y) to (x, y), m, as triangles; places without ground are
/// left out.
pub fn ground(terrain: &Terrain, from_m: [f64; 2], to_m: [f64; 2]) -> Marker {
    let place = |axis: usize, i: usize| {
        from_m[axis] + (to_m[axis] - from_m[axis]) * i as f64 / GROUND_POINTS as f64
    };
    let point = |i: usize, j: usize| {
        let (x, y) = (place(0, i), place(1, j));
        let z = terrain.surface(x, y).ok()?.height_m;
        Some(Point { x, y, z })
    };
    let mut points = Vec::new();
    for i in 0..GROUND_POINTS {
        for j in 0..GROUND_POINTS {
            let corners = [
                point(i, j),
                point(i + 1, j),
                point(i + 1, j + 1),
                point(i, j + 1),
            ];
            if let [Some(a), Some(b), Some(c), Some(d)] = corners {
                points.extend([a.clone(), b, c.clone(), a, c, d]);
            }
        }
    }
    Marker {
        points,
        ..marker("ground", 0, TRIANGLES, [0.45, 0.5, 0.35, 0.8])
    }
}

fn marker(ns: &str, id: i32, kind: i32, [r, g, b, a]: [f32; 4]) -> Marker {
    Marker {
        ns: ns.to_owned(),
        id,
        kind,
        scale: vector(1.0, 1.0, 1.0),
        color: Colour { r, g, b, a },
        ..Marker::default()
    }
}

fn at(x: f64, y: f64, z: f64) -> Pose {
    Pose {
        position: Point { x, y, z },
        ..Pose::default()
    }
}

fn vector(x: f64, y: f64, z: f64) -> Vector3 {
    Vector3 { x, y, z }
}
