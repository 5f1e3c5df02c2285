//! `sidehill simulate`: a scenario with its controllers, side by side.

mod files;
mod table;

use crate::closed_loop::{self, Observer};
use crate::config::{
    Bundle, Conditions, ConfigFile, DEFAULT_SCENARIO, Overrides, PlantKind, Prepared, Scenario,
};
use crate::console;
use crate::exit::Exit;
use crate::learned;
use crate::limits;
use crate::output;
use crate::progress::{self, TaskProgress};
use crate::qp_recording::QpRecording;
use crate::record::{Run, Summary};
use crate::recording::{self, LiveArgs, SimulationRecording, datum, fact};
use anyhow::{Context, Result, bail};
use files::{REPORT, csv_path, write_out};
use sidehill_controller::config::ControllerKind;
use sidehill_recording::{RecordLimits, Sinks};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use table::table;

/// Arguments of `sidehill simulate`.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct SimulateArgs {
    /// Scenario; by default the built-in figure of eight on 5.3 degrees.
    pub scenario: Option<PathBuf>,
    /// Controller to run instead of the scenario's; may be given several times.
    #[arg(long = "controller", value_name = "NAME", value_parser = controller)]
    pub controllers: Vec<ControllerKind>,
    /// Sensing, actuation and ground instead of the scenario's: a YAML file, or `realistic`, which is
    /// built in.
    #[arg(long, value_name = "FILE")]
    pub conditions: Vec<PathBuf>,
    /// What moves the vehicle, instead of the plant of scenario or conditions.
    #[arg(long)]
    pub plant: Option<PlantKind>,
    /// CSV or GPX file to follow instead of the scenario's path.
    #[arg(long, value_name = "FILE")]
    pub path: Option<PathBuf>,
    /// Seed instead of the scenario's.
    #[arg(long)]
    pub seed: Option<u64>,
    /// Folder for a CSV file of each run and a report.
    #[arg(long, value_name = "DIR")]
    pub out: Option<PathBuf>,
    /// Start with what was learned before; the controller's settings must have `memory`.
    #[arg(long, value_name = "FILE")]
    pub learned: Option<PathBuf>,
    /// Write what was learned at the end, for --learned or `run`; it takes one controller.
    #[arg(long, value_name = "FILE")]
    pub learned_out: Option<PathBuf>,
    /// Write the QPs of a run to an npz file; it takes one controller, an MPC.
    #[arg(long, value_name = "FILE")]
    pub record_qps: Option<PathBuf>,
    /// Record the run to an MCAP file, which `sidehill replay` and Foxglove read; it takes one controller.
    #[arg(long, value_name = "FILE.mcap")]
    pub record: Option<PathBuf>,
    /// The live view; it takes one controller.
    #[command(flatten)]
    pub live: LiveArgs,
    /// Simulate no faster than real time, to watch it with --live.
    #[arg(long)]
    pub realtime: bool,
    /// Overwrite files of --out, --record and --record-qps that exist.
    #[arg(long)]
    pub force: bool,
    /// How the figures are printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: Format,
}

/// How figures are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Format {
    /// A text table.
    #[default]
    Table,
    /// JSON.
    Json,
}

/// Returns the controller of that name, for command lines.
pub(crate) fn controller(name: &str) -> Result<ControllerKind, String> {
    ControllerKind::from_name(name).ok_or_else(|| {
        let names: Vec<_> = ControllerKind::ALL.iter().map(|kind| kind.name()).collect();
        format!("controllers are {}", names.join(", "))
    })
}

