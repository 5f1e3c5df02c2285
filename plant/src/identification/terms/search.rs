//! The search for the terms, and how a model is judged.

use super::super::fit::{FitStage, PULL_ICRS_M, PULL_SLIDE_M};
use super::super::problem::{Problem, Pull};
use super::super::segments::{Segment, SegmentErrors};
use super::super::statistics::{confidence_factor, covariance, parameters_without};
use super::term::{Term, TermReport, Verdict};
use crate::extension::{Extension, ExtensionGains};
use crate::odometry::KinematicModel;
use crate::vehicle::Vehicle;
use nalgebra::{DMatrix, DVector};

/// Folds, each held out once.
pub(super) const FOLDS: usize = 10;
/// Student's 95 % quantile, one-sided, for one degree of freedom less than folds.
const STUDENT_95: f64 = 1.833;
/// Consecutive segments that are in one fold.
const RUN: usize = 3;
/// Smallest fall of the mean held-out misfit that makes a term worth having, as a share of it.
pub(super) const IMPROVEMENT_MIN: f64 = 0.001;
/// Half widths of its 95 % interval by which a gain must be above 0: 99.7 % confidence.
pub(super) const CLEAR: f64 = 1.5;
/// Parameters of ICRHK: c_l, c_r and the ICRs.
const BASE: usize = 5;

/// A model fitted to all segments, and its errors on each when its fold was held out.
pub(super) struct JudgedTerm {
    pub(super) terms: Vec<Term>,
    pub(super) parameters: Vec<f64>,
    half_widths: Vec<Option<f64>>,
    errors: Vec<[f64; 3]>,
    misfits_m: Vec<f64>,
}

impl JudgedTerm {
    pub(super) fn pooled(&self) -> SegmentErrors {
        SegmentErrors::of_errors(&self.errors)
    }

    /// Returns the fall of the mean held-out misfit against `other`, as a share, and how far it is from
    /// its one-sided 95 % bound over the folds.
    fn gain_over(&self, other: &Self) -> (f64, f64) {
        let count = self.misfits_m.len();
        let mean = other.misfits_m.iter().sum::<f64>() / count as f64;
        let mut gains = [0.0; FOLDS];
        let differences = other.misfits_m.iter().zip(&self.misfits_m);
        for (index, (before, after)) in differences.enumerate() {
            gains[fold_of(index)] += (before - after) / mean * FOLDS as f64 / count as f64;
        }
        let folds = FOLDS as f64;
        let gain = gains.iter().sum::<f64>() / folds;
        let variance = gains.iter().map(|g| (g - gain).powi(2)).sum::<f64>() / (folds - 1.0);
        (gain, STUDENT_95 * (variance / folds).sqrt())
    }
}

fn fold_of(segment: usize) -> usize {
    segment / RUN % FOLDS
}

pub(super) struct Search<'a> {
    pub(super) segments: &'a [Segment<'a>],
    pub(super) vehicle: &'a Vehicle,
}

