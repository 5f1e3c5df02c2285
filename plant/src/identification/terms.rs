//! Which terms beyond ICRHK a set of logs supports: forward selection by cross-validation over blocks.
//!
//! Segments are dealt out to [`FOLDS`] folds in runs of [`RUN`], so that what lies close in time is held
//! out together and every fold has some of each kind of driving. A model is fitted to all segments; its
//! parameters without a fold follow by one Gauss-Newton step on the rest, and predict the fold.
//!
//! Starting from ICRHK, the term is added whose model lowers the held-out misfit most, as long as the
//! fall is at least [`IMPROVEMENT_MIN`] and above 0 with 95 % confidence over the folds, and the 95 %
//! interval of the gain over the segments is above 0. The misfit of a segment is the root mean square distance of its poses from those dead-reckoned from the best start.
//! Creep is tried when nothing else is left. All parameters are fitted again with each set of terms.

use super::fit::{
    IdentificationError, IdentificationSettings, PULL_ICRS_M, PULL_SLIDE_M, Stage, cut, smoothed,
};
use super::problem::{Problem, Pull};
use super::segments::{Segment, SegmentErrors};
use super::statistics::{confidence_factor, covariance};
use crate::extension::{Extension, ExtensionGains};
use crate::log::DriveLog;
use crate::odometry::KinematicModel;
use crate::vehicle::Vehicle;
use nalgebra::{DMatrix, DVector};

/// Folds, each held out once.
const FOLDS: usize = 10;
/// Student's 95 % quantile, one-sided, for one degree of freedom less than folds.
const STUDENT_95: f64 = 1.833;
/// Consecutive segments that are in one fold.
const RUN: usize = 3;
/// Smallest fall of the mean held-out misfit that makes a term worth having, as a share of it.
const IMPROVEMENT_MIN: f64 = 0.001;
/// Parameters of ICRHK: c_l, c_r and the ICRs.
const BASE: usize = 5;

/// A term that a model may have beyond ICRHK.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Term {
    /// lambda_1 of ICRIK.
    Slide,
    /// lambda_2 of ICRIK.
    AggravatedSlide,
    /// kappa, slip outward in turns.
    OutwardSlip,
    /// b, loss of forward speed in turns.
    TurnLoss,
    /// c, creep downhill in proportion to speed.
    CreepShare,
    /// d, creep downhill at any speed.
    Creep,
}

impl Term {
    const ALL: [Self; 6] = [
        Self::OutwardSlip,
        Self::TurnLoss,
        Self::Slide,
        Self::AggravatedSlide,
        Self::CreepShare,
        Self::Creep,
    ];

    /// Returns its key in the vehicle's YAML.
    pub fn key(self) -> &'static str {
        match self {
            Self::Slide => "lambda_1_s_per_rad",
            Self::AggravatedSlide => "lambda_2_s_per_rad",
            Self::OutwardSlip => "outward_slip_s",
            Self::TurnLoss => "turn_loss_s_per_rad",
            Self::CreepShare => "creep_per_rad",
            Self::Creep => "creep_m_s_per_rad",
        }
    }

    /// Returns whether the term acts on a slope only.
    pub fn needs_slope(self) -> bool {
        !matches!(self, Self::OutwardSlip | Self::TurnLoss)
    }

    /// Returns whether it is tried beside `terms`: lambda_2 aggravates the slide of lambda_1, and creep
    /// comes last, as turns of one rate alone cannot tell it from the slide.
    fn may_follow(self, terms: &[Self], creep: bool) -> bool {
        match self {
            Self::AggravatedSlide => terms.contains(&Self::Slide),
            Self::CreepShare | Self::Creep => creep,
            Self::OutwardSlip | Self::TurnLoss | Self::Slide => true,
        }
    }

    fn gain(self, extension: &mut Extension) -> &mut f64 {
        match self {
            Self::Slide => &mut extension.slide.shift_s_per_rad,
            Self::AggravatedSlide => &mut extension.slide.aggravated_s_per_rad,
            Self::OutwardSlip => &mut extension.gains.outward_slip_s,
            Self::TurnLoss => &mut extension.gains.turn_loss_s_per_rad,
            Self::CreepShare => &mut extension.gains.creep_per_rad,
            Self::Creep => &mut extension.gains.creep_m_s_per_rad,
        }
    }
}

/// What the logs say of a term.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Verdict {
    /// It is in the extended model.
    Supported {
        /// Its gain, in the unit of its key.
        value: f64,
        /// Half width of the 95 % confidence interval; none where the logs do not determine it.
        half_width: Option<f64>,
    },
    /// It would have been supported until `instead`, which explains the same better, was added.
    NotToldApart {
        /// The term that was added.
        instead: Term,
    },
    /// It would act against its sense.
    Negative {
        /// What the fit gave.
        value: f64,
    },
    /// It does not lower the held-out error, or not beyond chance.
    NotSupported,
}

/// A term, what adding it to the other supported terms gains, and the verdict.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TermReport {
    /// The term.
    pub term: Term,
    /// Fall of the mean held-out misfit, as a share of it: of a supported term when it was added, of
    /// another if it were added to the extended model.
    pub improvement: f64,
    /// How far its one-sided 95 % bound over the folds is below it.
    pub improvement_half_width: f64,
    /// What follows.
    pub verdict: Verdict,
}

/// What logs say of terms beyond ICRHK. Errors are those at the end of held-out segments, each model
/// fitted with its own parameters.
#[derive(Debug, Clone, PartialEq)]
pub struct ExtensionReport {
    /// Segments used.
    pub segments: usize,
    /// Of ICRHK.
    pub icrhk: SegmentErrors,
    /// Of ICRIK; none where no slope was driven.
    pub icrik: Option<SegmentErrors>,
    /// Of the model of all supported terms.
    pub extended: SegmentErrors,
    /// Every term that was tried.
    pub terms: Vec<TermReport>,
}

