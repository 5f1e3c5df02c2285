//! The files of `simulate --out`.

use crate::config::Prepared;
use crate::output;
use crate::record::Run;
use crate::report;
use anyhow::Result;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_plant::sensors::SensorsConfig;
use std::path::{Path, PathBuf};

/// Name of the report.
pub(super) const REPORT: &str = "report.html";

pub(super) fn csv_path(folder: &Path, controller: &str) -> PathBuf {
    folder.join(format!("{controller}.csv"))
}

/// Writes a CSV file of each run and the report of all.
pub(super) fn write_out(
    folder: &Path,
    force: bool,
    prepared: &Prepared,
    conditions: Option<&str>,
    datum: Option<GeodeticOrigin>,
    runs: &[Run],
) -> Result<()> {
    for run in runs {
        let mut csv = Vec::new();
        report::write_csv(run, &mut csv)?;
        output::write(&csv_path(folder, &run.summary.controller), &csv, force)?;
    }
    let path = prepared.reference.path();
    let length_m = path.map_or(0.0, |path| path.length_m());
    let points = (length_m / 0.05).ceil().clamp(2.0, 20_000.0) as usize;
    let scene = report::Scene {
        title: prepared.name.replace('_', " "),
        subtitle: format!(
            "Plant {}, vehicle {}, seed {}{}. {}",
            prepared.plant.kind().name(),
            prepared.vehicle.name,
            prepared.seed,
            named(conditions),
            prepared.route_note
        ),
        path: path.map_or_else(Vec::new, |path| {
            (0..=points)
                .map(|i| path.at(length_m * i as f64 / points as f64).position)
                .map(|position| [position.x_m, position.y_m])
                .collect()
        }),
        terrain: &prepared.terrain,
        guard: prepared.controller.guard.as_ref(),
        datum,
        perfect_sensors: prepared.sensors == SensorsConfig::default(),
        limits: &prepared.controller.limits,
        vehicle: &prepared.vehicle,
        period_s: prepared.controller.period_s,
    };
    let html = report::html(&scene, runs);
    output::write(&folder.join(REPORT), html.as_bytes(), force)
}

/// Returns the name of the conditions for titles.
pub(super) fn named(conditions: Option<&str>) -> String {
    conditions.map_or_else(String::new, |name| format!(", conditions {name}"))
}
