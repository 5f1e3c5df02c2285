//! Where across the path the vehicle will be, and how well that is known.
//!
//! The vehicle will be off its plan by the error of the estimate at that time, and by what the estimate will have been
//! corrected by until then, as far as the controller has not answered it. Both are independent of each other. Poses
//! take from the covariance P what it gains, at the rate G in the mean, so that P stays and
//!
//! ```text
//! variance = s (c' P c + (1 + q) integral f_a' G f_a da),   a from 0 to the time ahead
//! ```
//!
//! c is the direction across the path, f_a by how much a correction has changed the distance from the path after the time
//! a: first the commands in flight go on, then the plan's feedback answers. Corrections are those across the path and of
//! the heading.
//!
//! G knows nothing of what drives do with commands and of errors that the model of the estimator has. Most of these come
//! with turning, so q is the mean square of the planned steer over [`STEER_M_S`]^2. s is learned from how far estimates
//! were from earlier predictions; the error of the estimate is in that, so s counts for P, too.

use super::predictions::{AHEAD_S, Ahead, Prediction};
use super::{Controller, Law};
use crate::estimator::{Estimate, bound_of_m};
use crate::mpc::StageTarget;
use crate::path::Point2;
use crate::reference::Progress;
use crate::tracked_point::TrackedPoint;
use nalgebra::{Matrix2, Matrix3, Matrix3x2, Vector2, Vector3};
use sidehill_plant::speeds::TreadSpeeds;

/// Steer at which the model's errors count as much as they do straight ahead, m/s.
const STEER_M_S: f64 = 0.2;

impl Controller {
    /// Returns where the vehicle will be by the plan of this cycle; none at standstill, on a turn on the spot, and of a law or a horizon
    /// that does not plan so far.
    pub(super) fn see_ahead(
        &mut self,
        estimate: &Estimate,
        progress: &Progress,
        elapsed_s: f64,
    ) -> Option<Ahead> {
        self.predictions
            .compare(estimate.time_s, elapsed_s, progress.cross_track_m);
        let tracked_point = self.tracked_point();
        let growth = self.estimator.growth();
        let delay_s = self.drives.response().delay_s;
        let (Law::Mpc(mpc), Some(reference)) = (&mut self.law, &self.reference) else {
            return None;
        };
        // Dead reckoning is certain of a vehicle that stands: G is not that of the plan, which drives away.
        let stands = estimate.treads == TreadSpeeds::default();
        if stands || reference.driven_path().is_none() || !mpc.find_feedback() {
            return None;
        }
        let (mpc, targets) = (&*mpc, &self.horizon.targets);
        let (plan, times) = (mpc.plan()?, mpc.stage_times());
        // What a correction along the path changes is no error across it, in a bend either: it moves the nearest point.
        let start = &self.horizon.start;
        let mut across = across_path(targets.first()?, start.yaw_rad);
        let left = Vector3::new(across.x, across.y, 0.0);
        let turned = Vector3::new(
            estimate.pose.y_m - start.y_m,
            start.x_m - estimate.pose.x_m,
            1.0,
        );
        let mut jumps = [left, turned];
        let mut variance = Integral::new(
            Matrix3x2::from_columns(&[left, Vector3::z()]),
            growth,
            across,
        );
        variance.add(delay_s, changes(&across, &jumps));
        let mut answers = jumps.map(|jump| mpc.answer(jump));
        let (mut way_m, mut to_go_s) = (0.0, AHEAD_S - delay_s);
        let (planned_s, mut steer_squares) = (to_go_s, 0.0);
        for (k, (target, states)) in targets.iter().zip(plan.states.windows(2)).enumerate() {
            let step_s = times.step_s(k);
            let share = (to_go_s / step_s).min(1.0);
            let moved = share * (states[1] - states[0]);
            let state = states[0] + moved;
            way_m += moved.xy().norm();
            for (jump, answer) in jumps.iter_mut().zip(&mut answers) {
                *jump += share * (answer.next()? - *jump);
            }
            across = across_path(target, state.z);
            variance.add(share * step_s, changes(&across, &jumps));
            steer_squares += share * step_s * plan.inputs[k].steer_m_s.powi(2);
            to_go_s -= step_s;
            if to_go_s <= 0.0 {
                let place = place_of(&tracked_point, target, &state);
                let cross_track_m = reference.cross_track_further_m(&place, way_m)?;
                let now_m2 = across.dot(&(estimate.covariance * across));
                let turning = steer_squares / planned_s / STEER_M_S.powi(2);
                let variance_m2 = now_m2 + (1.0 + turning) * variance.sum;
                // Nothing is known better before it happens.
                let bound_m = bound_of_m(self.predictions.share() * variance_m2)
                    .max(estimate.bound_across_m(progress.point.heading_rad));
                self.predictions.add(Prediction {
                    for_s: estimate.time_s + AHEAD_S,
                    cross_track_m,
                    variance_m2,
                });
                return Some(Ahead {
                    cross_track_m,
                    bound_m,
                });
            }
        }
        None
    }
}

/// The integral of f' G f over time by the trapezoidal rule, where f is by how much jumps have changed the distance from
/// the path and G the rate of their covariance.
struct Integral {
    growth: Matrix2<f64>,
    before: f64,
    sum: f64,
}

impl Integral {
    /// Begins with jumps that have just happened; `growth` is the rate of the covariance of (x, y, yaw).
    fn new(jumps: Matrix3x2<f64>, growth: &Matrix3<f64>, across: Vector3<f64>) -> Self {
        let begin = jumps.transpose() * across;
        let growth = jumps.transpose() * growth * jumps;
        Self {
            before: begin.dot(&(growth * begin)),
            growth,
            sum: 0.0,
        }
    }

    fn add(&mut self, time_s: f64, end: Vector2<f64>) {
        let now = end.dot(&(self.growth * end));
        self.sum += 0.5 * time_s * (self.before + now).max(0.0);
        self.before = now;
    }
}

/// Returns the derivatives of the distance from the path by (x, y, yaw) where a target is.
fn across_path(target: &StageTarget, yaw_rad: f64) -> Vector3<f64> {
    let (sin, cos) = target.along_heading_rad.sin_cos();
    let lever = target.tracked_point.lever(&target.normal_in_world, yaw_rad);
    let (x, y) = lever.by_yaw_m;
    Vector3::new(-cos, -sin, -cos * x - sin * y)
}

/// Returns the changes of the distance from the path by what jumps have become.
fn changes(across: &Vector3<f64>, jumps: &[Vector3<f64>; 2]) -> Vector2<f64> {
    Vector2::from(jumps.map(|jump| across.dot(&jump)))
}

fn place_of(point: &TrackedPoint, target: &StageTarget, state: &Vector3<f64>) -> Point2 {
    let (x_m, y_m) = point.lever(&target.normal_in_world, state.z).offset_m;
    Point2 {
        x_m: state.x + x_m,
        y_m: state.y + y_m,
    }
}

#[cfg(test)]
mod tests;
