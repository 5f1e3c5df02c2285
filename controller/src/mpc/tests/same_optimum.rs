//! Whatever way a QP is solved, its solution is that of clarabel with its defaults.
//!
//! 10,000 QPs take about a minute: `SIDEHILL_QP_CASES=10000 cargo test -p sidehill-controller
//! same_optimum`, as `.ci/test` has it. Without the variable it is a few hundred.

use super::closed_loop::{Course, settings};
use super::stages::{qp_of, stage};
use super::*;
use crate::mpc::sparse::Sparse;
use crate::mpc::stage_qp::Point;
use clarabel::solver::SupportedConeT::{NonnegativeConeT, ZeroConeT};
use clarabel::solver::{DefaultSettings, DefaultSolver, IPSolver};
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

/// Distance of costs, relative to 1 + |cost|: clarabel's defaults leave 1e-8, the solver's tolerance 1e-6
/// of the terms that the cost sums.
const SAME_COST: f64 = 1e-5;

fn cases() -> usize {
    let wanted = std::env::var("SIDEHILL_QP_CASES").ok();
    wanted.map_or(400, |count| count.parse().unwrap())
}

/// Evenly distributed from `low` to `high`.
fn within(random: &mut ChaCha8Rng, low: f64, high: f64) -> f64 {
    low + (high - low) * (random.next_u64() as f64 / u64::MAX as f64)
}

/// What the solves came to.
#[derive(Debug, Default)]
struct Counts {
    relaxed: usize,
    active_set: usize,
    interior_point: usize,
    failed_in_both: usize,
    /// Clarabel's defaults found nothing, where the residuals prove an optimum.
    only_here: usize,
    /// The other way round: a failure that is reported, not a wrong answer.
    only_with_defaults: usize,
}

/// Returns the solution of clarabel with its defaults; none where the KKT residuals do not prove it.
fn by_defaults(qp: &StageQp) -> Option<Point> {
    let data = Sparse::new(qp).data;
    let cones = [
        ZeroConeT(data.equalities),
        NonnegativeConeT(data.b.len() - data.equalities),
    ];
    let settings = DefaultSettings {
        verbose: false,
        ..DefaultSettings::default()
    };
    let QpData { p, q, a, b, .. } = &data;
    let mut solver = DefaultSolver::new(p, q, a, b, &cones, settings).unwrap();
    solver.solve();
    let mut point = qp.zeros();
    let variables = solver.solution.x.chunks_exact(5);
    for (inputs, own) in point.rollout.inputs.iter_mut().zip(variables) {
        inputs.copy_from_slice(&own[3..]);
    }
    let sides = solver.solution.z[data.equalities..].chunks_exact(2);
    for (multiplier, sides) in point.multipliers.iter_mut().zip(sides) {
        *multiplier = sides[0] - sides[1];
    }
    qp.roll(&mut point.rollout);
    let residuals = qp.residuals(&point, &mut qp.work());
    residuals.within(1e-6).then_some(point)
}

/// Solves a QP with both; the one that keeps its rows from QP to QP is `solver`.
fn compare(solver: &mut QpSolver, qp: &StageQp, counts: &mut Counts, what: &str) {
    solver.qp_mut().clone_from(qp);
    let found = solver.solve(None);
    let expected = by_defaults(qp);
    match (found, &expected) {
        (Ok(residuals), Some(reference)) => {
            let mut work = qp.work();
            let mut cost = |point: &Point| qp.cost(&point.rollout, &mut work);
            let (cost, least) = (cost(solver.point()), cost(reference));
            // What the violation of rows that is let pass can be worth.
            let values = (0..qp.rows().len()).map(|row| qp.value(row, &solver.point().rollout));
            let largest = values.fold(1.0_f64, |m, value| m.max(value.abs()));
            let price: f64 = reference.multipliers.iter().map(|y| y.abs()).sum();
            let worth = 2.0 * residuals.primal * largest * price;
            assert!(
                (cost - least).abs() <= SAME_COST * (1.0 + least.abs()) + worth,
                "{what}: {cost}, expected {least} ({residuals:?}, {:?})",
                solver.path()
            );
        }
        (Ok(residuals), None) => {
            // The KKT residuals prove it.
            assert!(residuals.within(1e-5), "{what}: {residuals:?}");
            counts.only_here += 1;
        }
        // The solver's QPs are scaled by their maker, clarabel's defaults by clarabel.
        (Err(_), Some(_)) if what.ends_with("wildly scaled") => counts.only_with_defaults += 1,
        (Err(failure), Some(_)) => panic!("{what}: {failure}"),
        (Err(_), None) => counts.failed_in_both += 1,
    }
    match solver.path() {
        SolvePath::Relaxed => counts.relaxed += 1,
        SolvePath::ActiveSet => counts.active_set += 1,
        SolvePath::InteriorPoint => counts.interior_point += 1,
        SolvePath::CutShort => panic!("{what}: nothing cuts it short"),
    }
}

