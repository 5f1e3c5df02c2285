//! Results of the stages of an identification.

use anyhow::Result;
use sidehill_plant::bounds::RangeError;
use sidehill_plant::identification::{
    ContactReport, ExtensionReport, FittedParameter, StageReport,
};
use sidehill_plant::vehicle::Vehicle;

/// Result of a stage.
pub(super) struct StageResult {
    pub(super) report: StageReport,
    pub(super) undetermined: Vec<Undetermined>,
}

/// A parameter that the logs do not determine, and the start value that it keeps.
pub(super) struct Undetermined {
    pub(super) estimate: FittedParameter,
    pub(super) kept: f64,
}

/// Results of all stages, if there were logs for them.
#[derive(Default)]
pub(super) struct Found {
    pub(super) level: Option<StageResult>,
    pub(super) slope: Option<StageResult>,
    /// Terms beyond ICRIK.
    pub(super) extension: Option<ExtensionReport>,
    /// Why the vehicle is without the terms that the logs support.
    pub(super) extension_not_used: Option<RangeError>,
    /// The contact vehicle, with --contact.
    pub(super) contact: Option<ContactReport>,
}

impl StageResult {
    /// `start` is the vehicle that the stage started from.
    pub(super) fn new(
        report: StageReport,
        undetermined: Vec<FittedParameter>,
        start: &Vehicle,
    ) -> Result<Self> {
        let start = serde_json::to_value(start)?;
        let kept = |estimate: FittedParameter| Undetermined {
            estimate,
            kept: start[estimate.name].as_f64().unwrap_or(f64::NAN),
        };
        Ok(Self {
            report,
            undetermined: undetermined.into_iter().map(kept).collect(),
        })
    }
}

impl Found {
    /// Returns the parameters of both stages that the logs do not determine.
    pub(super) fn undetermined(&self) -> impl Iterator<Item = &Undetermined> {
        let stages = self.level.iter().chain(&self.slope);
        stages.flat_map(|stage| &stage.undetermined)
    }
}
