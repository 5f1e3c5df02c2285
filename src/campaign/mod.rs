//! `sidehill campaign`: many seeded simulations, all cores, one row of a CSV file each.

mod results;
mod summary;

use crate::closed_loop;
use crate::config::{Campaign, ConfigFile, Overrides, Scenario};
use crate::record::Summary;
use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressStyle};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use results::{Outcome, Results};
use sidehill_controller::config::ControllerKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::PathBuf;

/// Arguments of `sidehill campaign`.
#[derive(Debug, Clone, clap::Args)]
pub struct CampaignArgs {
    /// Campaign: a scenario and what is drawn for each run.
    pub campaign: PathBuf,
    /// CSV file of the results. Where it exists, what it holds is not run again.
    #[arg(long, value_name = "FILE")]
    pub out: PathBuf,
    /// Runs of each controller instead of the campaign's.
    #[arg(long)]
    pub runs: Option<u32>,
    /// Simulations at a time instead of one a core.
    #[arg(long)]
    pub threads: Option<usize>,
    /// Write the scenario of one run, for `simulate`, to --out instead.
    #[arg(long, value_name = "INDEX")]
    pub write_scenario: Option<u32>,
    /// How the summary is printed.
    #[arg(long, value_enum, default_value_t)]
    pub format: crate::simulate::Format,
}

/// Runs what the results do not hold yet and prints the summary of all.
///
/// # Errors
/// What is wrong with the campaign; results of another campaign; a file that cannot be read or
/// written. A run that fails is no error but a row.
pub fn run(args: &CampaignArgs) -> Result<()> {
    let mut campaign = Campaign::read(&ConfigFile::read(&args.campaign)?)?;
    let out = &args.out;
    if let Some(index) = args.write_scenario {
        let text = campaign.scenario_text(index)?;
        return std::fs::write(out, text)
            .with_context(|| format!("{}: cannot be written", out.display()));
    }
    campaign.runs = args.runs.unwrap_or(campaign.runs);
    let results = Results::open(out, &campaign)?;
    let missing: Vec<(u32, ControllerKind)> = (0..campaign.runs)
        .flat_map(|index| campaign.controllers.iter().map(move |&kind| (index, kind)))
        .filter(|(index, kind)| !results.holds(*index, *kind))
        .collect();
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(args.threads.unwrap_or(0))
        .build()?;
    let style = ProgressStyle::with_template("{bar:40} {pos}/{len}  {elapsed} gone, {eta} left")?;
    // Hidden by itself where standard error is not a terminal.
    let bar = ProgressBar::new(missing.len() as u64).with_style(style);
    pool.install(|| {
        missing.into_par_iter().try_for_each(|(index, kind)| {
            results.append(&outcome(&campaign, index, kind))?;
            bar.inc(1);
            anyhow::Ok(())
        })
    })?;
    bar.finish_and_clear();
    let rows = results::read(out, &campaign)?;
    let figures = summary::of(&rows, &campaign);
    match args.format {
        crate::simulate::Format::Table => print!("{}", summary::table(&figures, &campaign)),
        crate::simulate::Format::Json => println!(
            "{}",
            serde_json::to_string(&serde_json::json!({ "controllers": figures }))?
        ),
    }
    Ok(())
}

/// Drives one run with one controller; whatever goes wrong is part of the outcome.
fn outcome(campaign: &Campaign, index: u32, kind: ControllerKind) -> Outcome {
    let (seed, values, figures) = match campaign.draw(index) {
        Ok(drawn) => {
            let figures = catch_unwind(AssertUnwindSafe(|| drive(drawn.scenario, kind)))
                .unwrap_or_else(|_| Err(anyhow::anyhow!("the simulation panicked")));
            (drawn.seed, drawn.values, figures)
        }
        Err(error) => (0, Vec::new(), Err(error.into())),
    };
    Outcome {
        index,
        seed,
        kind,
        values,
        figures: figures.map_err(|error| format!("{error:#}")),
    }
}

fn drive(scenario: ConfigFile, kind: ControllerKind) -> Result<Summary> {
    let prepared = Scenario::read(scenario)?.prepare(&Overrides {
        controllers: vec![kind],
        ..Overrides::default()
    })?;
    Ok(closed_loop::run(&prepared, kind, |_| {}, None)?.summary)
}
