//! Arc length along an analytic curve.

use super::{Direction, PathSample, Point2, SAMPLE_STEP_M};
use std::f64::consts::{PI, TAU};

/// An analytic curve at a value of its parameter.
#[derive(Debug, Clone, Copy)]
pub(crate) struct CurvePoint {
    /// Position in the world.
    pub(crate) position: Point2,
    /// First derivative, m per unit of the parameter.
    pub(crate) tangent: [f64; 2],
    /// Second derivative, m per unit squared.
    pub(crate) second: [f64; 2],
}

impl CurvePoint {
    /// Returns |d position/d parameter|.
    pub(crate) fn speed(&self) -> f64 {
        let [x, y] = self.tangent;
        (x * x + y * y).sqrt()
    }

    /// Returns the heading of the direction of travel, rad, in (-pi, pi].
    pub(crate) fn travel_heading_rad(&self) -> f64 {
        (-self.tangent[0]).atan2(self.tangent[1])
    }

    /// Returns the signed curvature, 1/m.
    pub(crate) fn curvature_per_m(&self) -> f64 {
        (self.tangent[0] * self.second[1] - self.tangent[1] * self.second[0]) / self.speed().powi(3)
    }
}

/// Arc length along a curve whose parameter runs from 0 to `end`.
///
/// Where its speed is 0 the samples are not regular, which `Path::from_pieces` refuses.
pub(crate) struct ArcLength<F> {
    curve: F,
    parameter_step: f64,
    lengths_m: Vec<f64>,
}

/// Intervals of a short curve, so that its samples show its bends.
const INTERVALS_MIN: f64 = 8.0;

/// Nodes and weights of the five-point Gauss-Legendre rule on (-1, 1).
const GAUSS: [(f64, f64); 5] = [
    (-0.906_179_845_938_664, 0.236_926_885_056_189_1),
    (-0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683_1, 0.478_628_670_499_366_5),
    (0.906_179_845_938_664, 0.236_926_885_056_189_1),
];

impl<F: Fn(f64) -> CurvePoint> ArcLength<F> {
    /// Tabulates the arc length of `curve` over `intervals` equal intervals of the parameter.
    pub(crate) fn new(curve: F, end: f64, intervals: usize) -> Self {
        let parameter_step = end / intervals as f64;
        let mut table = Self {
            curve,
            parameter_step,
            lengths_m: vec![0.0],
        };
        let mut length_m = 0.0;
        for i in 0..intervals {
            let from = i as f64 * parameter_step;
            length_m += table.quadrature(from, from + parameter_step);
            table.lengths_m.push(length_m);
        }
        table
    }

    /// Returns the whole length, m.
    pub(crate) fn length_m(&self) -> f64 {
        self.lengths_m[self.lengths_m.len() - 1]
    }

    /// Returns the curve at a value of its parameter.
    pub(crate) fn point(&self, parameter: f64) -> CurvePoint {
        (self.curve)(parameter)
    }

    /// Returns the parameter at an arc length, by Newton's method on the tabulated interval.
    pub(crate) fn parameter_at(&self, arc_length_m: f64) -> f64 {
        let index = self
            .lengths_m
            .partition_point(|&length_m| length_m <= arc_length_m)
            .clamp(1, self.lengths_m.len() - 1)
            - 1;
        let from = index as f64 * self.parameter_step;
        // What a parameter far from 0 can resolve.
        let tolerance_m = f64::max(1e-13, 4.0 * f64::EPSILON * arc_length_m);
        let target_m = arc_length_m - self.lengths_m[index];
        let share = target_m / (self.lengths_m[index + 1] - self.lengths_m[index]);
        let mut parameter = if share.is_finite() {
            from + share * self.parameter_step
        } else {
            from
        };
        for _ in 0..8 {
            let error_m = self.quadrature(from, parameter) - target_m;
            let next = parameter - error_m / self.point(parameter).speed();
            // Only where the curve stands still or turns back does a step lead far away.
            let near = (next - from).abs() < 2.0 * self.parameter_step;
            if !near {
                break;
            }
            parameter = next;
            if error_m.abs() < tolerance_m {
                break;
            }
        }
        parameter
    }

    /// Returns samples uniform in arc length, their headings those of a vehicle that drives in
    /// `direction`.
    pub(crate) fn samples(&self, direction: Direction) -> Vec<PathSample> {
        let intervals = (self.length_m() / SAMPLE_STEP_M).ceil().max(INTERVALS_MIN) as usize;
        let step_m = self.length_m() / intervals as f64;
        let mut samples: Vec<PathSample> = Vec::with_capacity(intervals + 1);
        for i in 0..=intervals {
            let point = self.point(self.parameter_at(i as f64 * step_m));
            let heading_rad = match direction {
                Direction::Forward => point.travel_heading_rad(),
                Direction::Reverse => point.travel_heading_rad() - PI,
            };
            let turns = samples.last().map_or(0.0, |before| {
                ((before.heading_rad - heading_rad) / TAU).round()
            });
            samples.push(PathSample {
                position: point.position,
                heading_rad: heading_rad + turns * TAU,
                curvature_per_m: point.curvature_per_m(),
            });
        }
        samples
    }

    fn quadrature(&self, from: f64, to: f64) -> f64 {
        let (middle, half) = (0.5 * (from + to), 0.5 * (to - from));
        GAUSS
            .iter()
            .map(|(node, weight)| weight * self.point(middle + half * node).speed())
            .sum::<f64>()
            * half
    }
}
