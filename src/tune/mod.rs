//! `sidehill tune`: settings of a controller that drive a campaign better, or predict a recorded drive better,
//! judged by runs that the search has not seen.

mod objective;
mod options;
mod outcome;
mod recorded;
mod report;
mod search;
mod settings;
mod subject;
mod tried;

use crate::exit::Exit;
pub use objective::{TrialComparison, TrialFigures};
pub use options::Options;
pub use outcome::TuningOutcome;
pub use settings::{DEFAULT_KEYS, Setting};
pub use subject::SubjectKind;

use crate::campaign;
use crate::config::{Campaign, ConfigFile};
use crate::console;
use crate::output;
use crate::progress::{self, TaskProgress};
use anyhow::{Result, bail};
use objective::Driven;
use serde_yaml::Value;
use sidehill_controller::config::ControllerKind;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::time::{Duration, Instant};
use subject::Subject;
use tried::Tried;

/// Arguments of `sidehill tune`.
#[derive(Debug, Clone, clap::Args)]
pub struct TuneArgs {
    /// Campaign; scenario, whose runs then differ by their seeds only; or recording (.mcap) of a drive, which
    /// judges settings of the estimator.
    pub input: PathBuf,
    /// YAML file for the settings found, for `simulate --conditions`. A CSV file beside it records
    /// the settings tried; if it exists, the search continues from it.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// HTML file that compares the settings before and after.
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

/// Searches and judges. `report` is called for each trial, with its number and mean cost, in the caller's thread.
///
/// # Errors
/// Invalid options or an invalid campaign; the trials of another search; an I/O error; or an error of `report`,
/// which ends the search.
pub fn tune(
    campaign: &Campaign,
    options: &Options,
    tried: Option<&Path>,
    report: impl FnMut(u32, f64) -> Result<()>,
) -> Result<TuningOutcome> {
    options.check()?;
    let controller = options.controller.unwrap_or(ControllerKind::IcrikMpc);
    let Value::Mapping(present) = serde_yaml::to_value(campaign.controller_settings()?)? else {
        bail!("the settings of the controllers are not a mapping");
    };
    let drawn = |key: &str| campaign.keys().any(|drawn| drawn == key);
    let settings = Setting::all(&present, &options.keys, drawn)?;
    let pool = campaign::pool(options.threads)?;
    let searched = settings.clone();
    let subject = Subject {
        kind: SubjectKind::Campaign,
        name: campaign.name.clone(),
        fingerprint: format!("campaign {}", campaign.fingerprint()?),
        controller,
        settings,
        training: options.training_runs(),
        held_out: options.held_out_runs(),
        drive: Box::new(move |factors, runs| {
            let changed = campaign.with_keys(&settings::mapping(&searched, factors))?;
            pool.install(|| objective::drive(&changed, controller, runs))
        }),
    };
    search_on(&subject, options, tried, report)
}

fn search_on(
    subject: &Subject<'_>,
    options: &Options,
    tried: Option<&Path>,
    mut report: impl FnMut(u32, f64) -> Result<()>,
) -> Result<TuningOutcome> {
    let (settings, drive) = (&subject.settings, &subject.drive);
    let keys: Vec<String> = settings.iter().map(|setting| setting.key.clone()).collect();
    let mut tried = Tried::open(tried, &search_name(subject, options), &keys)?;
    let begin = Instant::now();
    let present = vec![1.0; settings.len()];
    let runs = || subject.training.clone();
    let before = drive(&present, runs())?;
    if !before.iter().any(|run| run.completed) {
        bail!("no run is completed under the present settings; there is nothing to compare with");
    }
    if let [first, others @ ..] = before.as_slice()
        && !others.is_empty()
        && others.iter().all(|run| run == first)
    {
        bail!(
            "{}: its {} training runs are equal: no seed or draw changes anything, so they are one run and prove \
             nothing; give the scenario noise (`sensors`, `model_error` or --conditions of a campaign), or name a campaign \
             with `draws`",
            subject.name,
            before.len()
        );
    }
    // The held-out runs are driven twice, with present and with found settings.
    let count = |runs: &Range<u32>| f64::from(runs.end - runs.start);
    let share = 2.0 * count(&subject.held_out) / count(&subject.training);
    let all = Duration::from_secs_f64(60.0 * options.minutes);
    let deadline = begin + all.saturating_sub(begin.elapsed().mul_f64(share));
    search::search(settings.len(), options, |number, factors| {
        let cost = match tried.cost(number, factors)? {
            Some(cost) => cost,
            None if Instant::now() >= deadline => return Ok(None),
            None => {
                let now = drive(factors, runs())?;
                let cost = TrialComparison::of(runs(), &now, &before, options.calmness).cost;
                tried.add(factors, cost)?;
                cost
            }
        };
        report(number, cost)?;
        Ok(Some(cost))
    })?;
    let best = tried.best().unwrap_or_else(|| present.clone());
    let compare = |runs: Range<u32>, before: &[Driven]| -> Result<TrialComparison> {
        let now = drive(&best, runs.clone())?;
        Ok(TrialComparison::of(runs, &now, before, options.calmness))
    };
    let training = compare(runs(), &before)?;
    let held_out = subject.held_out.clone();
    let held_out = compare(held_out.clone(), &drive(&present, held_out)?)?;
    let found = settings.iter().zip(&best);
    Ok(TuningOutcome {
        name: subject.name.clone(),
        subject: subject.kind,
        controller: subject.controller.name(),
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

/// Returns the identity of a search: trials with another identity do not belong to it.
fn search_name(subject: &Subject<'_>, options: &Options) -> String {
    let before: Vec<_> = subject
        .settings
        .iter()
        .map(|setting| setting.before.to_string())
        .collect();
    format!(
        "{} build {} controller {} factor {} calmness {} training {} before {}",
        subject.fingerprint,
        crate::config::BUILD,
        subject.controller.name(),
        options.factor,
        options.calmness,
        subject.training.end,
        before.join(" "),
    )
}

/// Returns whether a file is a recording rather than a campaign or scenario.
fn is_recording(path: &Path) -> bool {
    path.extension().is_some_and(|ending| ending == "mcap")
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
    let tried = args.out.with_extension("tried.csv");
    let name = tried.display().to_string();
    progress::explain_interrupt(move || {
        format!("interrupted: the trials are in {name}; repeat the command to continue")
    })?;
    let bar = TaskProgress::new("tune", u64::from(args.options.tries));
    let heard = |number, _| {
        bar.at(u64::from(number));
        Ok(())
    };
    let outcome = if is_recording(&args.input) {
        of_recording(&args.input, &args.options, &tried, heard)?
    } else {
        let campaign = Campaign::read_any(&ConfigFile::read(&args.input)?)?;
        tune(&campaign, &args.options, Some(&tried), heard)?
    };
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
    if !outcome.improved {
        console::complain(format_args!(
            "{}: not written, the present settings stay",
            args.out.display()
        ));
    }
    Ok(Exit::answer(outcome.improved).into())
}

fn of_recording(
    recording: &Path,
    options: &Options,
    tried: &Path,
    report: impl FnMut(u32, f64) -> Result<()>,
) -> Result<TuningOutcome> {
    options.check()?;
    let subject = recorded::subject(recording, options)?;
    search_on(&subject, options, Some(tried), report)
}
