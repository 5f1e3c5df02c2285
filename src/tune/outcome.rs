//! The outcome of tuning.

use super::objective::TrialComparison;
use super::settings::Setting;
use super::subject::SubjectKind;
use serde::Serialize;

/// The outcome of tuning.
#[derive(Debug, Clone, Serialize)]
pub struct TuningOutcome {
    /// Campaign, scenario or recording.
    pub name: String,
    /// Kind of data that the settings were tried on.
    pub subject: SubjectKind,
    /// Controller.
    pub controller: &'static str,
    /// Whether the held-out runs show an improvement; only then use the settings.
    pub improved: bool,
    /// Settings searched, with their values before and after.
    pub settings: Vec<Setting>,
    /// Mean cost over the training runs of each trial, in order; 0 is that of the present settings.
    pub tried: Vec<f64>,
    /// Training runs.
    pub training: TrialComparison,
    /// Held-out runs.
    pub held_out: TrialComparison,
    /// Weight of calmness.
    pub calmness: f64,
}
