//! The result of a run: one row per control cycle, and its figures.

use serde::Serialize;
use sidehill_controller::closed_loop::LapFigures;
use sidehill_controller::controller::{Ahead, Status};
use sidehill_controller::estimator::ContactEstimate;
use sidehill_controller::guard::{Margins, SteepPlace};
use sidehill_controller::memory::Learned;
use sidehill_controller::mpc::SolvePath;
use sidehill_plant::frames::{Attitude, PlanarPose, Pose};
use sidehill_plant::icr::TreadIcrs;
use sidehill_plant::speeds::{MeasuredTreadSpeeds, MotorSpeeds};
use sidehill_plant::statistics::quantile;

/// One control cycle, with the truth at its beginning.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Instant, s.
    pub time_s: f64,
    /// True pose.
    pub pose: Pose,
    /// True roll and pitch.
    pub attitude: Attitude,
    /// Estimated position and heading; none before the first estimate.
    pub estimate: Option<PlanarPose>,
    /// Bound that the estimated position across the path keeps with a probability of 95 %, m.
    pub cross_track_bound_m: Option<f64>,
    /// Predicted distance from the path in 2 s and its bound, if there is a plan.
    pub ahead: Option<Ahead>,
    /// Reference position and heading.
    pub reference: PlanarPose,
    /// True position of the tracked point, X_g and Y_g, m, if it is not the origin.
    pub tracked: Option<[f64; 2]>,
    /// True distance of the tracked point from the path, m, left positive.
    pub cross_track_m: f64,
    /// True distance by which the vehicle is ahead of the reference along the path, m.
    pub along_track_m: f64,
    /// True heading less that of the reference, rad.
    pub heading_error_rad: f64,
    /// Measurements of the steepness guard, if it is on.
    pub slope: Option<SlopeRow>,
    /// Command given in this cycle.
    pub command: MotorSpeeds,
    /// True motor speeds.
    pub motors: MotorSpeeds,
    /// Tread speeds as perfect encoders count them, before c_l and c_r.
    pub tread_speeds: MeasuredTreadSpeeds,
    /// Tread ICRs of ICRIK at the true attitude and speeds.
    pub icrs: TreadIcrs,
    /// Learned parameters of a contact vehicle; none for controllers that learn something else.
    pub contact: Option<ContactEstimate>,
    /// Status of the command.
    pub status: Status,
    /// Linear systems factorised and interior-point iterations; 0 without a QP.
    pub qp_iterations: u32,
    /// How the QP was solved; none without one.
    pub qp_path: Option<SolvePath>,
    /// Time within the QP solver, us; 0 without a QP.
    pub solve_us: f64,
    /// Time from estimate to command, us.
    pub cycle_us: f64,
}

impl Row {
    /// Returns whether the true position is within the estimate's bound across the path; none without an estimate.
    pub(crate) fn holds_bound(&self) -> Option<bool> {
        let (estimate, bound_m) = self.estimate.zip(self.cross_track_bound_m)?;
        let (sin, cos) = self.reference.yaw_rad.sin_cos();
        let off_m = (estimate.x_m - self.pose.x_m) * cos + (estimate.y_m - self.pose.y_m) * sin;
        Some(off_m.abs() <= bound_m)
    }
}

/// Returns `waiting`, `tracking`, `fallback`, `stopping` or `finished`, and why for the two that need a reason.
pub fn status_words(status: Status) -> (&'static str, String) {
    match status {
        Status::Waiting => ("waiting", String::new()),
        Status::Tracking => ("tracking", String::new()),
        Status::Fallback { reason, .. } => ("fallback", reason.to_string()),
        Status::Stopping(reason) => ("stopping", reason.to_string()),
        Status::Finished => ("finished", String::new()),
    }
}

/// Quantiles of a time, us.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Quantiles {
    /// Median.
    pub p50: f64,
    /// 99 % quantile.
    pub p99: f64,
    /// 99.9 % quantile.
    pub p999: f64,
    /// Largest.
    pub max: f64,
}

