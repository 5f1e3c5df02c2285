//! `sidehill-drive faults`: a virtual rover driven through faults, in simulated time.
//!
//! Control loop, safety and controller are those of `run`; a port between them and the rover spoils what is received
//! and sent. All draws come from a seed, and each run again by its number.

mod drive;
mod kind;
mod port;

pub use kind::{Fault, FaultKind};

use anyhow::{Context, Result, ensure};
use clap::ValueEnum;
use drive::{FaultOutcome, FaultyRover, Traces};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::Serialize;
use sidehill::config::{ConfigFile, RunConfig, RunPort};
use sidehill::console;
use sidehill::exit::Exit;
use sidehill::progress::TaskProgress;
use sidehill_plant::statistics::quantile;
use statrs::distribution::{Beta, ContinuousCDF};
use std::path::PathBuf;
use std::process::ExitCode;

/// Arguments of `sidehill-drive faults`.
#[derive(Debug, clap::Args)]
pub struct FaultsArgs {
    /// Configuration of a run with a virtual rover: key `simulated`. Its port may be another.
    config: PathBuf,
    /// Runs.
    #[arg(long, default_value_t = 1000)]
    runs: u64,
    /// Seed of all draws. Run N depends on it and on N only.
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Draw these faults only.
    #[arg(long, value_enum, value_delimiter = ',')]
    only: Vec<FaultKind>,
    /// Drive this run alone, and print its events.
    #[arg(long)]
    run: Option<u64>,
    /// CSV file for the cycles of the run of --run.
    #[arg(long, requires = "run")]
    out: Option<PathBuf>,
    /// How the result is printed.
    #[arg(long, value_enum, default_value_t)]
    format: FaultsFormat,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
enum FaultsFormat {
    /// A text table.
    #[default]
    Table,
    /// JSON.
    Json,
}

/// Of several runs, the middle, the 95th percentile and the largest value.
#[derive(Debug, Clone, Copy, Serialize)]
struct Spread {
    median: f64,
    p95: f64,
    max: f64,
}

impl Spread {
    fn of(values: impl Iterator<Item = f64>) -> Option<Self> {
        let mut values: Vec<f64> = values.collect();
        values.sort_by(f64::total_cmp);
        Some(Self {
            median: quantile(&values, 0.5)?,
            p95: quantile(&values, 0.95)?,
            max: *values.last()?,
        })
    }
}

/// What came of the runs with a fault.
#[derive(Debug, Serialize)]
struct FaultRow {
    /// The fault; `two` are those with two at once.
    fault: String,
    runs: usize,
    drove_on: usize,
    stop_time_s: Option<Spread>,
    stop_way_m: Option<Spread>,
    off_path_max_m: f64,
    unsafe_runs: Vec<u64>,
    /// Bound of the share of unsafe ends that holds with 95 %, by Clopper and Pearson.
    unsafe_share_below: f64,
    /// The run with the longest way to standstill, or the farthest from the path.
    worst_run: u64,
}

impl FaultRow {
    fn of(fault: String, outcomes: &[&FaultOutcome]) -> Self {
        let unsafe_runs: Vec<u64> = outcomes
            .iter()
            .filter(|outcome| outcome.unsafe_end.is_some())
            .map(|outcome| outcome.run)
            .collect();
        let badness =
            |outcome: &&&FaultOutcome| outcome.stop_way_m.unwrap_or(0.0) + outcome.off_path_m;
        let worst = outcomes
            .iter()
            .max_by(|a, b| badness(a).total_cmp(&badness(b)));
        Self {
            fault,
            runs: outcomes.len(),
            drove_on: outcomes
                .iter()
                .filter(|outcome| outcome.reason.is_none())
                .count(),
            stop_time_s: Spread::of(outcomes.iter().filter_map(|outcome| outcome.stop_time_s)),
            stop_way_m: Spread::of(outcomes.iter().filter_map(|outcome| outcome.stop_way_m)),
            off_path_max_m: outcomes
                .iter()
                .map(|outcome| outcome.off_path_m)
                .fold(0.0, f64::max),
            unsafe_share_below: share_below(unsafe_runs.len(), outcomes.len()),
            unsafe_runs,
            worst_run: worst.map_or(0, |outcome| outcome.run),
        }
    }
}

/// Returns the one-sided bound of Clopper and Pearson for a share of which `count` of `total` were found.
fn share_below(count: usize, total: usize) -> f64 {
    if count >= total {
        return 1.0;
    }
    let bound = Beta::new(count as f64 + 1.0, (total - count) as f64);
    bound.map_or(1.0, |beta| beta.inverse_cdf(0.95))
}

#[derive(Debug, Serialize)]
struct FaultSummary {
    runs: u64,
    seed: u64,
    faults: Vec<FaultRow>,
    all: FaultRow,
}

/// Drives the runs and prints what came of them. The exit status is 0 only if no run ended unsafe.
///
/// # Errors
/// A file that cannot be read, a setting out of range, or a configuration without a virtual rover.
pub fn run(args: &FaultsArgs) -> Result<ExitCode> {
    let file = ConfigFile::read(&args.config)?;
    let config: RunConfig = file.parse()?;
    ensure!(
        config.port != RunPort::Ros2,
        "{}: port: ros2: faults are drawn for the ports can and simulated",
        file.name()
    );
    let rover = FaultyRover { file, config };
    let kinds: Vec<FaultKind> = match args.only.is_empty() {
        true => FaultKind::value_variants().to_vec(),
        false => args.only.clone(),
    };
    if let Some(run) = args.run {
        return again(args, &rover, run, &kinds);
    }
    let progress = TaskProgress::new("faults", args.runs);
    let outcomes: Result<Vec<FaultOutcome>> = (0..args.runs)
        .into_par_iter()
        .map(|run| {
            let outcome = rover.drive(run, &kind::draw(args.seed, run, &kinds), None);
            progress.step();
            outcome
        })
        .collect();
    drop(progress);
    let outcomes = outcomes?;
    let rows = kinds
        .iter()
        .map(|kind| (name(*kind), Some(*kind)))
        .chain([("two".to_owned(), None)]);
    let rows = rows.map(|(name, kind)| {
        let of: Vec<&FaultOutcome> = outcomes
            .iter()
            .filter(|outcome| match (outcome.faults.as_slice(), kind) {
                ([fault], Some(kind)) => fault.kind == kind,
                ([_, _], None) => true,
                _ => false,
            })
            .collect();
        FaultRow::of(name, &of)
    });
    let all: Vec<&FaultOutcome> = outcomes.iter().collect();
    let summary = FaultSummary {
        runs: args.runs,
        seed: args.seed,
        faults: rows.filter(|row| row.runs > 0).collect(),
        all: FaultRow::of("all".to_owned(), &all),
    };
    match args.format {
        FaultsFormat::Json => console::line(serde_json::to_string(&summary)?),
        FaultsFormat::Table => print(&summary, &outcomes),
    }
    Ok(Exit::answer(summary.all.unsafe_runs.is_empty()).into())
}

fn name(kind: FaultKind) -> String {
    kind.to_possible_value()
        .map_or(String::new(), |value| value.get_name().to_owned())
}

/// Drives one run again and prints what happened.
fn again(
    args: &FaultsArgs,
    rover: &FaultyRover,
    run: u64,
    kinds: &[FaultKind],
) -> Result<ExitCode> {
    let mut traces = Traces::default();
    let faults = kind::draw(args.seed, run, kinds);
    let outcome = rover.drive(run, &faults, Some(&mut traces))?;
    if let Some(path) = &args.out {
        let mut writer =
            csv::Writer::from_path(path).with_context(|| path.display().to_string())?;
        for row in &traces.cycles {
            writer.serialize(row)?;
        }
        writer.flush()?;
    }
    match args.format {
        FaultsFormat::Json => console::line(serde_json::to_string(&outcome)?),
        FaultsFormat::Table => {
            for fault in &faults {
                console::line(format_args!(
                    "{} from {:.2} s after the vehicle drives, for {:.2} s",
                    name(fault.kind),
                    fault.from_s,
                    fault.for_s
                ));
            }
            for event in &traces.events {
                console::line(event);
            }
            if let (Some(time_s), Some(way_m)) = (outcome.stop_time_s, outcome.stop_way_m) {
                console::line(format_args!(
                    "stands {time_s:.2} s and {way_m:.2} m after the fault"
                ));
            }
            if let Some(unsafe_end) = outcome.unsafe_end {
                console::line(format_args!("unsafe: {unsafe_end}"));
            }
        }
    }
    Ok(Exit::answer(outcome.unsafe_end.is_none()).into())
}

fn print(summary: &FaultSummary, outcomes: &[FaultOutcome]) {
    console::line(format_args!(
        "{:<18} {:>6} {:>9} {:>22} {:>22} {:>9} {:>7} {:>8} {:>6}",
        "",
        "runs",
        "drove on",
        "stands after, s",
        "after, m",
        "off path",
        "unsafe",
        "below",
        "worst"
    ));
    console::line(format_args!(
        "{:<18} {:>6} {:>9} {:>22} {:>22} {:>9} {:>7} {:>8} {:>6}",
        "fault", "", "", "median  p95  largest", "median  p95  largest", "m", "ends", "%", "run"
    ));
    let spread = |spread: Option<Spread>| match spread {
        Some(Spread { median, p95, max }) => format!("{median:.2} {p95:6.2} {max:6.2}"),
        None => String::new(),
    };
    for row in summary.faults.iter().chain([&summary.all]) {
        console::line(format_args!(
            "{:<18} {:>6} {:>9} {:>22} {:>22} {:>9.2} {:>7} {:>8.3} {:>6}",
            row.fault,
            row.runs,
            row.drove_on,
            spread(row.stop_time_s),
            spread(row.stop_way_m),
            row.off_path_max_m,
            row.unsafe_runs.len(),
            100.0 * row.unsafe_share_below,
            row.worst_run,
        ));
    }
    for outcome in outcomes
        .iter()
        .filter(|outcome| outcome.unsafe_end.is_some())
        .take(20)
    {
        let kinds: Vec<String> = outcome
            .faults
            .iter()
            .map(|fault| name(fault.kind))
            .collect();
        console::line(format_args!(
            "unsafe: run {} ({}): {}",
            outcome.run,
            kinds.join(" and "),
            outcome.unsafe_end.unwrap_or_default()
        ));
    }
}
