//! How far to trust an identification: the steepest slope on which to drive with it.

use super::found::{Found, StageResult};
use super::logs::{LEVEL_DEG, Logs};
use super::report::contact_finding;
use serde::Serialize;
use sidehill_plant::identification::{ContactReport, Warning};
use sidehill_plant::vehicle::Vehicle;
use std::fmt;

/// Slide that may remain unpredicted, m/s.
const SLIDE_M_S: f64 = 0.02;
/// Turn rate at which it is judged, rad/s: a path with a radius of 1.7 m at 0.5 m/s.
const TURN_RAD_S: f64 = 0.3;
/// Half width assumed for a slide gain that no logs determine, s/rad.
const UNKNOWN_S_PER_RAD: f64 = 1.0;
/// Extrapolation beyond the slope of the logs, deg.
const STEEPER_DEG: f64 = 5.0;
/// Steepest slope of any verdict, deg: the controllers were tested up to it.
const SLOPE_MAX_DEG: f64 = 20.0;
/// Largest interval of a tread ICR, as a share of the distance between both.
const ICR_SHARE: f64 = 0.05;
/// Largest distance of c_l and c_r from 1.
const SCALE: f64 = 0.05;
/// Largest held-out lateral error, as a share of that without the stage.
const HELD_OUT_SHARE: f64 = 0.8;
/// Largest share of poses that are far off.
const FAR_OFF_SHARE: f64 = 0.05;

/// The steepest slope for which an identification is good enough, and why.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(super) struct SlopeVerdict {
    /// 0 where it is not good enough to drive at all, deg.
    max_slope_deg: f64,
    /// Reasons for the limit, and remedies.
    reasons: Vec<String>,
}

impl SlopeVerdict {
    /// Judges the results from `logs`; `vehicle` is the identified vehicle.
    pub(super) fn of(found: &Found, vehicle: &Vehicle, logs: &Logs) -> Self {
        let mut verdict = Self {
            max_slope_deg: SLOPE_MAX_DEG,
            reasons: Vec::new(),
        };
        for log in logs.level.iter().chain(&logs.slope) {
            for suspicion in log.suspicions() {
                verdict.limit(0.0, suspicion.to_string());
            }
        }
        match &found.level {
            Some(level) => verdict.judge_level(level, vehicle),
            None => verdict.limit(
                LEVEL_DEG + 2.0,
                "no level logs: ICRs, c_l and c_r are those of the --vehicle file".to_owned(),
            ),
        }
        verdict.judge_slope(found.slope.as_ref(), vehicle);
        if !logs.slope.is_empty() {
            verdict.judge_steepness(logs);
        }
        verdict.max_slope_deg = verdict.max_slope_deg.floor();
        verdict
    }

    /// Limits the slope to `slope_deg` for a reason. The reason is kept even if the limit is already lower.
    fn limit(&mut self, slope_deg: f64, reason: String) {
        self.max_slope_deg = self.max_slope_deg.min(slope_deg);
        if !self.reasons.contains(&reason) {
            self.reasons.push(reason);
        }
    }

    fn judge_level(&mut self, level: &StageResult, vehicle: &Vehicle) {
        let names: Vec<&str> = level.undetermined.iter().map(|u| u.estimate.name).collect();
        if !names.is_empty() {
            self.limit(
                0.0,
                format!(
                    "the level logs do not determine {}: drive straight, wide and narrow turns, both ways",
                    names.join(", ")
                ),
            );
        }
        self.judge_fit("level", level, 0.0);
        let distance_m = vehicle.icrs.right_m - vehicle.icrs.left_m;
        let icrs = level.report.estimates.iter();
        let widest_m = icrs
            .filter(|estimate| estimate.name.starts_with("x_icr"))
            .filter_map(|estimate| estimate.half_width)
            .fold(0.0, f64::max);
        if widest_m > ICR_SHARE * distance_m {
            self.limit(
                LEVEL_DEG + 2.0,
                format!(
                    "the tread ICRs are known to +- {widest_m:.3} m only, more than 5 % of their distance"
                ),
            );
        }
        let scale = &vehicle.encoder_scale;
        for (name, factor) in [("c_l", scale.left), ("c_r", scale.right)] {
            if (factor - 1.0).abs() > SCALE {
                self.limit(
                    LEVEL_DEG + 2.0,
                    format!(
                        "{name} is {factor:.3}: check the wheel radius and how far the wheels slip"
                    ),
                );
            }
        }
    }

