//! Smoothing of a row of nodes, and the cubic spline through it.

use super::{CurvePoint, Point2};
use nalgebra::Vector2;

/// Weight that pins a node, against 1 of a free one.
const PIN: f64 = 1e9;

/// Returns the nodes p that minimise sum w_i |p_i - q_i|^2 + sum lambda_i |p_(i-1) - 2 p_i +
/// p_(i+1)|^2, with both ends of `given` (q) kept, and the neighbours of an end too where `pinned`
/// says so.
///
/// `stiffness` holds lambda_i for every node; those of the ends are not used. At least four nodes.
pub(super) fn smooth_nodes(
    given: &[Point2],
    stiffness: &[f64],
    pinned: (bool, bool),
) -> Vec<Point2> {
    let n = given.len();
    let mut weights = vec![1.0; n];
    weights[0] = PIN;
    weights[n - 1] = PIN;
    if pinned.0 {
        weights[1] = PIN;
    }
    if pinned.1 {
        weights[n - 2] = PIN;
    }
    // Normal equations: symmetric with two bands above the diagonal.
    let mut diagonal = weights.clone();
    let (mut first, mut second) = (vec![0.0; n], vec![0.0; n]);
    for (i, &lambda) in stiffness.iter().enumerate().take(n - 1).skip(1) {
        diagonal[i - 1] += lambda;
        diagonal[i] += 4.0 * lambda;
        diagonal[i + 1] += lambda;
        first[i - 1] -= 2.0 * lambda;
        first[i] -= 2.0 * lambda;
        second[i - 1] += lambda;
    }
    // LDL' with unit lower bands l1, l2.
    let (mut l1, mut l2) = (vec![0.0; n], vec![0.0; n]);
    for i in 0..n {
        if i >= 2 {
            l2[i] = second[i - 2] / diagonal[i - 2];
            diagonal[i] -= l2[i] * second[i - 2];
            first[i - 1] -= l1[i - 1] * second[i - 2];
        }
        if i >= 1 {
            l1[i] = first[i - 1] / diagonal[i - 1];
            diagonal[i] -= l1[i] * first[i - 1];
        }
    }
    let mut z: Vec<Vector2<f64>> = given
        .iter()
        .zip(&weights)
        .map(|(point, weight)| *weight * vector(point))
        .collect();
    for i in 1..n {
        z[i] = z[i] - l1[i] * z[i - 1];
        if i >= 2 {
            z[i] = z[i] - l2[i] * z[i - 2];
        }
    }
    for i in (0..n).rev() {
        z[i] /= diagonal[i];
        if i + 1 < n {
            z[i] = z[i] - l1[i + 1] * z[i + 1];
        }
        if i + 2 < n {
            z[i] = z[i] - l2[i + 2] * z[i + 2];
        }
    }
    z.into_iter()
        .map(|z| Point2 { x_m: z.x, y_m: z.y })
        .collect()
}

fn vector(point: &Point2) -> Vector2<f64> {
    Vector2::new(point.x_m, point.y_m)
}

/// A cubic spline through nodes at the parameters 0, 1, 2, ...
#[derive(Debug, Clone)]
pub(super) struct Spline {
    nodes: Vec<Point2>,
    seconds: Vec<[f64; 2]>,
}

impl Spline {
    /// Returns the spline with the slopes given at its ends, or straight there.
    pub(super) fn through(
        nodes: Vec<Point2>,
        start_slope: Option<[f64; 2]>,
        end_slope: Option<[f64; 2]>,
    ) -> Self {
        let seconds = second_derivatives(&nodes, (start_slope, end_slope));
        Self { nodes, seconds }
    }

    /// Returns the largest parameter.
    pub(super) fn end(&self) -> f64 {
        (self.nodes.len() - 1) as f64
    }

    /// Returns a curvature, 1/m, that is exceeded nowhere between a node and the next one.
    pub(super) fn curvature_bound_per_m(&self, node: usize) -> f64 {
        let (a, b) = (&self.nodes[node], &self.nodes[node + 1]);
        let second = |k: usize| {
            self.seconds[node][k]
                .abs()
                .max(self.seconds[node + 1][k].abs())
        };
        let (x, y) = (second(0), second(1));
        let second = (x * x + y * y).sqrt();
        // The slope is that of the chord somewhere, in each coordinate.
        let speed = a.distance_m(b) - second;
        if speed > 0.0 {
            second / (speed * speed)
        } else {
            f64::INFINITY
        }
    }