/// A model fitted to all segments, and its errors on each when its fold was held out.
struct Judged {
    terms: Vec<Term>,
    parameters: Vec<f64>,
    half_widths: Vec<Option<f64>>,
    errors: Vec<[f64; 3]>,
    misfits_m: Vec<f64>,
}

impl Judged {
    fn pooled(&self) -> SegmentErrors {
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

/// Returns the extended model that the logs support, and what they say of each term; no extension where
/// they support nothing beyond ICRIK.
///
/// Level logs and slope logs are taken together, a log that is among both once; without slope logs only
/// terms of level ground are tried. `vehicle` is where the search starts.
///
/// # Errors
/// Says so when there are too few segments.
pub fn identify_extension(
    level: &[DriveLog],
    slope: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
) -> Result<(Option<Extension>, ExtensionReport), IdentificationError> {
    let mut logs = smoothed(slope, settings);
    let level: Vec<DriveLog> = level
        .iter()
        .filter(|log| !slope.contains(log))
        .cloned()
        .collect();
    logs.extend(smoothed(&level, settings));
    let segments = cut(&logs, settings);
    let needed = 2 * FOLDS;
    if segments.len() < needed {
        return Err(IdentificationError::TooFewSegments {
            found: segments.len(),
            needed,
        });
    }
    let search = Search {
        segments: &segments,
        vehicle,
    };
    let candidates: Vec<Term> = Term::ALL
        .into_iter()
        .filter(|term| !(slope.is_empty() && term.needs_slope()))
        .collect();
    let icrhk = search.judge(&[], &[]);
    let icrik = (!slope.is_empty())
        .then(|| search.judge(&[Term::Slide, Term::AggravatedSlide], &icrhk.parameters));
    let (extended, terms) = search.select(&candidates, &icrhk);
    let extension = search.extension(&extended.terms, &extended.parameters);
    let beyond = extension.gains != ExtensionGains::default();
    let report = ExtensionReport {
        segments: segments.len(),
        icrhk: icrhk.pooled(),
        icrik: icrik.map(|model| model.pooled()),
        extended: extended.pooled(),
        terms,
    };
    Ok((beyond.then_some(extension), report))
}

struct Search<'a> {
    segments: &'a [Segment<'a>],
    vehicle: &'a Vehicle,
}

impl Search<'_> {
    /// Adds terms to ICRHK as long as one is supported.
    fn select(&self, candidates: &[Term], icrhk: &Judged) -> (Judged, Vec<TermReport>) {
        let mut model = self.judge(&[], &icrhk.parameters);
        let mut chosen: Vec<TermReport> = Vec::new();
        // Terms that were supported in a round without being the best.
        let mut rivals: Vec<Term> = Vec::new();
        let mut creep = false;
        loop {
            let rest = candidates
                .iter()
                .filter(|term| !model.terms.contains(term) && term.may_follow(&model.terms, creep));
            let mut tried: Vec<(Judged, TermReport)> = rest
                .map(|term| {
                    let mut terms = model.terms.clone();
                    terms.push(*term);
                    let larger = self.judge(&terms, &model.parameters);
                    let (improvement, improvement_half_width) = larger.gain_over(&model);
                    let value = larger.parameters.last().copied().unwrap_or(0.0);
                    let half_width = larger.half_widths.last().copied().flatten();
                    let determined = half_width.is_some_and(|width| width < value);
                    let clear =
                        determined && improvement >= IMPROVEMENT_MIN.max(improvement_half_width);
                    let verdict = match (value < 0.0, clear) {
                        (true, _) => Verdict::Negative { value },
                        (false, true) => Verdict::Supported { value, half_width },
                        (false, false) => Verdict::NotSupported,
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
            // Who was supported before the last term was added, and is no more, says the same as it.
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
    fn judge(&self, terms: &[Term], start: &[f64]) -> Judged {
        let own = self.own();
        let start: Vec<f64> = (0..BASE + terms.len())
            .map(|i| start.get(i).or(own.get(i)).copied().unwrap_or(0.0))
            .collect();
        let pull: Vec<f64> = (0..start.len())
            .map(|i| if i < BASE { PULL_ICRS_M } else { PULL_SLIDE_M })
            .collect();
        let names: Vec<&'static str> = vec![""; start.len()];
        let vehicle_with = |parameters: &[f64]| self.vehicle_with(terms, parameters);
        let stage = Stage {
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
            // The sum of all gradients is 0 at the minimum, so the rest's is the fold's, negative.
            let (mut rest, mut gradient) = (normal.clone(), DVector::zeros(size));
            for index in held_out() {
                let cluster = &clusters[index];
                rest -= cluster.jacobian.tr_mul(&cluster.jacobian);
                gradient -= cluster.jacobian.tr_mul(&cluster.residuals);
            }
            let step = rest.cholesky().map(|c| c.solve(&gradient));
            let parameters: Vec<f64> = fit
                .parameters
                .iter()
                .enumerate()
                .map(|(i, value)| value - step.as_ref().map_or(0.0, |step| step[i]))
                .collect();
            let vehicle = vehicle_with(&parameters);
            for index in held_out() {
                let segment = &self.segments[index];
                errors[index] = segment
                    .end_error(&vehicle, KinematicModel::Extended)
                    .unwrap_or_default();
                misfits_m[index] = misfit_m(segment, &vehicle);
            }
        }
        Judged {
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
    fn extension(&self, terms: &[Term], parameters: &[f64]) -> Extension {
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