impl Search<'_> {
    /// Adds terms to ICRHK as long as one is supported.
    pub(super) fn select(
        &self,
        candidates: &[Term],
        icrhk: &JudgedTerm,
    ) -> (JudgedTerm, Vec<TermReport>) {
        let mut model = self.judge(&[], &icrhk.parameters);
        let mut chosen: Vec<TermReport> = Vec::new();
        // Terms that were supported in a round without being the best.
        let mut rivals: Vec<Term> = Vec::new();
        let mut creep = false;
        loop {
            let rest = candidates
                .iter()
                .filter(|term| !model.terms.contains(term) && term.may_follow(&model.terms, creep));
            let mut tried: Vec<(JudgedTerm, TermReport)> = rest
                .map(|term| {
                    let mut terms = model.terms.clone();
                    terms.push(*term);
                    let larger = self.judge(&terms, &model.parameters);
                    let (improvement, improvement_half_width) = larger.gain_over(&model);
                    let value = larger.parameters.last().copied().unwrap_or(0.0);
                    let half_width = larger.half_widths.last().copied().flatten();
                    let determined = half_width.is_some_and(|width| CLEAR * width < value);
                    let clear = determined && improvement >= IMPROVEMENT_MIN;
                    let fitted = self.vehicle_with(&terms, &larger.parameters);
                    let verdict = match (value < 0.0, clear, fitted.validated()) {
                        (true, _, _) => Verdict::Negative { value },
                        (false, false, _) => Verdict::NotSupported,
                        (false, true, Err(reason)) => Verdict::OutOfRange { reason },
                        (false, true, Ok(_)) => Verdict::Supported { value, half_width },
                    };
                    let report = TermReport {
                        term: *term,
                        improvement,
                        improvement_half_width,
                        verdict,
                    };
                    (larger, report)
                })
                .collect();
            let supported =
                |report: &TermReport| matches!(report.verdict, Verdict::Supported { .. });
            // A term that lost its support when the last one was added describes the same effect as that one.
            for (_, report) in &mut tried {
                if let Some(last) = chosen.last()
                    && rivals.contains(&report.term)
                    && !supported(report)
                {
                    report.verdict = Verdict::NotToldApart { instead: last.term };
                }
            }
            let best = tried
                .iter()
                .enumerate()
                .filter(|(_, (_, report))| supported(report))
                .max_by(|(_, (_, a)), (_, (_, b))| a.improvement.total_cmp(&b.improvement))
                .map(|(index, _)| index);
            let Some(best) = best else {
                if !creep {
                    creep = true;
                    continue;
                }
                for report in &mut chosen {
                    let place = model.terms.iter().position(|term| *term == report.term);
                    if let Some(place) = place {
                        report.verdict = Verdict::Supported {
                            value: model.parameters[BASE + place],
                            half_width: model.half_widths[BASE + place],
                        };
                    }
                }
                chosen.extend(tried.into_iter().map(|(_, report)| report));
                return (model, chosen);
            };
            rivals = tried
                .iter()
                .filter(|(_, report)| supported(report))
                .map(|(_, report)| report.term)
                .collect();
            let (larger, report) = tried.swap_remove(best);
            model = larger;
            chosen.push(report);
        }
    }

    /// Fits ICRHK with `terms` to all segments and predicts each fold with what the others say.
    /// `start` has the parameters of a smaller model.
    pub(super) fn judge(&self, terms: &[Term], start: &[f64]) -> JudgedTerm {
        let own = self.own();
        let start: Vec<f64> = (0..BASE + terms.len())
            .map(|i| start.get(i).or(own.get(i)).copied().unwrap_or(0.0))
            .collect();
        let pull: Vec<f64> = (0..start.len())
            .map(|i| if i < BASE { PULL_ICRS_M } else { PULL_SLIDE_M })
            .collect();
        let names: Vec<&'static str> = vec![""; start.len()];
        let vehicle_with = |parameters: &[f64]| self.vehicle_with(terms, parameters);
        let stage = FitStage {
            names: &names,
            model: KinematicModel::Extended,
            baseline: KinematicModel::Icrhk,
            vehicle_with: &vehicle_with,
            pull_m: &pull,
        };
        let fit = stage.fit(self.segments, &start);
        let clusters = fit.clusters(self.segments);
        let factor = confidence_factor(self.segments.len() - fit.parameters.len());
        let spread = covariance(&clusters);
        let half_widths = (0..start.len())
            .map(|i| Some(factor * spread.as_ref()?[(i, i)].sqrt()))
            .collect();

        let size = start.len();
        let mut normal = DMatrix::from_diagonal(&DVector::from_iterator(
            size,
            pull.iter().map(|strength| strength * strength),
        ));
        for cluster in &clusters {
            normal += cluster.jacobian.tr_mul(&cluster.jacobian);
        }
        let mut errors = vec![[0.0; 3]; self.segments.len()];
        let mut misfits_m = vec![0.0; self.segments.len()];
        for fold in 0..FOLDS {
            let held_out = || (0..self.segments.len()).filter(|i| fold_of(*i) == fold);
            let left_out = held_out().map(|index| &clusters[index]);
            let parameters = parameters_without(&fit.parameters, &normal, left_out);
            let vehicle = vehicle_with(&parameters);
            for index in held_out() {
                let segment = &self.segments[index];
                errors[index] = segment
                    .end_error(&vehicle, KinematicModel::Extended)
                    .unwrap_or_default();
                misfits_m[index] = misfit_m(segment, &vehicle);
            }
        }
        JudgedTerm {
            terms: terms.to_vec(),
            parameters: fit.parameters,
            half_widths,
            errors,
            misfits_m,
        }
    }

    fn own(&self) -> [f64; BASE] {
        let v = self.vehicle;
        [
            v.encoder_scale.left,
            v.encoder_scale.right,
            v.icrs.left_m,
            v.icrs.right_m,
            v.icrs.forward_m,
        ]
    }

    /// Returns the extension with ICRHK's parameters first in `parameters` and then a gain for each term.
    pub(super) fn extension(&self, terms: &[Term], parameters: &[f64]) -> Extension {
        let mut extension = Extension {
            gains: ExtensionGains::default(),
            icrs: self.vehicle.icrs,
            slide: self.vehicle.on_level_ground().slide,
            encoder_scale: self.vehicle.encoder_scale,
        };
        if let [left, right, icr_left, icr_right, icr_forward, gains @ ..] = parameters {
            extension.encoder_scale.left = *left;
            extension.encoder_scale.right = *right;
            extension.icrs.left_m = *icr_left;
            extension.icrs.right_m = *icr_right;
            extension.icrs.forward_m = *icr_forward;
            for (term, gain) in terms.iter().zip(gains) {
                *term.gain(&mut extension) = *gain;
            }
        }
        extension
    }

    fn vehicle_with(&self, terms: &[Term], parameters: &[f64]) -> Vehicle {
        Vehicle {
            extension: Some(self.extension(terms, parameters)),
            ..self.vehicle.clone()
        }
    }
}

/// Returns the root mean square distance of a segment's poses from those dead-reckoned from the start
/// that fits best.
fn misfit_m(segment: &Segment, vehicle: &Vehicle) -> f64 {
    let segments = std::slice::from_ref(segment);
    let pull = Pull {
        start: &[],
        strengths_m: &[],
    };
    let same = |_: &[f64]| vehicle.clone();
    let residuals = Problem::new(segments, KinematicModel::Extended, &same, pull).unweighted(&[]);
    let squares: f64 = residuals
        .iter()
        .map(|[x, y, z, _]| x * x + y * y + z * z)
        .sum();
    (squares / residuals.len().max(1) as f64).sqrt()
}
