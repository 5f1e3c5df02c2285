//! `sidehill campaign`: many seeded simulations on all cores, one CSV row each.

mod merge;
mod report;
mod results;
mod summary;
mod table;
mod worst;

pub use results::Results;

use crate::closed_loop;
use crate::config::{Campaign, ConfigFile, Overrides, Scenario};
use crate::console;
use crate::output;
use crate::progress::{self, TaskProgress};
use crate::record::Summary;
use anyhow::{Result, bail};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use sidehill_controller::config::ControllerKind;
use std::ops::Range;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;
use std::time::Instant;
use table::{CampaignTable, RunOutcome};

/// Arguments of `sidehill campaign`.
#[derive(Debug, Clone, clap::Args)]
pub struct CampaignArgs {
    /// Campaign: a scenario and what is drawn for each run.
    #[arg(required_unless_present = "merge")]
    pub campaign: Option<PathBuf>,
    /// CSV file of the results. Runs that it already contains are not repeated. Without it --merge
    /// writes to standard output.
    #[arg(long, value_name = "FILE", required_unless_present = "merge")]
    pub out: Option<PathBuf>,
    /// Runs of each controller instead of the campaign's.
    #[arg(long)]
    pub runs: Option<u32>,
    /// Only the runs from A to B - 1, for one of several machines.
    #[arg(long, value_name = "A..B", value_parser = range, conflicts_with = "runs")]
    pub range: Option<Range<u32>>,
    /// Number of parallel simulations, instead of one for each core.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Record the N worst runs, those that did not complete first, into the folder of the results with
    /// the ending .worst: `sidehill replay` reads them.
    #[arg(long, value_name = "N")]
    pub keep_worst: Option<usize>,
    /// Write the scenario of one run, for `simulate`, to --out instead.
    #[arg(long, value_name = "INDEX")]
    pub write_scenario: Option<u32>,
    /// HTML file for a report with plots and conclusions.
    #[arg(long, value_name = "FILE", conflicts_with_all = ["merge", "write_scenario"])]
    pub report: Option<PathBuf>,
    /// Overwrite --report, or --out of --write-scenario, where it exists; results are never overwritten.
    #[arg(long)]
    pub force: bool,
    /// Merges the results of parts of one campaign into the file that one machine would have
    /// written; runs nothing.
    #[arg(long, value_name = "FILES", num_args = 1..,
          conflicts_with_all = ["campaign", "runs", "range", "threads", "write_scenario", "format"])]
    pub merge: Vec<PathBuf>,
    /// How the summary is printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: crate::simulate::Format,
}

fn range(text: &str) -> Result<Range<u32>, String> {
    let bounds = text.split_once("..").map(|(a, b)| (a.parse(), b.parse()));
    match bounds {
        Some((Ok(from), Ok(to))) if from < to => Ok(from..to),
        _ => Err("two numbers of runs are needed as in 0..500, the second larger".to_owned()),
    }
}

