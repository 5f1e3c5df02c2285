//! Residuals of dead-reckoned segments with their start poses eliminated.

use super::least_squares::Residuals;
use super::segments::Segment;
use crate::dead_reckoning::StepTilts;
use crate::frames::{Pose, wrap_angle};
use crate::odometry::{KinematicModel, tilts};
use crate::vehicle::Vehicle;

/// Residuals of one pose: x, y, z and yaw.
pub(super) const PER_POSE: usize = 4;

/// Segments, a vehicle with some parameters free, and the weight of each pose.
pub(super) struct Problem<'a> {
    pub(super) segments: &'a [Segment<'a>],
    pub(super) model: KinematicModel,
    /// Puts the free parameters into a vehicle.
    pub(super) vehicle: &'a (dyn Fn(&[f64]) -> Vehicle + Sync),
    /// The attitudes between the rows of every segment, which no parameter changes.
    tilts: Vec<Vec<StepTilts>>,
    /// Weight of every pose of every segment in turn.
    pub(super) weights: Vec<f64>,
    pub(super) pull: Pull<'a>,
}

/// A pull back to the start: nothing against the thousands of poses of logs that determine the
/// parameters, but it keeps undetermined parameters from diverging.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pull<'a> {
    /// Where the search starts.
    pub(super) start: &'a [f64],
    /// Residual for each unit of each parameter away from there, m.
    pub(super) strengths_m: &'a [f64],
}

impl<'a> Problem<'a> {
    pub(super) fn new(
        segments: &'a [Segment<'a>],
        model: KinematicModel,
        vehicle: &'a (dyn Fn(&[f64]) -> Vehicle + Sync),
        pull: Pull<'a>,
    ) -> Self {
        let poses = segments.iter().map(pose_count).sum();
        Self {
            segments,
            model,
            vehicle,
            tilts: segments
                .iter()
                .map(|segment| tilts(segment.rows).collect())
                .collect(),
            weights: vec![1.0; poses],
            pull,
        }
    }

    /// Returns the residuals without their weights, of poses in turn; start poses are weighted ones.
    pub(super) fn unweighted(&self, parameters: &[f64]) -> Vec<[f64; PER_POSE]> {
        let vehicle = (self.vehicle)(parameters);
        let mut residuals = Vec::with_capacity(self.weights.len());
        let mut matched = Vec::new();
        let mut first = 0;
        for (segment, tilts) in self.segments.iter().zip(&self.tilts) {
            let (rows, tilts) = (segment.rows, tilts.iter().copied());
            let estimates = self
                .model
                .dead_reckon_tilted(&vehicle, rows, tilts, Pose::default());
            matched.clear();
            matched.extend(
                segment
                    .rows
                    .iter()
                    .zip(estimates)
                    .filter_map(|(row, relative)| Some((row.pose?, relative))),
            );
            let weights = &self.weights[first..first + matched.len()];
            first += matched.len();
            align(&matched, weights, &mut residuals);
        }
        residuals
    }
}

impl Residuals for Problem<'_> {
    fn residuals(&self, parameters: &[f64]) -> Vec<f64> {
        let pulls = parameters
            .iter()
            .zip(self.pull.start)
            .zip(self.pull.strengths_m)
            .map(|((parameter, start), strength_m)| strength_m * (parameter - start));
        self.unweighted(parameters)
            .iter()
            .zip(&self.weights)
            .flat_map(|(residual, weight)| residual.map(|r| weight.sqrt() * r))
            .chain(pulls)
            .collect()
    }
}

pub(super) fn pose_count(segment: &Segment) -> usize {
    segment.rows.iter().filter(|row| row.pose.is_some()).count()
}

