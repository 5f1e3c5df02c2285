//! The longest control cycles of a campaign, and what they did:
//!
//!     cargo bench --bench worst_cycle -- [CAMPAIGN [RUNS [CONTROLLER]]]
//!
//! Without arguments all runs of the default campaign with its controllers, one after the other. A run computes the same in
//! each repetition, so the runs of the longest cycles are repeated: the least time of a cycle is the
//! controller's, what the others have more is the machine's.

// A bench that cannot be set up has nothing to report.
#![allow(clippy::unwrap_used)]

use sidehill::closed_loop;
use sidehill::config::{Campaign, ConfigFile, Overrides, Scenario};
use sidehill::console;
use sidehill::record::{Quantiles, Row, Run};
use sidehill_controller::config::ControllerKind;
use std::path::PathBuf;
use std::time::Instant;

/// Longest cycles whose runs are repeated, for each controller.
const REPEATED: usize = 40;
/// How often.
const REPETITIONS: usize = 4;
/// How many of them are listed.
const LISTED: usize = 10;
/// Pause after each run, in shares of its time: Linux suspends a real-time process that does not sleep
/// for 5 % of each second.
const PAUSE: f64 = 0.1;

/// One cycle of a run.
struct LongCycle {
    run: u32,
    index: usize,
    row: Row,
    /// Least time of all repetitions, us.
    least_us: f64,
}

fn main() {
    // Cargo itself appends `--bench`.
    let arguments: Vec<_> = std::env::args()
        .skip(1)
        .filter(|argument| !argument.starts_with("--"))
        .collect();
    let default = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("config/campaigns/default.yaml");
    let file = arguments.first().map_or(default, PathBuf::from);
    let campaign = Campaign::read(&ConfigFile::read(&file).unwrap()).unwrap();
    let runs = arguments.get(1).map(|runs| runs.parse().unwrap());
    let runs = runs.unwrap_or(campaign.runs);
    let named = arguments
        .get(2)
        .map(|name| ControllerKind::from_name(name).unwrap());
    for kind in named.map_or(campaign.controllers.clone(), |kind| vec![kind]) {
        report(&campaign, kind, runs);
    }
}

fn drive(campaign: &Campaign, kind: ControllerKind, index: u32) -> Run {
    let prepared = Scenario::read(campaign.draw(index).unwrap().scenario)
        .unwrap()
        .prepare(&Overrides {
            controllers: vec![kind],
            ..Overrides::default()
        })
        .unwrap();
    let begin = Instant::now();
    let run = closed_loop::run(&prepared, kind, |_| {}, None).unwrap();
    std::thread::sleep(begin.elapsed().mul_f64(PAUSE));
    run
}

fn report(campaign: &Campaign, kind: ControllerKind, runs: u32) {
    let mut times_us = Vec::new();
    let mut longest: Vec<LongCycle> = Vec::new();
    let mut deadline_misses = 0;
    for run in 0..runs {
        let driven = drive(campaign, kind, run);
        deadline_misses += driven.summary.deadline_misses;
        for (index, row) in driven.rows.into_iter().enumerate() {
            let cycle_us = row.cycle_us;
            times_us.push(cycle_us);
            let place = longest.partition_point(|cycle| cycle.row.cycle_us >= cycle_us);
            if place < REPEATED {
                longest.truncate(REPEATED - 1);
                longest.insert(
                    place,
                    LongCycle {
                        run,
                        index,
                        row,
                        least_us: cycle_us,
                    },
                );
            }
        }
    }
    for cycle in &mut longest {
        for _ in 0..REPETITIONS {
            let again = drive(campaign, kind, cycle.run);
            cycle.least_us = cycle.least_us.min(again.rows[cycle.index].cycle_us);
        }
    }
    longest.sort_by(|a, b| b.least_us.total_cmp(&a.least_us));
    let count = times_us.len();
    let quantiles = Quantiles::of(times_us);
    console::line(format_args!(
        "{}, {runs} runs, {count} cycles, {deadline_misses} longer than a period; us: p50 {:.0}, p99 {:.0}, \
         p99.9 {:.0}, worst {:.0}, worst in all repetitions {:.0}",
        kind.name(),
        quantiles.p50,
        quantiles.p99,
        quantiles.p999,
        quantiles.max,
        longest.first().map_or(0.0, |cycle| cycle.least_us),
    ));
    console::line("   run  time s  first us  least us  systems  found by");
    for cycle in longest.iter().take(LISTED) {
        let row = &cycle.row;
        console::line(format_args!(
            "{:6} {:7.2} {:9.0} {:9.0} {:8}  {}",
            cycle.run,
            row.time_s,
            row.cycle_us,
            cycle.least_us,
            row.qp_iterations,
            row.qp_path
                .map_or_else(String::new, |path| format!("{path:?}")),
        ));
    }
}
