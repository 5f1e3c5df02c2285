//! What tuning has found.

use super::objective::Comparison;
use super::settings::Setting;
use super::subject::SubjectKind;
use serde::Serialize;

/// What tuning has found.
#[derive(Debug, Clone, Serialize)]
pub struct Outcome {
    /// Campaign, scenario or recording.
    pub name: String,
    /// What the settings were tried on.
    pub subject: SubjectKind,
    /// Controller.
    pub controller: &'static str,
    /// Whether the held-out runs show an improvement; only then are the settings worth having.
    pub improved: bool,
    /// Settings searched, with their values before and after.
    pub settings: Vec<Setting>,
    /// Mean costs of the training runs of all that was tried, in order; 0 is the present settings.
    pub tried: Vec<f64>,
    /// Runs that the search saw.
    pub training: Comparison,
    /// Runs that it did not see.
    pub held_out: Comparison,
    /// Weight of calmness.
    pub calmness: f64,
}