impl Quantiles {
    /// Returns the quantiles of `values` by the nearest rank; zeros where there are none.
    pub fn of(mut values: Vec<f64>) -> Self {
        values.sort_by(f64::total_cmp);
        let at = |share| quantile(&values, share).unwrap_or(0.0);
        Self {
            p50: at(0.5),
            p99: at(0.99),
            p999: at(0.999),
            max: at(1.0),
        }
    }
}

/// The figures of one run, as `simulate --format json` prints them. Errors and the steer command count
/// after the first 2 s, in which the vehicle starts moving.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Controller's name.
    pub controller: String,
    /// Plant's name: icrik or contact.
    pub plant: String,
    /// Scenario's name.
    pub scenario: String,
    /// Seed.
    pub seed: u64,
    /// Whether the reference was followed to its end.
    pub completed: bool,
    /// The reason, if it was not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended_by: Option<String>,
    /// Root mean square of the distance from the path, m.
    pub cross_track_rms_m: f64,
    /// 95 % quantile of its absolute value, m.
    pub cross_track_p95_m: f64,
    /// Largest absolute value, m.
    pub cross_track_max_m: f64,
    /// Share of the cycles after the first 2 s in which the true position was within the estimate's bound across the path,
    /// which it should be in 95 %; none without an estimate.
    #[serde(skip)]
    pub cross_track_bound_held: Option<f64>,
    /// The same of the distance from the path 2 s later and the bound of its prediction; none without a prediction.
    #[serde(skip)]
    pub cross_track_ahead_bound_held: Option<f64>,
    /// Root mean square of the origin's distance from the path, m, if another point is tracked.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub origin_cross_track_rms_m: Option<f64>,
    /// Root mean square of the error along the path, m.
    pub along_track_rms_m: f64,
    /// Figures of each lap, where there are several.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub laps: Vec<LapFigures>,
    /// Summary of the steepness guard, if it is on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub guard: Option<GuardSummary>,
    /// Root mean square of the difference from the path's heading, rad.
    pub heading_rms_rad: f64,
    /// Sum of the absolute changes of the steer command, m/s.
    pub steer_total_variation_m_s: f64,
    /// Distance from the end of the path at the end, m.
    pub goal_error_m: f64,
    /// Distance travelled in plan over the time of the run, m/s.
    pub mean_speed_m_s: f64,
    /// Time of the run, s.
    pub time_s: f64,
    /// Largest effective speed of a tread, m/s.
    pub tread_speed_max_m_s: f64,
    /// Commands outside bounds or rates.
    pub constraint_violations: u32,
    /// Cycles that drove on the previous plan.
    pub fallbacks: u32,
    /// Cycles that took longer than the control period.
    pub deadline_misses: u32,
    /// Mean of the QP's iterations.
    pub qp_iterations_mean: f64,
    /// Cycles whose QP was solved by the active-set method.
    pub qp_working_set: u32,
    /// Cycles whose QP needed the interior-point method.
    pub qp_interior_point: u32,
    /// Cycles whose solve was cut short, with a plan that respects the limits.
    pub qp_cut_short: u32,
    /// Time within the QP solver, us.
    pub solve_us: Quantiles,
    /// Time from estimate to command, us.
    pub cycle_us: Quantiles,
}

/// Measurements of the steepness guard in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlopeRow {
    /// True tip-over margin and use of friction.
    pub margins: Margins,
    /// Share of the reference's speed that is driven.
    pub speed_share: f64,
    /// Distance along the path, m.
    pub arc_length_m: f64,
}

/// Summary of the steepness guard over a run; margins are those of the true attitude and motion.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct GuardSummary {
    /// Least tip-over margin.
    pub rollover_margin_min: f64,
    /// Largest use of friction.
    pub friction_use_max: f64,
    /// Largest angle between the vehicle's up axis and the vertical, deg.
    pub tilt_max_deg: f64,
    /// Least share of the reference's speed.
    pub speed_share_min: f64,
    /// Time from the first announcement of the steep place to the stop, s.
    pub warned_s: Option<f64>,
    /// Place before which the vehicle stopped, or for which the route was refused.
    pub stopped_before: Option<SteepPlace>,
}

/// A complete run of one controller.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Its figures.
    pub summary: Summary,
    /// Its cycles.
    pub rows: Vec<Row>,
    /// What was learned, if it is kept.
    pub learned: Option<Learned>,
}
