//! The objective of tuning: the cost of a run relative to the same run with the present settings.

use crate::campaign;
use crate::config::Campaign;
use anyhow::{Context, Result};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;
use sidehill_controller::config::ControllerKind;
use sidehill_plant::statistics::quantile;
use std::ops::Range;

/// Cross-track RMS below which runs count as equal, m.
const ERROR_FLOOR_M: f64 = 0.001;
/// Steer total variation below which runs count as equally calm, m/s.
const STEER_FLOOR_M_S: f64 = 0.1;
/// Cost of a run that no longer completes, and the largest cost or gain of any run: that of ten times the error.
const RUN_COST_MAX: f64 = std::f64::consts::LN_10;

/// Outcome of a run.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Driven {
    /// Whether it completed.
    pub completed: bool,
    /// Cross-track RMS, m.
    pub error_m: f64,
    /// Steer total variation, m/s.
    pub steer_m_s: f64,
}

/// Drives the runs of a campaign with one controller on the current thread pool; outcomes are in order.
///
/// # Errors
/// The run that cannot start and why: invalid settings are not candidates.
pub fn drive(campaign: &Campaign, kind: ControllerKind, runs: Range<u32>) -> Result<Vec<Driven>> {
    runs.into_par_iter()
        .map(|index| {
            let drawn = campaign.draw(index)?;
            let figures = campaign::drive(drawn.scenario, kind)
                .with_context(|| format!("run {index}: cannot start"))?;
            Ok(Driven {
                completed: figures.completed,
                error_m: figures.cross_track_rms_m,
                steer_m_s: figures.steer_total_variation_m_s,
            })
        })
        .collect()
}

/// Returns the cost of a run beside the same run before: ln(error / error before) + `calmness`
/// ln(steer / steer before), 0 where nothing has changed, negative where it is better.
pub fn cost(now: &Driven, before: &Driven, calmness: f64) -> f64 {
    match (now.completed, before.completed) {
        (false, false) => 0.0,
        (false, true) => RUN_COST_MAX,
        (true, false) => -RUN_COST_MAX,
        // NaN is not an improvement.
        (true, true) if now.error_m.is_nan() || now.steer_m_s.is_nan() => RUN_COST_MAX,
        (true, true) => {
            let ratio =
                |now: f64, before: f64, floor: f64| (now.max(floor) / before.max(floor)).ln();
            let error = ratio(now.error_m, before.error_m, ERROR_FLOOR_M);
            let steer = ratio(now.steer_m_s, before.steer_m_s, STEER_FLOOR_M_S);
            (error + calmness * steer).clamp(-RUN_COST_MAX, RUN_COST_MAX)
        }
    }
}

/// Figures of a set of runs with the same settings.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct TrialFigures {
    /// Runs.
    pub runs: usize,
    /// Runs completed.
    pub completed: usize,
    /// Median of the cross-track RMS of completed runs, m.
    pub median_m: f64,
    /// 95 % quantile of it, m.
    pub p95_m: f64,
    /// Median of the steer's total variation of completed runs, m/s.
    pub steer_total_variation_m_s: f64,
}

impl TrialFigures {
    /// Returns the figures of runs; those of errors and steer are 0 where none was completed.
    pub fn of(runs: &[Driven]) -> Self {
        let sorted = |value: fn(&Driven) -> f64| {
            let mut values: Vec<f64> = runs.iter().filter(|run| run.completed).map(value).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let (errors, steers) = (sorted(|run| run.error_m), sorted(|run| run.steer_m_s));
        Self {
            runs: runs.len(),
            completed: errors.len(),
            median_m: quantile(&errors, 0.5).unwrap_or(0.0),
            p95_m: quantile(&errors, 0.95).unwrap_or(0.0),
            steer_total_variation_m_s: quantile(&steers, 0.5).unwrap_or(0.0),
        }
    }
}

/// Two sets of settings compared over the same runs.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TrialComparison {
    /// First run and the one after the last.
    pub runs: Range<u32>,
    /// Under the present settings.
    pub before: TrialFigures,
    /// Under the settings found.
    pub after: TrialFigures,
    /// Mean cost of a run.
    pub cost: f64,
    /// Standard error of that mean.
    pub cost_standard_error: f64,
    /// Share of the runs in which the error is smaller than before.
    pub better: f64,
    /// Cross-track RMS before and after of runs completed both times, m.
    pub errors_m: Vec<[f64; 2]>,
}

