//! A solve that begins with the rows that bind.

use super::condensed::stage;
use super::*;
use crate::mpc::clarabel_qp::SolveLimits;
use crate::mpc::working_set::WorkingSet;

/// Returns a QP, whether it has rows of treads, and the point that the interior-point method finds.
fn solved() -> impl Strategy<Value = (QpData, bool, Point)> {
    let stages = prop::collection::vec(stage(), 2..22);
    (stages, any::<bool>()).prop_filter_map("infeasible or degenerate", |(stages, treads)| {
        let limits = input_limits(if treads { 1.3 } else { 2.0 });
        let (mut condenser, mut data) = Condenser::new(stages.len(), 5, limits, None, COST_SCALE);
        condenser.assemble(&stages, motors(0.3, -0.2), None, &mut data);
        let mut solver = QpSolver::new(data.clone(), exact()).unwrap();
        solver.solve(None).ok()?;
        let point = solver.point().clone();
        // Of each row it is clear whether it binds.
        let rows = point.dual.iter().zip(&point.slack).skip(data.equalities);
        let mut apart = rows.map(|(dual, slack)| (dual - slack).abs());
        apart
            .all(|apart| apart > 1e-3)
            .then_some((data, treads, point))
    })
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter()
        .zip(b)
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f64::max)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]

    #[test]
    fn a_solve_that_begins_with_the_rows_of_a_solution_factorises_them_once(
        (data, treads, solution) in solved(),
    ) {
        let limits = SolveLimits::new(1);
        let mut working_set = WorkingSet::new(&data).unwrap();
        working_set.begin_with(&solution, &data);
        let (mut point, mut work) = (Point::zeros(&data), Point::zeros(&data));
        let binds = working_set.binds();
        let found = working_set.solve(&data, &mut point, &mut work, 1e-6, &limits).unwrap();
        prop_assert!(found.is_some());
        prop_assert_eq!(working_set.factorisations(), 1);
        prop_assert!(distance(&point.primal, &solution.primal) < 1e-3);

        if treads || !binds {
            return Ok(());
        }
        // One that begins without them takes more: cut short before the first it leaves the point, and after it the
        // optimum without limits.
        let mut working_set = WorkingSet::new(&data).unwrap();
        point.primal.fill(7.0);
        limits.begin_cycle(Some(0));
        let late = working_set.solve(&data, &mut point, &mut work, 1e-6, &limits);
        prop_assert_eq!(late, Err(QpFailure::Deadline { iterations: 0 }));
        prop_assert!(point.primal.iter().all(|value| *value == 7.0));
        limits.begin_cycle(Some(1));
        let late = working_set.solve(&data, &mut point, &mut work, 1e-6, &limits);
        prop_assert_eq!(late, Err(QpFailure::Deadline { iterations: 1 }));
        let mut relaxed = QpSolver::new(data.without_inequalities(), exact()).unwrap();
        relaxed.solve(None).unwrap();
        prop_assert!(distance(&point.primal, relaxed.primal()) < 1e-3);
    }
}
