//! `sidehill replay --open-loop`: the commands that a controller would have given in a drive recorded by another program.
//!
//! The reference is the driven path at the driven speeds; vehicle, controller and settings come from the scenario.
//! So the replay shows whether the controller would have driven much the same, without a map or a common origin.

mod drives;
mod feed;
mod page;

use super::args::ReplayArgs;
use super::compare::{Comparison, cross_track_rms_m};
use crate::config::{ConfigFile, Overrides, Scenario};
use crate::console;
use crate::drive_log::LogReader;
use crate::output;
use crate::record::{Quantiles, status_words};
use crate::simulate::Format;
use anyhow::{Context, Result, bail, ensure};
use feed::Fed;
use serde::Serialize;
use sidehill_controller::controller::{Controller, Status};
use sidehill_plant::bounds::Bounds;
use std::collections::BTreeMap;
use std::path::Path;
use std::process::ExitCode;

/// Difference beyond which a cycle counts as different without --tolerance, m/s.
const DIFFERENT_M_S: f64 = 0.1;

/// What is printed.
#[derive(Serialize)]
struct Outcome<'a> {
    log: &'a Path,
    scenario: &'a str,
    controller: &'a str,
    vehicle: &'a str,
    /// Stretches of driving, each fed to a new controller.
    drives: usize,
    /// Stretches of driving that were left out.
    left_out: usize,
    /// Cycles at the start of drives that are not compared: commands rise from zero.
    starting: usize,
    tolerance_m_s: f64,
    #[serde(flatten)]
    comparison: Comparison,
    /// Share of the cycles by status.
    status: BTreeMap<&'static str, f64>,
    /// The first stop.
    first_stop: Option<Stop>,
    /// Distance of the recorded drive from the path.
    cross_track_rms_m: f64,
    solve_us: Quantiles,
}

#[derive(Serialize)]
struct Stop {
    time_s: f64,
    reason: String,
}

/// Feeds the readings of a log to the controller of a scenario, prints how its commands differ from what was measured,
/// and returns success unless they differ by more than --tolerance.
///
/// # Errors
/// A log, map, scenario or setting at fault, or a log without a drive.
pub(super) fn run(args: &ReplayArgs, scenario: &Path) -> Result<ExitCode> {
    let named = || args.recording.display().to_string();
    if let Some(tolerance_m_s) = args.tolerance {
        Bounds::new(0.0, 100.0, "m/s").check("--tolerance", tolerance_m_s)?;
    }
    if let Some(report) = &args.report {
        output::check_writable(report, args.force)?;
    }
    let changes = args.changes();
    let mut world = Scenario::read(ConfigFile::read(scenario)?)?.prepare(&Overrides {
        controllers: args.controller.into_iter().collect(),
        other_vehicle: true,
        ..Overrides::default()
    })?;
    if let Some(vehicle) = changes.vehicle()? {
        world.vehicle = vehicle;
    }
    let config = changes.settings(world.controller)?;
    let kind = *world
        .controllers
        .first()
        .context("the scenario has no controller")?;
    let log = LogReader::new(&args.maps)?.read(&args.recording)?;
    ensure!(
        log.pose_count() > 0,
        "{}: the log has no poses, by which a controller knows where it is: x_m, y_m, z_m and yaw_rad, or `pose` of \
         --columns or --topics",
        named()
    );
    let (drives, left_out) = drives::drives(&log, &world.vehicle, &config);
    if let Some((time_s, error)) = left_out.first() {
        let all = left_out.len() + drives.len();
        let what = format!(
            "{} of {all} stretches of driving are left out, the first at {time_s:.2} s: {error:#}",
            left_out.len()
        );
        if drives.is_empty() {
            bail!("{}: {what}", named());
        }
        console::complain(format_args!("{}: note: {what}", named()));
    }
    ensure!(
        !drives.is_empty(),
        "{}: the treads stand in all of the log",
        named()
    );
    let mut cycles: Vec<Fed> = Vec::new();
    for drive in &drives {
        // Without the scenario's ground, which is another place: the slope is taken from the attitude.
        let controller = Controller::new(kind, config.clone(), &world.vehicle)?;
        cycles.extend(feed::feed(drive, controller, &world.vehicle));
    }
    let tolerance_m_s = args.tolerance.unwrap_or(DIFFERENT_M_S);
    let outcome = Outcome {
        log: &args.recording,
        scenario: &world.name,
        controller: kind.name(),
        vehicle: &world.vehicle.name,
        drives: drives.len(),
        left_out: left_out.len(),
        starting: cycles.iter().filter(|fed| fed.starting).count(),
        tolerance_m_s,
        comparison: compared(&cycles, tolerance_m_s),
        status: shares(&cycles),
        first_stop: cycles.iter().find_map(|fed| match fed.status {
            Status::Stopping(reason) => Some(Stop {
                time_s: fed.step.time_s,
                reason: reason.to_string(),
            }),
            _ => None,
        }),
        cross_track_rms_m: cross_track_rms_m(cycles.iter().map(|fed| fed.step.cross_track_m)),
        solve_us: Quantiles::of(
            cycles
                .iter()
                .map(|fed| fed.step.solve_us)
                .filter(|us| us.is_finite())
                .collect(),
        ),
    };
    let figures = figures(&outcome);
    if let Some(file) = &args.report {
        let subtitle = format!(
            "Log {}, {} of scenario {}, vehicle {}",
            named(),
            outcome.controller,
            outcome.scenario,
            outcome.vehicle
        );
        let page = page::html(&subtitle, &conclusions(&outcome), &figures, &cycles);
        output::write(file, page.as_bytes(), args.force)?;
    }
    match args.format {
        Format::Json => console::line(serde_json::to_string(&outcome)?),
        Format::Table => {
            let mut text = format!(
                "log {}\ncontroller {} of scenario {}, vehicle {}\n",
                named(),
                outcome.controller,
                outcome.scenario,
                outcome.vehicle
            );
            for (name, value) in &figures {
                text.push_str(&format!("{name:24} {value}\n"));
            }
            console::text(text);
        }
    }
    let failed = args.tolerance.is_some() && outcome.comparison.different > 0;
    Ok(ExitCode::from(u8::from(failed)))
}

