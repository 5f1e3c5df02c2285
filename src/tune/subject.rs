//! What a search tries settings on.

use super::objective::Driven;
use super::settings::Setting;
use anyhow::Result;
use serde::Serialize;
use sidehill_controller::config::ControllerKind;
use std::ops::Range;

/// What a search judges settings by.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum SubjectKind {
    /// Runs of a campaign, or of a scenario with other seeds.
    Campaign,
    /// Stretches of a recording, predicted without poses.
    Recording,
}

/// Drives runs under settings that are so many times the present ones.
pub(super) type Drive<'a> = dyn Fn(&[f64], Range<u32>) -> Result<Vec<Driven>> + 'a;

/// What settings are tried on.
pub(super) struct Subject<'a> {
    pub(super) kind: SubjectKind,
    pub(super) name: String,
    /// What makes it the same.
    pub(super) fingerprint: String,
    pub(super) controller: ControllerKind,
    pub(super) settings: Vec<Setting>,
    /// Runs that the search sees, and those that decide.
    pub(super) training: Range<u32>,
    pub(super) held_out: Range<u32>,
    pub(super) drive: Box<Drive<'a>>,
}
