//! The data on which a search tries settings.

use super::objective::Driven;
use super::settings::Setting;
use anyhow::Result;
use serde::Serialize;
use sidehill_controller::config::ControllerKind;
use std::ops::Range;

/// The data by which a search judges settings.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SubjectKind {
    /// Runs of a campaign, or of a scenario with other seeds.
    Campaign,
    /// Stretches of a recording, predicted without poses.
    Recording,
}

/// Evaluates runs with the present settings times the given factors.
pub(super) type Evaluation<'a> = dyn Fn(&[f64], Range<u32>) -> Result<Vec<Driven>> + 'a;

/// Runs or recording on which settings are tried.
pub(super) struct Subject<'a> {
    pub(super) kind: SubjectKind,
    pub(super) name: String,
    /// Its identity.
    pub(super) fingerprint: String,
    pub(super) controller: ControllerKind,
    pub(super) settings: Vec<Setting>,
    /// Training runs and held-out runs.
    pub(super) training: Range<u32>,
    pub(super) held_out: Range<u32>,
    pub(super) drive: Box<Evaluation<'a>>,
}
