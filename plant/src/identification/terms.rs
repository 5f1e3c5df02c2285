//! Which terms beyond ICRHK a set of logs supports: forward selection by cross-validation over blocks.
//!
//! Segments are dealt out to [`FOLDS`] folds in runs of [`RUN`], so that what lies close in time is held
//! out together and every fold has some of each kind of driving. A model is fitted to all segments; its
//! parameters without a fold follow by one Gauss-Newton step on the rest, and predict the fold.
//!
//! Starting from ICRHK, the term is added whose model lowers the held-out misfit most, as long as the
//! fall is at least [`search::IMPROVEMENT_MIN`] and the gain is [`search::CLEAR`] half widths of its 95 % interval
//! over the segments above 0. The misfit of a segment is the root mean square distance of its poses from those
//! dead-reckoned from the best start. Creep is tried when nothing else is left. All parameters are fitted again
//! with each set of terms.
//!
//! The bound is wider than 95 % because several terms are tried. Between attitudes dealt out anew to the windows of
//! real logs, where no term of the slope is true, the slide of ICRIK passed a bound of 95 % in 4 % of 400 trials.
//! A bound on the fall over the folds passed none, and hid a slide that is 4.7 standard deviations from 0.

mod search;

use super::fit::{IdentificationError, IdentificationSettings, cut, smoothed};
use super::segments::SegmentErrors;
use crate::extension::{Extension, ExtensionGains};
use crate::log::DriveLog;
use crate::vehicle::Vehicle;
use search::{FOLDS, Search};

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