    /// Returns the distance of a point from the curve, m, where it is nearest around a parameter; the search ends where it
    /// is not farther than `near_m`.
    pub(super) fn distance_m(&self, point: &Point2, parameter: f64, near_m: f64) -> f64 {
        const STEPS: usize = 8;
        /// Smallest step of the parameter.
        const STEP_MIN: f64 = 1e-3;
        let mut parameter = parameter.min(self.end());
        let mut nearest_m = f64::INFINITY;
        for _ in 0..STEPS {
            let here = self.at(parameter);
            nearest_m = nearest_m.min(here.position.distance_m(point));
            let off = [point.x_m - here.position.x_m, point.y_m - here.position.y_m];
            let [x, y] = here.tangent;
            // Not a number where the curve stands still.
            let step = (off[0] * x + off[1] * y) / (x * x + y * y);
            if nearest_m <= near_m || step.is_nan() || step.abs() <= STEP_MIN {
                break;
            }
            parameter = (parameter + step).clamp(0.0, self.end());
        }
        nearest_m
    }

    /// Returns the curve at a parameter.
    pub(super) fn at(&self, parameter: f64) -> CurvePoint {
        let index = (parameter.max(0.0) as usize).min(self.nodes.len() - 2);
        let u = parameter - index as f64;
        let v = 1.0 - u;
        let (a, b) = (&self.nodes[index], &self.nodes[index + 1]);
        let (m, n) = (self.seconds[index], self.seconds[index + 1]);
        let value = |a: f64, b: f64, k: usize| {
            v * a + u * b + ((v * v * v - v) * m[k] + (u * u * u - u) * n[k]) / 6.0
        };
        let slope = |a: f64, b: f64, k: usize| {
            b - a + ((1.0 - 3.0 * v * v) * m[k] + (3.0 * u * u - 1.0) * n[k]) / 6.0
        };
        CurvePoint {
            position: Point2 {
                x_m: value(a.x_m, b.x_m, 0),
                y_m: value(a.y_m, b.y_m, 1),
            },
            tangent: [slope(a.x_m, b.x_m, 0), slope(a.y_m, b.y_m, 1)],
            second: [v * m[0] + u * n[0], v * m[1] + u * n[1]],
        }
    }
}

/// Solves the tridiagonal system of a cubic spline on unit intervals for its second derivatives.
fn second_derivatives(
    nodes: &[Point2],
    slopes: (Option<[f64; 2]>, Option<[f64; 2]>),
) -> Vec<[f64; 2]> {
    let n = nodes.len();
    let slopes = (slopes.0.map(Vector2::from), slopes.1.map(Vector2::from));
    let (mut diagonal, mut upper) = (vec![4.0; n], vec![1.0; n]);
    let mut z = vec![Vector2::zeros(); n];
    for i in 1..n - 1 {
        z[i] = 6.0 * (vector(&nodes[i - 1]) - 2.0 * vector(&nodes[i]) + vector(&nodes[i + 1]));
    }
    let mut lower_last = 1.0;
    match slopes.0 {
        Some(slope) => {
            diagonal[0] = 2.0;
            z[0] = 6.0 * (vector(&nodes[1]) - vector(&nodes[0]) - slope);
        }
        None => {
            diagonal[0] = 1.0;
            upper[0] = 0.0;
        }
    }
    match slopes.1 {
        Some(slope) => {
            diagonal[n - 1] = 2.0;
            z[n - 1] = 6.0 * (slope - vector(&nodes[n - 1]) + vector(&nodes[n - 2]));
        }
        None => {
            diagonal[n - 1] = 1.0;
            lower_last = 0.0;
        }
    }
    for i in 1..n {
        let lower = if i == n - 1 { lower_last } else { 1.0 };
        let factor = lower / diagonal[i - 1];
        diagonal[i] -= factor * upper[i - 1];
        z[i] = z[i] - factor * z[i - 1];
    }
    z[n - 1] /= diagonal[n - 1];
    for i in (0..n - 1).rev() {
        z[i] = (z[i] - upper[i] * z[i + 1]) / diagonal[i];
    }
    z.into_iter().map(Into::into).collect()
}
