//! Logs from the recordings of this program.

use super::interpolation::Timed;
use super::series::{Series, in_order};
use anyhow::Result;
use sidehill_bridge::recording::{Recording, RecordingError};
use sidehill_plant::log::sources::Sources;
use sidehill_plant::sample::Stamped;
use std::path::Path;

/// Returns what the controller of a recording received, as exactly as it did; nothing for a bag of another program, or
/// a recording without a controller.
///
/// # Errors
/// A recording that cannot be read.
pub(super) fn read(path: &Path) -> Result<Option<Series>> {
    if path.is_dir() || path.extension().is_none_or(|ending| ending != "mcap") {
        return Ok(None);
    }
    let recording = match Recording::read(path) {
        Err(RecordingError::NotOurs { .. }) => return Ok(None),
        found => found?,
    };
    if recording.cycles.is_empty() {
        return Ok(None);
    }
    let samples: Vec<_> = recording
        .cycles
        .iter()
        .map(|cycle| cycle.sample())
        .collect();
    let mut notes = vec![
        "a recording of sidehill: tread speeds, attitude and poses are those that its controller received".to_owned(),
    ];
    if let Some(reason) = &recording.damaged {
        notes.push(format!(
            "it was interrupted ({reason}); what precedes is used"
        ));
    }
    Ok(Some(Series {
        sources: Sources {
            tread_speeds: timed(samples.iter().filter_map(|sample| sample.tread_speeds)),
            attitudes: Some(timed(samples.iter().filter_map(|sample| sample.attitude))),
            poses: timed(samples.iter().filter_map(|sample| sample.pose)),
        },
        notes,
    }))
}

/// Returns values in the order of their own times, each once.
fn timed<T>(values: impl Iterator<Item = Stamped<T>>) -> Timed<T> {
    in_order(
        values
            .map(|read| ((1e9 * read.time_s).round() as i64, read.value))
            .collect(),
    )
}