/// Runs what the results do not contain yet and prints the summary of all runs; or merges results.
///
/// # Errors
/// What is wrong with the campaign; results of another campaign; a file that cannot be read or
/// written. A run that fails is not an error but a row.
pub fn run(args: &CampaignArgs) -> Result<()> {
    if !args.merge.is_empty() {
        return merge::run(&args.merge, args.out.as_deref());
    }
    let (Some(file), Some(out)) = (&args.campaign, &args.out) else {
        bail!("a campaign and --out are needed");
    };
    let campaign = Campaign::read(&ConfigFile::read(file)?)?;
    if let Some(index) = args.write_scenario {
        let text = campaign.scenario_text(index)?;
        return output::write(out, text.as_bytes(), args.force);
    }
    if let Some(path) = &args.report {
        output::check_writable(path, args.force)?;
    }
    let runs = args.range.clone();
    let runs = runs.unwrap_or(0..args.runs.unwrap_or(campaign.runs));
    let results = Results::open(out, &campaign)?;
    let missing: Vec<_> = jobs(&campaign, runs.clone())
        .filter(|(index, kind)| !results.holds(*index, *kind))
        .collect();
    let (all, begun, name) = (missing.len(), Instant::now(), out.display().to_string());
    if all > 0 {
        console::complain(format_args!("{name}: {all} simulations to be done"));
    }
    progress::explain_interrupt(move || {
        format!(
            "interrupted after {:.0} s: the finished runs are in {name}; repeat the command to continue",
            begun.elapsed().as_secs_f64()
        )
    })?;
    let bar = TaskProgress::new("campaign", all as u64);
    pool(args.threads)?.install(|| {
        missing.into_par_iter().try_for_each(|(index, kind)| {
            results.append(&outcome(&campaign, index, kind))?;
            bar.step();
            anyhow::Ok(())
        })
    })?;
    bar.finish();
    let rows = CampaignTable::of(&campaign)?.rows(&results.finish()?)?;
    if let Some(count) = args.keep_worst {
        for file in worst::keep(&campaign, &rows, count, out)? {
            console::complain(format_args!("recorded {}", file.display()));
        }
    }
    let figures = summary::of(&rows, &campaign, &runs);
    if let Some(path) = &args.report {
        let own: Vec<_> = rows
            .iter()
            .filter(|row| runs.contains(&row.index))
            .collect();
        let page = report::html(&campaign.name, &figures, &own);
        output::write(path, page.as_bytes(), args.force)?;
    }
    match args.format {
        crate::simulate::Format::Table => {
            console::text(summary::table(&figures, &campaign, &runs));
        }
        crate::simulate::Format::Json => console::line(serde_json::to_string(
            &serde_json::json!({ "controllers": figures }),
        )?),
    }
    Ok(())
}

/// Returns the results of `runs` as the text of a file, in order.
///
/// # Errors
/// Why the campaign cannot run at all. A run that fails is not an error but a row.
pub fn csv(campaign: &Campaign, runs: Range<u32>, threads: Option<usize>) -> Result<Vec<u8>> {
    let table = CampaignTable::of(campaign)?;
    let mut jobs: Vec<_> = jobs(campaign, runs).collect();
    jobs.sort_by_key(|(index, kind)| (*index, kind.name()));
    let lines = pool(threads)?.install(|| {
        jobs.into_par_iter()
            .map(|(index, kind)| table.line(&outcome(campaign, index, kind)))
            .collect::<Result<Vec<_>>>()
    })?;
    Ok([table.header_line()?, lines.concat()].concat())
}

fn jobs(
    campaign: &Campaign,
    runs: Range<u32>,
) -> impl Iterator<Item = (u32, ControllerKind)> + use<'_> {
    let kinds = &campaign.controllers;
    runs.flat_map(move |index| kinds.iter().map(move |&kind| (index, kind)))
}

/// Returns a pool of `threads` threads, by default one per core.
pub(crate) fn pool(threads: Option<usize>) -> Result<rayon::ThreadPool> {
    let builder = rayon::ThreadPoolBuilder::new().num_threads(threads.unwrap_or(0));
    Ok(builder.build()?)
}

/// Drives one run with one controller; whatever goes wrong is part of the outcome.
fn outcome(campaign: &Campaign, index: u32, kind: ControllerKind) -> RunOutcome {
    let (seed, values, figures) = match campaign.draw(index) {
        Ok(drawn) => {
            let figures = catch_unwind(AssertUnwindSafe(|| drive(drawn.scenario, kind)))
                .unwrap_or_else(|_| Err(anyhow::anyhow!("the simulation panicked")));
            (drawn.seed, drawn.values, figures)
        }
        Err(error) => (0, Vec::new(), Err(error.into())),
    };
    RunOutcome {
        index,
        seed,
        kind,
        values,
        figures: figures.map_err(|error| format!("{error:#}")),
    }
}

/// Returns the figures of one run with one controller.
///
/// # Errors
/// Why the run cannot start.
pub(crate) fn drive(scenario: ConfigFile, kind: ControllerKind) -> Result<Summary> {
    let prepared = Scenario::read(scenario)?.prepare(&Overrides {
        controllers: vec![kind],
        ..Overrides::default()
    })?;
    Ok(closed_loop::run(&prepared, kind, |_| {}, None)?.summary)
}
