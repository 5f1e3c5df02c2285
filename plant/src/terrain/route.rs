//! Ground of which only the elevation along a route is known.

mod smoothing;

pub use smoothing::RouteSmoothing;

use super::nodes::{Cells, Placed};
use super::{Surface, TerrainError};
use nalgebra::{Matrix3, Vector3};
use std::collections::BTreeSet;
use std::f64::consts::PI;
use std::sync::Arc;

/// Ground along a route: smoothed slope along it, and across it only what other passes show.
///
/// Elevations are smoothed by weighted plane fits over all points within `smoothing_length_m` of a
/// place, whichever pass of the route they come from. A single straight pass says nothing about the
/// slope across it, which is then 0. The tangent planes so found are blended over
/// `1.5 distance_max_m`, so that height and normal are continuous and the normal is the exact
/// gradient. On a straight climb that blend is the climb itself, at any offset to the side.
///
/// Where the route crosses, curves or repeats itself its passes share one ground: their elevations
/// are averaged, and a slope across the route is taken over as far as the passes spread sideways
/// (where two cross on an even hillside, four fifths of it). So there is no jump from one pass to
/// another, but two passes over one another (a bridge) cannot be distinguished.
#[derive(Debug, Clone)]
pub struct RouteTerrain {
    smoothing: RouteSmoothing,
    planes: Arc<Cells<TangentPlane>>,
}

/// A point of a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RoutePoint {
    /// X_g, m.
    pub x_m: f64,
    /// Y_g, m.
    pub y_m: f64,
    /// Elevation Z_g, m.
    pub z_m: f64,
}

/// Samples on a route at most, which bounds the memory a route can take.
const SAMPLES_MAX: f64 = 2e6;
const LENGTH_MIN_M: f64 = 0.1;
/// Slope between two points beyond which one of their elevations is wrong: 60 deg, and what noise adds, m.
const STEP_SLOPE_MAX: f64 = 1.732;
const STEP_NOISE_M: f64 = 1.0;

impl RouteTerrain {
    /// Returns the ground along the polyline of `points`; repeated places are allowed.
    ///
    /// # Errors
    /// Names the point that is not finite or whose elevation jumps, or the horizontal length that is below 0.1 m or above
    /// what two million samples cover.
    pub fn new(points: &[RoutePoint], smoothing: RouteSmoothing) -> Result<Self, TerrainError> {
        let samples = sample(points, &smoothing)?;
        let cells = Cells::new(smoothing.smoothing_length_m, samples.clone());
        let mut taken = BTreeSet::new();
        let stride = smoothing.plane_spacing_m() / smoothing.sample_spacing_m();
        let mut planes = Vec::new();
        for i in 0.. {
            let index = (f64::from(i) * stride) as usize;
            let last = index + 1 >= samples.len();
            let index = index.min(samples.len() - 1);
            let direction = direction(&samples, index);
            let place = samples[index].place_in_world();
            // Passes over the same place in the same direction would only repeat the plane; leaving
            // them out bounds the work of a query.
            if taken.insert(slot(place, direction, 0.5 * smoothing.plane_spacing_m())) {
                planes.push(fit(&cells, place, direction, smoothing.smoothing_length_m));
            }
            if last {
                break;
            }
        }
        Ok(Self {
            smoothing,
            planes: Arc::new(Cells::new(smoothing.blend_m(), planes)),
        })
    }

    pub(super) fn surface(&self, x_m: f64, y_m: f64) -> Result<Surface, TerrainError> {
        let radius_squared = self.smoothing.blend_m().powi(2);
        let mut nearest_squared = f64::INFINITY;
        let mut sums = RouteBlend::default();
        for plane in self.planes.near([x_m, y_m]) {
            let (dx, dy) = (x_m - plane.x_m, y_m - plane.y_m);
            let distance_squared = dx * dx + dy * dy;
            nearest_squared = nearest_squared.min(distance_squared);
            let rest = 1.0 - distance_squared / radius_squared;
            if rest > 0.0 {
                let weight_slope = -6.0 * rest * rest / radius_squared;
                sums.add(
                    plane,
                    [dx, dy],
                    rest.powi(3),
                    [weight_slope * dx, weight_slope * dy],
                );
            }
        }
        if nearest_squared > self.smoothing.distance_max_m.powi(2) {
            return Err(TerrainError::OffRoute {
                x_m,
                y_m,
                distance_max_m: self.smoothing.distance_max_m,
            });
        }
        Ok(sums.surface())
    }
}

