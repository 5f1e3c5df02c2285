//! `sidehill tune`: settings of a controller that drive a campaign better, judged by runs that the
//! search has not seen.

mod objective;
mod options;
mod outcome;
mod report;
mod search;
mod settings;
mod tried;

pub use objective::{Comparison, Figures};
pub use options::Options;
pub use outcome::Outcome;
pub use settings::{DEFAULT_KEYS, Setting};

use crate::campaign;
use crate::config::{Campaign, ConfigFile};
use crate::console;
use crate::output;
use crate::progress::{self, Progress};
use anyhow::{Result, bail};
use objective::Driven;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use tried::Tried;

/// Arguments of `sidehill tune`.
#[derive(Debug, Clone, clap::Args)]
pub struct TuneArgs {
    /// Campaign; or scenario, whose runs then differ by their seeds only.
    pub input: PathBuf,
    /// YAML file of the settings found, which `simulate --conditions` takes. Beside it a CSV file holds
    /// what was tried; where that exists, the search goes on from it.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// HTML file that compares before and after.
    #[arg(long, value_name = "FILE")]
    pub report: Option<PathBuf>,
    /// What is searched, and how.
    #[command(flatten)]
    pub options: Options,
    /// Overwrite --out and --report where they exist.
    #[arg(long)]
    pub force: bool,
    /// How the result is printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: crate::simulate::Format,
}

/// Searches and judges; `report` hears of each choice tried, with its number and mean cost, in the
/// caller's thread.
///
/// # Errors
/// What is wrong with options or campaign; a file of tries of another search; what the disk says; and
/// that of `report`, which ends the search.
pub fn tune(
    campaign: &Campaign,
    options: &Options,
    tried: Option<&Path>,
    mut report: impl FnMut(u32, f64) -> Result<()>,
) -> Result<Outcome> {
    options.check()?;
    let settings = Setting::all(campaign, &options.keys)?;
    let mut tried = Tried::open(
        tried,
        &search_name(campaign, options, &settings)?,
        &options.keys,
    )?;
    let pool = campaign::pool(options.threads)?;
    let drive = |factors: &[f64], runs: Range<u32>| -> Result<Vec<Driven>> {
        let changed = campaign.with_keys(&settings::mapping(&settings, factors))?;
        pool.install(|| objective::drive(&changed, options.controller, runs))
    };
    let begin = Instant::now();
    let present = vec![1.0; settings.len()];
    let before = drive(&present, options.training_runs())?;
    if !before.iter().any(|run| run.completed) {
        bail!("no run is completed under the present settings; there is nothing to compare with");
    }
    // The runs held out are driven twice, by present and by found settings.
    let share = 2.0 * f64::from(options.held_out) / f64::from(options.training);
    let all = Duration::from_secs_f64(60.0 * options.minutes);
    let deadline = begin + all.saturating_sub(begin.elapsed().mul_f64(share));
    search::search(settings.len(), options, |number, factors| {
        let cost = match tried.cost(number, factors)? {
            Some(cost) => cost,
            None if Instant::now() >= deadline => return Ok(None),
            None => {
                let now = drive(factors, options.training_runs())?;
                let runs = options.training_runs();
                let cost = Comparison::of(runs, &now, &before, options.calmness).cost;
                tried.add(factors, cost)?;
                cost
            }
        };
        report(number, cost)?;
        Ok(Some(cost))
    })?;
    let best = tried.best().unwrap_or_else(|| present.clone());
    let compare = |runs: Range<u32>, before: &[Driven]| -> Result<Comparison> {
        let now = drive(&best, runs.clone())?;
        Ok(Comparison::of(runs, &now, before, options.calmness))
    };
    let held_out = options.held_out_runs();
    let training = compare(options.training_runs(), &before)?;
    let held_out = compare(held_out.clone(), &drive(&present, held_out)?)?;
    let found = settings.iter().zip(&best);
    Ok(Outcome {
        name: campaign.name.clone(),
        controller: options.controller.name(),
        improved: held_out.improved(),
        settings: found
            .map(|(setting, factor)| setting.times(*factor))
            .collect(),
        tried: tried.costs(),
        training,
        held_out,
        calmness: options.calmness,
    })
}

/// Returns what makes a search the same: tries under another name do not belong to it.
fn search_name(campaign: &Campaign, options: &Options, settings: &[Setting]) -> Result<String> {
    let before: Vec<_> = settings
        .iter()
        .map(|setting| setting.before.to_string())
        .collect();
    Ok(format!(
        "campaign {} controller {} factor {} calmness {} training {} before {}",
        campaign.fingerprint()?,
        options.controller.name(),
        options.factor,
        options.calmness,
        options.training,
        before.join(" "),
    ))
}

/// Tunes, writes what was found, and prints it.
///
/// The exit status is 0 where the settings found are better, and 1 where the held-out runs do not show
/// that: then --out is not written.
///
/// # Errors
/// As [`tune`].
pub fn run(args: &TuneArgs) -> Result<ExitCode> {
    output::check_writable(&args.out, args.force)?;
    if let Some(report) = &args.report {
        output::check_writable(report, args.force)?;
    }
    let campaign = Campaign::read_any(&ConfigFile::read(&args.input)?)?;
    let tried = args.out.with_extension("tried.csv");
    let name = tried.display().to_string();
    progress::explain_interrupt(move || {
        format!("interrupted: what was tried is in {name}; the same command goes on from there")
    })?;
    let bar = Progress::new("tune", u64::from(args.options.tries));
    let outcome = tune(&campaign, &args.options, Some(&tried), |number, _| {
        bar.at(u64::from(number));
        Ok(())
    })?;
    bar.finish();
    if let Some(file) = &args.report {
        output::write(file, report::html(&outcome).as_bytes(), args.force)?;
    }
    if outcome.improved {
        output::write(&args.out, report::yaml(&outcome)?.as_bytes(), args.force)?;
    }
    match args.format {
        crate::simulate::Format::Table => console::text(report::table(&outcome)),
        crate::simulate::Format::Json => console::line(serde_json::to_string(&outcome)?),
    }
    Ok(if outcome.improved {
        ExitCode::SUCCESS
    } else {
        console::complain(format_args!(
            "{}: not written, the present settings stay",
            args.out.display()
        ));
        ExitCode::from(1)
    })
}