/// Runs the scenario, prints the figures, and returns success only if every run completed.
///
/// # Errors
/// What is wrong with a file, with its name, key, value and range; or what cannot be written.
pub fn run(args: &SimulateArgs) -> Result<ExitCode> {
    let bundle = Bundle::default();
    let file = match &args.scenario {
        Some(path) => ConfigFile::read(path)?,
        None => ConfigFile::built_in(DEFAULT_SCENARIO)?,
    }
    .with_bundle(bundle.clone());
    let conditions = match args.conditions.as_slice() {
        [] => None,
        [one] => Some(Conditions::read(one)?),
        [_, _, ..] => bail!(
            "--conditions: given {} times; a second file would replace whole sections of the first, so put all keys \
             into one file",
            args.conditions.len()
        ),
    };
    let file = match &conditions {
        Some(conditions) => conditions.put_into(&file)?,
        None => file,
    };
    let conditions = conditions.map(|conditions| conditions.name);
    let scenario = Scenario::read(file.clone())?;
    let prepared = scenario.prepare(&Overrides {
        path: args.path.clone(),
        plant: args.plant,
        seed: args.seed,
        controllers: args.controllers.clone(),
        ..Overrides::default()
    })?;
    let mut prepared = prepared;
    if let Some(path) = &args.learned {
        prepared.learned = Some(Arc::new(learned::load(path, learned::DAYS_MAX)?));
    }
    if let Some(path) = &args.learned_out {
        if prepared.controllers.len() != 1 || prepared.controller.memory.is_none() {
            bail!("--learned-out takes one controller, with `memory` in its settings");
        }
        output::check_writable(path, true)?;
    }
    for warning in &prepared.warnings {
        console::complain(format_args!("warning: {warning}"));
    }
    if let Some(folder) = &args.out {
        // Before the work, which may take a long time.
        std::fs::create_dir_all(folder)
            .with_context(|| format!("{}: cannot create the folder", folder.display()))?;
        let mut files = vec![folder.join(REPORT)];
        let names = prepared.controllers.iter().map(|kind| kind.name());
        files.extend(names.map(|name| csv_path(folder, name)));
        output::check_free(&files, args.force)?;
        output::check_writable(&folder.join(REPORT), args.force)?;
    }
    let mut qps = match (&args.record_qps, prepared.controllers.as_slice()) {
        (None, _) => None,
        (Some(_), [ControllerKind::PurePursuit]) => {
            bail!("--record-qps: pure-pursuit solves no QP")
        }
        (Some(path), [_]) => {
            output::check_writable(path, args.force)?;
            Some(QpRecording::default())
        }
        (Some(_), several) => bail!(
            "--record-qps takes the QPs of one controller, not of {}: choose it with --controller",
            several.len()
        ),
    };
    progress::explain_interrupt(|| "interrupted: nothing was written".to_owned())?;
    let mut recording = if args.record.is_some() || args.live.live.is_some() || args.realtime {
        Some(record(args, &prepared, &file, &bundle)?)
    } else {
        None
    };
    let observer = qps.as_mut().map(|qps| qps as &mut dyn Observer);
    let observer = match &mut recording {
        Some(recording) => Some(recording as &mut dyn Observer),
        None => observer,
    };
    let runs = runs(&prepared, observer)?;
    if let Some(reason) = recording
        .and_then(SimulationRecording::finish)
        .and_then(|status| status.ended)
    {
        bail!("--record: {reason}");
    }
    if let (Some(path), Some(qps)) = (&args.record_qps, &qps) {
        output::write(path, &qps.npz()?, args.force)?;
    }
    if let (
        Some(path),
        [
            Run {
                learned: Some(found),
                ..
            },
        ],
    ) = (&args.learned_out, runs.as_slice())
    {
        learned::save(path, found)?;
    }
    if let Some(folder) = &args.out {
        let datum = scenario.datum();
        write_out(
            folder,
            args.force,
            &prepared,
            conditions.as_deref(),
            datum,
            &runs,
        )?;
    }
    let summaries: Vec<&Summary> = runs.iter().map(|run| &run.summary).collect();
    match args.format {
        Format::Table => {
            console::text(table(&prepared, conditions.as_deref(), &summaries));
        }
        Format::Json => console::line(serde_json::to_string(
            &serde_json::json!({ "runs": summaries }),
        )?),
    }
    let completed = summaries.iter().all(|summary| summary.completed);
    Ok(Exit::answer(completed).into())
}

/// Begins the recording of the one controller.
fn record(
    args: &SimulateArgs,
    prepared: &Prepared,
    file: &ConfigFile,
    bundle: &Bundle,
) -> Result<SimulationRecording> {
    let [kind] = prepared.controllers[..] else {
        bail!(
            "--record, --live and --realtime take one controller, not {}: choose it with --controller",
            prepared.controllers.len()
        );
    };
    if args.record_qps.is_some() {
        bail!("--record-qps goes without --record, --live and --realtime");
    }
    let facts = [
        (fact::PLANT, args.plant.map(|plant| plant.name().to_owned())),
        (fact::SEED, args.seed.map(|seed| seed.to_string())),
        (
            fact::PATH,
            args.path.as_ref().map(|path| path.display().to_string()),
        ),
        (
            fact::LEARNED,
            prepared.learned.as_ref().map(|file| file.text.clone()),
        ),
    ];
    let header = recording::header("simulate", Some(kind), file, bundle, &facts);
    let datum = datum(&header);
    let mcap = match &args.record {
        Some(path) => {
            let limits = RecordLimits::default();
            Some(recording::create(path, header, limits, args.force)?)
        }
        None => None,
    };
    let live = recording::live(&args.live, Some(&prepared.controller))?;
    if let (Some(live), Some(datum)) = (&live, &datum) {
        live.place(datum);
    }
    let sinks = Sinks { file: mcap, live };
    Ok(SimulationRecording::new(
        sinks,
        &prepared.vehicle,
        &prepared.terrain,
        args.realtime,
    ))
}

/// Simulated time above which a run is announced, s.
const LONG_S: f64 = 1000.0;

/// Runs the controllers one after the other, because parallel runs would disturb the measured times.
fn runs(prepared: &Prepared, mut observer: Option<&mut dyn Observer>) -> Result<Vec<Run>> {
    let simulated_s = prepared.reference.end_s();
    let cycles = simulated_s / prepared.controller.period_s;
    if cycles > limits::CYCLES {
        bail!(
            "{}: its path takes {simulated_s:.0} s, which is {:.1} million cycles of controller.period_s; at most {:.0} \
             million are simulated: shorten the path, drive it faster or fewer laps of it",
            prepared.name,
            cycles / 1e6,
            limits::CYCLES / 1e6
        );
    }
    if simulated_s > LONG_S {
        console::complain(format_args!(
            "this simulates {simulated_s:.0} s of driving for each of {} controllers",
            prepared.controllers.len()
        ));
    }
    let mut runs = Vec::new();
    for &kind in &prepared.controllers {
        let progress = TaskProgress::new(kind.name(), 1000);
        let hear = |share| progress.at((1000.0 * share) as u64);
        let run = match &mut observer {
            Some(observer) => closed_loop::run(prepared, kind, hear, Some(&mut **observer))?,
            None => closed_loop::run(prepared, kind, hear, None)?,
        };
        progress.finish();
        runs.push(run);
    }
    Ok(runs)
}