/// A plane fitted to the route near a place on it.
#[derive(Debug, Clone, Copy)]
struct TangentPlane {
    x_m: f64,
    y_m: f64,
    z_m: f64,
    gradient_in_world: [f64; 2],
}

impl Placed for TangentPlane {
    fn place_in_world(&self) -> [f64; 2] {
        [self.x_m, self.y_m]
    }
}

impl Placed for RoutePoint {
    fn place_in_world(&self) -> [f64; 2] {
        [self.x_m, self.y_m]
    }
}

/// Sums over planes of weight w and height h: h_mean = sum(w h) / sum(w), and its derivatives.
#[derive(Default)]
struct RouteBlend {
    weight: f64,
    weight_gradient: [f64; 2],
    height: f64,
    height_gradient: [f64; 2],
}

impl RouteBlend {
    fn add(
        &mut self,
        plane: &TangentPlane,
        offset_m: [f64; 2],
        weight: f64,
        weight_gradient: [f64; 2],
    ) {
        let slope = plane.gradient_in_world;
        let height_m = plane.z_m + slope[0] * offset_m[0] + slope[1] * offset_m[1];
        self.weight += weight;
        self.height += weight * height_m;
        for axis in 0..2 {
            self.weight_gradient[axis] += weight_gradient[axis];
            self.height_gradient[axis] += weight_gradient[axis] * height_m + weight * slope[axis];
        }
    }

    fn surface(&self) -> Surface {
        let height_m = self.height / self.weight;
        let along = |axis: usize| {
            (self.height_gradient[axis] - height_m * self.weight_gradient[axis]) / self.weight
        };
        Surface::from_gradient(height_m, [along(0), along(1)])
    }
}

/// Horizontal distance of two points, m.
fn run(pair: &[RoutePoint]) -> f64 {
    (pair[1].x_m - pair[0].x_m).hypot(pair[1].y_m - pair[0].y_m)
}

/// The route at even arc lengths, first and last point included.
fn sample(
    points: &[RoutePoint],
    smoothing: &RouteSmoothing,
) -> Result<Vec<RoutePoint>, TerrainError> {
    for (index, p) in points.iter().enumerate() {
        if !(p.x_m.is_finite() && p.y_m.is_finite() && p.z_m.is_finite()) {
            return Err(TerrainError::RoutePointNotFinite {
                index,
                x_m: p.x_m,
                y_m: p.y_m,
                z_m: p.z_m,
            });
        }
    }
    for (before, pair) in points.windows(2).enumerate() {
        let (step_m, distance_m) = (pair[1].z_m - pair[0].z_m, run(pair));
        if step_m.abs() > STEP_NOISE_M + STEP_SLOPE_MAX * distance_m {
            return Err(TerrainError::RouteStep {
                index: before + 1,
                x_m: pair[1].x_m,
                y_m: pair[1].y_m,
                step_m,
                distance_m,
            });
        }
    }
    let length_m: f64 = points.windows(2).map(run).sum();
    let length_max_m = SAMPLES_MAX * smoothing.sample_spacing_m();
    if !(LENGTH_MIN_M..=length_max_m).contains(&length_m) {
        return Err(TerrainError::RouteLength {
            points: points.len(),
            length_m,
            length_min_m: LENGTH_MIN_M,
            length_max_m,
        });
    }
    let steps = (length_m / smoothing.sample_spacing_m()).ceil() as usize;
    let mut samples = Vec::with_capacity(steps + 1);
    let mut begin_m = 0.0;
    for pair in points.windows(2) {
        let run_m = run(pair);
        while samples.len() <= steps {
            let past_m = length_m * samples.len() as f64 / steps as f64 - begin_m;
            if past_m > run_m || run_m == 0.0 {
                break;
            }
            let share = past_m / run_m;
            let between = |a: f64, b: f64| a + share * (b - a);
            samples.push(RoutePoint {
                x_m: between(pair[0].x_m, pair[1].x_m),
                y_m: between(pair[0].y_m, pair[1].y_m),
                z_m: between(pair[0].z_m, pair[1].z_m),
            });
        }
        begin_m += run_m;
    }
    // Rounding can leave the last sample beyond the last point.
    if samples.len() <= steps {
        samples.extend(points.last());
    }
    Ok(samples)
}

