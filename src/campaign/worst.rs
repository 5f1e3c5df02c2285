//! `campaign --keep-worst`: repeats and records the worst runs.

use super::table::CampaignRow;
use crate::closed_loop;
use crate::config::{Bundle, Campaign, Overrides, Scenario};
use crate::recording::{self, SimulationRecording};
use anyhow::{Context, Result, bail};
use sidehill_controller::config::ControllerKind;
use sidehill_recording::{RecordLimits, Sinks};
use std::cmp::Ordering;
use std::path::{Path, PathBuf};

/// Records the `count` worst runs of all controllers: those that did not complete, then those farthest
/// off their path. Returns the files, worst run first.
///
/// # Errors
/// A folder or file that cannot be written, or a run that cannot be repeated.
pub(super) fn keep(
    campaign: &Campaign,
    rows: &[CampaignRow],
    count: usize,
    results: &Path,
) -> Result<Vec<PathBuf>> {
    let folder = results.with_extension("worst");
    std::fs::create_dir_all(&folder)
        .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
    let mut worst: Vec<&CampaignRow> = rows.iter().collect();
    worst.sort_by(|a, b| order(a, b));
    let mut files = Vec::new();
    for row in worst.into_iter().take(count) {
        let kind = ControllerKind::from_name(&row.controller)
            .with_context(|| format!("{}: no such controller", row.controller))?;
        let bundle = Bundle::default();
        let drawn = campaign.draw(row.index)?;
        let file = drawn.scenario.with_bundle(bundle.clone());
        let prepared = Scenario::read(file.clone())?.prepare(&Overrides {
            controllers: vec![kind],
            ..Overrides::default()
        })?;
        let path = folder.join(format!("run_{}_{}.mcap", row.index, row.controller));
        let header = recording::header("simulate", Some(kind), &file, &bundle, &[]);
        // The same campaign writes the same file, so it may be overwritten.
        let mcap = recording::create(&path, header, RecordLimits::default(), true)?;
        let sinks = Sinks {
            file: Some(mcap),
            live: None,
        };
        let (vehicle, terrain) = (&prepared.vehicle, &prepared.terrain);
        let mut recording = SimulationRecording::new(sinks, vehicle, terrain, false);
        closed_loop::run(&prepared, kind, |_| {}, Some(&mut recording))?;
        if let Some(reason) = recording.finish().and_then(|status| status.ended) {
            bail!("--keep-worst: {reason}");
        }
        files.push(path);
    }
    Ok(files)
}

fn order(a: &CampaignRow, b: &CampaignRow) -> Ordering {
    let error_m = |row: &CampaignRow| row.cross_track_rms_m.unwrap_or(f64::INFINITY);
    let by_end = a.completed.cmp(&b.completed);
    by_end
        .then(error_m(b).total_cmp(&error_m(a)))
        .then_with(|| (a.index, &a.controller).cmp(&(b.index, &b.controller)))
}
