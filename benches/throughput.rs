//! Time of a whole simulated run, which is what campaigns are made of: `cargo bench --bench throughput`.
//!
//! Criterion prints runs a second ("elem/s") on one core.

// A bench that cannot be set up has nothing to report.
#![allow(clippy::unwrap_used, missing_docs)]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use sidehill::closed_loop;
use sidehill::config::{Campaign, ConfigFile, DEFAULT_SCENARIO, Overrides, Prepared, Scenario};
use std::hint::black_box;
use std::path::Path;

/// Runs of the default campaign that are timed.
const RUNS: u32 = 8;

fn drive(prepared: &Prepared) {
    for &kind in &prepared.controllers {
        black_box(closed_loop::run(prepared, kind, |_| {}, None)).unwrap();
    }
}

/// The run without arguments: four controllers on the figure of eight.
fn simulate(criterion: &mut Criterion) {
    let file = ConfigFile::built_in(DEFAULT_SCENARIO).unwrap();
    let prepared = Scenario::read(file)
        .unwrap()
        .prepare(&Overrides::default())
        .unwrap();
    let mut group = criterion.benchmark_group("simulate");
    group.sample_size(10);
    group.throughput(Throughput::Elements(prepared.controllers.len() as u64));
    group.bench_function("figure_eight", |bencher| bencher.iter(|| drive(&prepared)));
    group.finish();
}

/// The first runs of the default campaign, all its controllers.
fn campaign(criterion: &mut Criterion) {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("config/campaigns/default.yaml");
    let campaign = Campaign::read(&ConfigFile::read(&file).unwrap()).unwrap();
    let runs: Vec<Prepared> = (0..RUNS)
        .map(|index| {
            let drawn = campaign.draw(index).unwrap();
            Scenario::read(drawn.scenario)
                .unwrap()
                .prepare(&Overrides {
                    controllers: campaign.controllers.clone(),
                    ..Overrides::default()
                })
                .unwrap()
        })
        .collect();
    let mut group = criterion.benchmark_group("campaign");
    group.sample_size(10);
    let count = runs.len() * campaign.controllers.len();
    group.throughput(Throughput::Elements(count as u64));
    group.bench_function("default", |bencher| {
        bencher.iter(|| runs.iter().for_each(drive));
    });
    group.finish();
}

criterion_group!(benches, simulate, campaign);
criterion_main!(benches);