/// Unit direction of the route at a sample, over a quarter of the smoothing length to either side,
/// or to one side where the route folds back on itself.
fn direction(samples: &[RoutePoint], index: usize) -> [f64; 2] {
    let (before, after) = (index.saturating_sub(4), (index + 4).min(samples.len() - 1));
    let chord = |from: usize, to: usize| {
        let (dx, dy) = (
            samples[to].x_m - samples[from].x_m,
            samples[to].y_m - samples[from].y_m,
        );
        (dx, dy, dx.hypot(dy))
    };
    let whole = chord(before, after);
    let sides = [chord(before, index), chord(index, after)];
    let longest_side = if sides[0].2 > sides[1].2 {
        sides[0]
    } else {
        sides[1]
    };
    let (dx, dy, length) = if whole.2 > 0.5 * longest_side.2 {
        whole
    } else {
        longest_side
    };
    if length > 0.0 {
        [dx / length, dy / length]
    } else {
        [1.0, 0.0]
    }
}

/// Plane z = a + G (u, v) fitted to the samples near a place, u along `direction` and v to its left.
///
/// The slope in v is penalised as if the samples had an extra spread of `CROSS_SPREAD` of the
/// smoothing length in v at no slope: a single pass says nothing about v and gets none.
fn fit(
    samples: &Cells<RoutePoint>,
    [x_m, y_m]: [f64; 2],
    direction: [f64; 2],
    smoothing_length_m: f64,
) -> TangentPlane {
    let near = || {
        samples.near([x_m, y_m]).filter_map(move |sample| {
            let (dx, dy) = (sample.x_m - x_m, sample.y_m - y_m);
            let rest = 1.0 - (dx * dx + dy * dy) / smoothing_length_m.powi(2);
            let along = direction[0] * dx + direction[1] * dy;
            let left = direction[0] * dy - direction[1] * dx;
            (rest > 0.0).then(|| (rest.powi(3), Vector3::new(along, left, sample.z_m)))
        })
    };
    let (weight, sum) = near().fold((0.0, Vector3::zeros()), |(weight, sum), (w, point)| {
        (weight + w, sum + w * point)
    });
    let mean = sum / weight;
    let spread = near().fold(Matrix3::zeros(), |spread, (w, point)| {
        spread + (point - mean) * (point - mean).transpose() * (w / weight)
    });
    // The first term keeps the system regular where all samples stand on one spot.
    let uu = spread[(0, 0)] + (1e-6 * smoothing_length_m).powi(2);
    let vv = spread[(1, 1)] + (CROSS_SPREAD * smoothing_length_m).powi(2);
    let (uv, uz, vz) = (spread[(0, 1)], spread[(0, 2)], spread[(1, 2)]);
    let determinant = uu * vv - uv * uv;
    let along = (uz * vv - vz * uv) / determinant;
    let left = (vz * uu - uz * uv) / determinant;
    TangentPlane {
        x_m,
        y_m,
        z_m: mean.z - along * mean.x - left * mean.y,
        gradient_in_world: [
            along * direction[0] - left * direction[1],
            along * direction[1] + left * direction[0],
        ],
    }
}

const CROSS_SPREAD: f64 = 0.1;

/// Key that planes share when they stand in one square of side `side_m` and point, forward or
/// backward, within one eighth of a half turn.
fn slot([x_m, y_m]: [f64; 2], direction: [f64; 2], side_m: f64) -> (i64, i64, i64) {
    let angle = direction[1].atan2(direction[0]).rem_euclid(PI);
    let index = |m: f64| (m / side_m).floor() as i64;
    (index(x_m), index(y_m), (angle / PI * 8.0) as i64 % 8)
}

#[cfg(test)]
mod tests;