/// Rows that bind without a force: ends at which a point is.
fn degenerate(qp: &mut StageQp, path: &stage_qp::Rollout, random: &mut ChaCha8Rng) {
    for row in 0..qp.rows().len() {
        if within(random, 0.0, 1.0) < 0.2 {
            let value = qp.value(row, path);
            let (stage, place) = (qp.stage_of(row), row % qp.input_rows());
            qp.rows_mut(stage).0[place].high = value;
        }
    }
}

/// Ends with next to no room between them.
fn nearly_infeasible(qp: &mut StageQp, random: &mut ChaCha8Rng) {
    for stage in 0..qp.stages.len() {
        // The changes of a motor.
        let row = 1 + 2 * usize::from(within(random, 0.0, 1.0) < 0.5);
        if within(random, 0.0, 1.0) < 0.3 {
            let row = &mut qp.rows_mut(stage).0[row];
            row.low = row.high - 1e-9;
        }
    }
}

/// Cost and rows in other units.
fn wildly_scaled(qp: &mut StageQp, random: &mut ChaCha8Rng) {
    let cost = 10.0_f64.powf(within(random, -4.0, 4.0));
    for stage in 0..qp.stages.len() {
        let terms = &mut qp.stages[stage];
        let weights = terms.weight.as_flattened_mut().iter_mut();
        let weights = weights
            .chain(&mut terms.force)
            .chain(&mut terms.change_weight);
        for value in weights.chain([&mut terms.speed_weight]) {
            *value *= cost;
        }
        for row in qp.rows_mut(stage).0 {
            let size = 10.0_f64.powf(within(random, -2.0, 2.0));
            for value in row.by.iter_mut().chain(&mut row.by_before) {
                *value *= size;
            }
            (row.low, row.high) = (size * row.low, size * row.high);
        }
    }
}

/// A QP and what becomes of it when it is spoiled, one after the other in one solver.
fn compare_with_variants(qp: &StageQp, random: &mut ChaCha8Rng, counts: &mut Counts, what: &str) {
    let mut solver = QpSolver::new(qp.clone(), QpSettings::default()).unwrap();
    solver.set_max_iterations(settings::ITERATIONS_MAX);
    compare(&mut solver, qp, counts, what);
    let solution = solver.point().rollout.clone();
    let mut spoiled = qp.clone();
    degenerate(&mut spoiled, &solution, random);
    compare(
        &mut solver,
        &spoiled,
        counts,
        &format!("{what}, degenerate"),
    );
    let mut spoiled = qp.clone();
    nearly_infeasible(&mut spoiled, random);
    compare(
        &mut solver,
        &spoiled,
        counts,
        &format!("{what}, nearly infeasible"),
    );
    let mut spoiled = qp.clone();
    wildly_scaled(&mut spoiled, random);
    compare(
        &mut solver,
        &spoiled,
        counts,
        &format!("{what}, wildly scaled"),
    );
}

#[test]
fn random_qps_have_the_same_optimum() {
    let mut runner = TestRunner::deterministic();
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut counts = Counts::default();
    for case in 0..cases() * 7 / 80 {
        let stages = prop::collection::vec(stage(), 2..22)
            .new_tree(&mut runner)
            .unwrap()
            .current();
        let mut draw = |low, high| within(&mut random, low, high);
        let limits = input_limits(if draw(0.0, 1.0) < 0.5 {
            2.0
        } else {
            draw(1.1, 1.7)
        });
        let previous = motors(draw(-0.6, 0.6), draw(-0.5, 0.5));
        let qp = qp_of(&stages, previous, &limits);
        compare_with_variants(&qp, &mut random, &mut counts, &format!("case {case}"));
    }
    println!("{counts:?}");
    // Where a row hardly binds or hardly does not, both methods have to work it out.
    assert!(counts.active_set > counts.interior_point, "{counts:?}");
    assert!(200 * counts.only_with_defaults <= cases(), "{counts:?}");
}

#[test]
fn qps_of_a_drive_have_the_same_optimum() {
    let mut random = ChaCha8Rng::seed_from_u64(2);
    let mut counts = Counts::default();
    let mut course = Course::new();
    let mut mpc = Mpc::new(settings(40), PredictionModel::new(Vehicle::j8(), 0.02)).unwrap();
    let mut replayed: Option<QpSolver> = None;
    for cycle in 0..cases() * 13 / 20 {
        // Readings that jump make limits bind.
        let size = if cycle % 200 < 100 { 0.02 } else { 0.2 };
        course.pose.x_m += within(&mut random, -size, size);
        course.pose.y_m += within(&mut random, -size, size);
        course.pose.yaw_rad += within(&mut random, -size, size);
        course.solve(&mut mpc).unwrap();
        course.drive(&mpc);
        let qp = mpc.solver.qp().clone();
        let solver = replayed
            .get_or_insert_with(|| QpSolver::new(qp.clone(), QpSettings::default()).unwrap());
        compare(solver, &qp, &mut counts, &format!("cycle {cycle}"));
    }
    println!("{counts:?}");
    assert!(counts.active_set > 0, "{counts:?}");
    assert_eq!(counts.failed_in_both + counts.only_here, 0, "{counts:?}");
    assert!(100 * counts.interior_point <= cases(), "{counts:?}");
}