fn compared(cycles: &[Fed], tolerance_m_s: f64) -> Comparison {
    let mut all = Comparison::default();
    let counted = cycles.iter().enumerate().filter(|(_, fed)| !fed.starting);
    for (index, fed) in counted {
        let pair = [("measured", fed.measured), ("commanded", fed.step.command)];
        let what = all.add(pair, tolerance_m_s);
        all.note(index as u64, fed.step.time_s, what);
    }
    all.averaged()
}

fn shares(cycles: &[Fed]) -> BTreeMap<&'static str, f64> {
    let mut shares = BTreeMap::new();
    for fed in cycles {
        let (name, _) = status_words(fed.status);
        *shares.entry(name).or_insert(0.0) += 1.0 / cycles.len() as f64;
    }
    shares
}

/// Returns the figures with their names, as text.
fn figures(outcome: &Outcome<'_>) -> Vec<(&'static str, String)> {
    let comparison = &outcome.comparison;
    let m_s = |value: f64| format!("{value:.4} m/s");
    let shares = outcome.status.iter();
    let shares: Vec<String> = shares
        .map(|(name, share)| format!("{name} {:.1} %", 100.0 * share))
        .collect();
    let mut figures = vec![
        (
            "drives",
            format!("{}, {} left out", outcome.drives, outcome.left_out),
        ),
        (
            "cycles",
            format!(
                "{} compared, {} at starts are not",
                comparison.cycles, outcome.starting
            ),
        ),
        (
            "different",
            format!(
                "{}, by more than {}",
                comparison.different,
                m_s(outcome.tolerance_m_s)
            ),
        ),
    ];
    if let Some(first) = &comparison.first {
        figures.push((
            "first difference",
            format!(
                "cycle {} at {:.3} s: {}",
                first.cycle, first.time_s, first.what
            ),
        ));
    }
    figures.extend([
        ("largest difference", m_s(comparison.largest_difference_m_s)),
        ("  traction, RMS", m_s(comparison.traction_rms_m_s)),
        ("  steer, RMS", m_s(comparison.steer_rms_m_s)),
        ("status", shares.join(", ")),
        (
            "first stop",
            outcome.first_stop.as_ref().map_or_else(
                || "none".to_owned(),
                |stop| format!("{:.3} s: {}", stop.time_s, stop.reason),
            ),
        ),
        (
            "cross-track RMS",
            format!(
                "{:.3} cm from the driven path",
                100.0 * outcome.cross_track_rms_m
            ),
        ),
        (
            "solve time",
            format!(
                "p50 {:.0} us, p99 {:.0} us",
                outcome.solve_us.p50, outcome.solve_us.p99
            ),
        ),
    ]);
    figures
}

/// Returns the conclusions.
fn conclusions(outcome: &Outcome<'_>) -> Vec<String> {
    let comparison = &outcome.comparison;
    let mut sentences = vec![format!(
        "In {} of {} cycles the command is more than {} m/s from what was measured; RMS {:.3} m/s of traction and {:.3} \
         m/s of steer.",
        comparison.different,
        comparison.cycles,
        outcome.tolerance_m_s,
        comparison.traction_rms_m_s,
        comparison.steer_rms_m_s
    )];
    sentences.push(match &outcome.first_stop {
        None => "The controller would not have stopped.".to_owned(),
        Some(stop) => format!(
            "It would first have stopped at {:.2} s: {}.",
            stop.time_s, stop.reason
        ),
    });
    sentences
}