impl TrialComparison {
    /// Compares runs with the same ones before.
    pub fn of(runs: Range<u32>, now: &[Driven], before: &[Driven], calmness: f64) -> Self {
        let pairs = || now.iter().zip(before);
        let costs: Vec<f64> = pairs()
            .map(|(now, before)| cost(now, before, calmness))
            .collect();
        let count = costs.len().max(1) as f64;
        let mean = costs.iter().sum::<f64>() / count;
        let squares: f64 = costs.iter().map(|cost| (cost - mean).powi(2)).sum();
        let smaller = pairs().filter(|(now, before)| cost(now, before, 0.0) < 0.0);
        Self {
            runs,
            before: TrialFigures::of(before),
            after: TrialFigures::of(now),
            cost: mean,
            cost_standard_error: (squares / (count - 1.0).max(1.0) / count).sqrt(),
            better: smaller.count() as f64 / count,
            errors_m: pairs()
                .filter(|(now, before)| now.completed && before.completed)
                .map(|(now, before)| [before.error_m, now.error_m])
                .collect(),
        }
    }

    /// Returns whether the runs show an improvement: the mean cost is below 0 with a confidence of 95 %
    /// (one-sided, normal), and no fewer runs are completed.
    pub fn improved(&self) -> bool {
        const ONE_SIDED_95: f64 = 1.645;
        self.cost + ONE_SIDED_95 * self.cost_standard_error < 0.0
            && self.after.completed >= self.before.completed
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn driven(completed: bool, error_m: f64, steer_m_s: f64) -> Driven {
        Driven {
            completed,
            error_m,
            steer_m_s,
        }
    }

    #[test]
    fn a_cost_counts_error_calmness_and_completion() {
        let before = driven(true, 0.02, 5.0);
        assert_eq!(cost(&before, &before, 0.2), 0.0);
        let half = cost(&driven(true, 0.01, 5.0), &before, 0.2);
        assert!((half + 2.0_f64.ln()).abs() < 1e-12);
        let nervous = cost(&driven(true, 0.02, 10.0), &before, 0.2);
        assert!((nervous - 0.2 * 2.0_f64.ln()).abs() < 1e-12);
        // Not completing is worse than any error, and completing is better.
        assert_eq!(cost(&driven(false, 0.001, 1.0), &before, 0.2), RUN_COST_MAX);
        let lost = driven(false, 0.5, 1.0);
        assert_eq!(cost(&before, &lost, 0.2), -RUN_COST_MAX);
        assert_eq!(cost(&lost, &lost, 0.2), 0.0);
        assert_eq!(
            cost(&driven(true, f64::NAN, 5.0), &before, 0.2),
            RUN_COST_MAX
        );
        // Less than a millimetre makes no difference.
        let tiny = driven(true, 1e-5, 5.0);
        assert_eq!(cost(&driven(true, 1e-4, 5.0), &tiny, 0.2), 0.0);
    }

    #[test]
    fn an_improvement_is_one_only_beyond_chance_and_without_a_run_lost() {
        let before = vec![driven(true, 0.02, 5.0); 20];
        let compare = |now: &[Driven]| TrialComparison::of(0..20, now, &before, 0.2);
        let better = vec![driven(true, 0.018, 5.0); 20];
        assert!(compare(&better).improved());
        assert_eq!(compare(&better).better, 1.0);
        assert!(!compare(&before).improved());
        // One run of twenty that is far better proves nothing.
        let mut lucky = before.clone();
        lucky[3].error_m = 0.002;
        assert!(compare(&lucky).cost < 0.0 && !compare(&lucky).improved());
        let mut lost = vec![driven(true, 0.002, 5.0); 20];
        lost[7].completed = false;
        assert!(compare(&lost).cost < -1.0 && !compare(&lost).improved());
    }
}