/// Appends what is left between measured and dead-reckoned poses when the latter start at the pose
/// that makes the weighted sum of squares least.
///
/// By (12) a start at yaw psi_0 turns all positions by Rz(psi_0). For a given psi_0 the best position
/// is the difference of the means, so psi_0 alone is searched, by Newton's method from the mean
/// difference of the yaws.
fn align(matched: &[(Pose, Pose)], weights: &[f64], residuals: &mut Vec<[f64; PER_POSE]>) {
    let total: f64 = weights.iter().sum();
    let Some((start, _)) = matched.first() else {
        return;
    };
    // Differences from the first yaw keep clear of the jump at half a turn.
    let yaw_off = |(measured, relative): &(Pose, Pose)| {
        wrap_angle(measured.yaw_rad - relative.yaw_rad - start.yaw_rad)
    };
    let means = weighted_sums(matched, weights, |pair| {
        let (measured, relative) = pair;
        [
            yaw_off(pair),
            measured.x_m,
            measured.y_m,
            measured.z_m,
            relative.x_m,
            relative.y_m,
            relative.z_m,
        ]
    })
    .map(|sum| sum / total);
    let mean_yaw_off = means[0];
    let measured_mean = [means[1], means[2], means[3]];
    let relative_mean = [means[4], means[5], means[6]];
    let centred = |(measured, relative): &(Pose, Pose)| {
        (
            measured.x_m - measured_mean[0],
            measured.y_m - measured_mean[1],
            relative.x_m - relative_mean[0],
            relative.y_m - relative_mean[1],
        )
    };
    let [parallel, crossed] = weighted_sums(matched, weights, |pair| {
        let (mx, my, rx, ry) = centred(pair);
        [mx * rx + my * ry, my * rx - mx * ry]
    });
    let mut yaw = start.yaw_rad + mean_yaw_off;
    for _ in 0..8 {
        let (sin, cos) = yaw.sin_cos();
        let slope = parallel * sin - crossed * cos + total * (yaw - start.yaw_rad - mean_yaw_off);
        let curvature = (parallel * cos + crossed * sin).max(0.0) + total;
        let step = slope / curvature;
        yaw -= step;
        if step.abs() < 1e-13 {
            break;
        }
    }
    let (sin, cos) = yaw.sin_cos();
    for pair in matched {
        let (mx, my, rx, ry) = centred(pair);
        residuals.push([
            cos * rx - sin * ry - mx,
            sin * rx + cos * ry - my,
            pair.1.z_m - relative_mean[2] - (pair.0.z_m - measured_mean[2]),
            yaw - start.yaw_rad - yaw_off(pair),
        ]);
    }
}

/// Returns the weighted sums of values of all pairs, in one pass.
fn weighted_sums<const N: usize>(
    matched: &[(Pose, Pose)],
    weights: &[f64],
    values: impl Fn(&(Pose, Pose)) -> [f64; N],
) -> [f64; N] {
    let mut sums = [0.0; N];
    for (pair, weight) in matched.iter().zip(weights) {
        for (sum, value) in sums.iter_mut().zip(values(pair)) {
            *sum += weight * value;
        }
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sum_of_squares(matched: &[(Pose, Pose)], start: &Pose) -> f64 {
        let (sin, cos) = start.yaw_rad.sin_cos();
        matched
            .iter()
            .map(|(measured, relative)| {
                let errors = [
                    start.x_m + cos * relative.x_m - sin * relative.y_m - measured.x_m,
                    start.y_m + sin * relative.x_m + cos * relative.y_m - measured.y_m,
                    start.z_m + relative.z_m - measured.z_m,
                    wrap_angle(start.yaw_rad + relative.yaw_rad - measured.yaw_rad),
                ];
                errors.iter().map(|e| e * e).sum::<f64>()
            })
            .sum()
    }

    proptest! {
        #[test]
        fn no_other_start_pose_is_better(
            noise in prop::collection::vec((-0.1..0.1f64, -0.1..0.1f64, -0.1..0.1f64), 6),
            yaw_rad in -3.1..3.1f64, dx in -0.01..0.01f64, dy in -0.01..0.01f64, dyaw in -0.01..0.01f64,
        ) {
            let truth = Pose { x_m: 3.0, y_m: -2.0, z_m: 1.0, yaw_rad };
            let (sin, cos) = yaw_rad.sin_cos();
            let matched: Vec<(Pose, Pose)> = noise.iter().enumerate().map(|(i, (a, b, c))| {
                let relative = Pose { x_m: 0.1 * i as f64, y_m: 0.05 * (i * i) as f64, z_m: 0.0,
                    yaw_rad: 0.2 * i as f64 };
                let measured = Pose {
                    x_m: truth.x_m + cos * relative.x_m - sin * relative.y_m + a,
                    y_m: truth.y_m + sin * relative.x_m + cos * relative.y_m + b,
                    z_m: truth.z_m,
                    yaw_rad: wrap_angle(truth.yaw_rad + relative.yaw_rad + c),
                };
                (measured, relative)
            }).collect();
            let mut residuals = Vec::new();
            align(&matched, &[1.0; 6], &mut residuals);
            let best: f64 = residuals.iter().flatten().map(|r| r * r).sum();
            prop_assert!(best <= sum_of_squares(&matched, &truth) + 1e-12);
            // The start that belongs to the residuals of the first pose, and one next to it.
            let start = Pose {
                x_m: matched[0].0.x_m + residuals[0][0],
                y_m: matched[0].0.y_m + residuals[0][1],
                z_m: matched[0].0.z_m + residuals[0][2],
                yaw_rad: matched[0].0.yaw_rad + residuals[0][3],
            };
            prop_assert!((sum_of_squares(&matched, &start) - best).abs() < 1e-9);
            let beside = Pose { x_m: start.x_m + dx, y_m: start.y_m + dy, yaw_rad: start.yaw_rad + dyaw, ..start };
            prop_assert!(best <= sum_of_squares(&matched, &beside) + 1e-12);
        }
    }
}
