//! A term beyond ICRHK and what logs say of it.

use crate::bounds::RangeError;
use crate::extension::Extension;

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
    pub(super) const ALL: [Self; 6] = [
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

    /// Returns whether it is tried together with `terms`: lambda_2 aggravates the slide of lambda_1, and creep
    /// comes last, as turns at a single rate cannot distinguish it from the slide.
    pub(super) fn may_follow(self, terms: &[Self], creep: bool) -> bool {
        match self {
            Self::AggravatedSlide => terms.contains(&Self::Slide),
            Self::CreepShare | Self::Creep => creep,
            Self::OutwardSlip | Self::TurnLoss | Self::Slide => true,
        }
    }

    pub(super) fn gain(self, extension: &mut Extension) -> &mut f64 {
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
    /// With it a parameter leaves the range that a vehicle file may have.
    OutOfRange {
        /// The parameter, what the fit gave, and its range.
        reason: RangeError,
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