    fn judge_slope(&mut self, slope: Option<&StageResult>, vehicle: &Vehicle) {
        let half_width = |name: &str| {
            let Some(stage) = slope else {
                return UNKNOWN_S_PER_RAD;
            };
            let estimates = stage.report.estimates.iter();
            let all = estimates.chain(stage.undetermined.iter().map(|u| &u.estimate));
            let found = all.into_iter().find(|estimate| estimate.name == name);
            // A gain set to 0 has no estimate.
            found.map_or(0.0, |found| found.half_width.unwrap_or(UNKNOWN_S_PER_RAD))
        };
        let (shift, aggravated) = (
            half_width("lambda_1_s_per_rad"),
            half_width("lambda_2_s_per_rad"),
        );
        // Equations (9) and (10): the slide has lambda_1, along the vehicle also half of lambda_2.
        let gain = shift.hypot(0.5 * aggravated);
        let slope_rad = SLIDE_M_S / (vehicle.speed_max_m_s * gain * TURN_RAD_S).max(1e-9);
        let slope_deg = slope_rad.to_degrees();
        if slope.is_none() {
            self.limit(
                LEVEL_DEG.min(slope_deg),
                "no slope logs: lambda_1 and lambda_2 are those of the --vehicle file".to_owned(),
            );
        } else if slope_deg < SLOPE_MAX_DEG {
            self.limit(
                slope_deg,
                format!(
                    "the intervals of lambda_1 (+- {shift:.2}) and lambda_2 (+- {aggravated:.2}) leave {:.0} cm/s \
                     of slide open there: log more turning with the nose up, down and across, on a steeper slope",
                    100.0 * SLIDE_M_S
                ),
            );
        }
        if let Some(stage) = slope {
            self.judge_fit("slope", stage, LEVEL_DEG);
        }
    }

    /// Whether a stage predicts what it was not fitted to; otherwise the slope is `slope_deg`.
    fn judge_fit(&mut self, name: &str, stage: &StageResult, slope_deg: f64) {
        if stage.report.warnings.contains(&Warning::NotSettled) {
            self.limit(
                0.0,
                format!(
                    "the search for the parameters of the {name} logs did not settle, so they are not those that fit \
                     best: log longer and more varied"
                ),
            );
        }
        let held_out = &stage.report.cross_validation;
        let (fitted_m, baseline_m) = (held_out.fitted.lateral_m, held_out.baseline.lateral_m);
        if fitted_m > HELD_OUT_SHARE * baseline_m {
            self.limit(
                slope_deg,
                format!(
                    "on held-out segments of the {name} logs the lateral error is {fitted_m:.3} m, without this \
                     stage {baseline_m:.3} m: there is too little to learn in them, or they do not fit the model"
                ),
            );
        }
        let far_off = stage.report.outlier_share;
        if far_off > FAR_OFF_SHARE {
            self.limit(
                2.0 * LEVEL_DEG + 4.0,
                format!(
                    "{:.0} % of the {name} logs' poses are far off: check the localisation and its delay",
                    100.0 * far_off
                ),
            );
        }
    }

    /// Names what is wrong with the contact vehicle; the two stages stay as good as they are.
    pub(super) fn judge_contact(&mut self, report: &ContactReport) {
        if !report.settled {
            self.reasons.push(
                "the search for the contact vehicle did not settle: contact-mpc starts from geometry alone".to_owned(),
            );
        } else if !report.is_nearer() {
            self.reasons
                .push(format!("contact vehicle: {}", contact_finding(report)));
        }
    }

    fn judge_steepness(&mut self, logs: &Logs) {
        let mut tilts_deg: Vec<f64> = logs
            .slope
            .iter()
            .flat_map(|log| log.rows())
            .map(|row| {
                let attitude = &row.attitude;
                attitude.roll_rad.hypot(attitude.pitch_rad).to_degrees()
            })
            .collect();
        tilts_deg.sort_by(f64::total_cmp);
        let logged_deg = sidehill_plant::statistics::quantile(&tilts_deg, 0.5).unwrap_or(0.0);
        if logged_deg + STEEPER_DEG < SLOPE_MAX_DEG {
            self.limit(
                logged_deg + STEEPER_DEG,
                format!("the slope logs were made on {logged_deg:.1} deg"),
            );
        }
    }
}

impl fmt::Display for SlopeVerdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.max_slope_deg {
            0.0 => writeln!(f, "verdict: not good enough to drive")?,
            slope_deg => writeln!(
                f,
                "verdict: good enough to drive at up to {slope_deg:.0} deg"
            )?,
        }
        for reason in &self.reasons {
            writeln!(f, "  - {reason}")?;
        }
        Ok(())
    }
}
