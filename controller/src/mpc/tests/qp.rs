//! The solver against problems whose answers are known, and its failures.

use super::*;
use crate::mpc::stage_qp::StageRow;
use std::time::Duration;

/// minimise 1/2 (x^2 + 2 y^2) + q'(x, y)   subject to   low <= x + y <= high,  x <= x_max,  y >= y_min
///
/// of the inputs (x, y) of one stage; x and y are those of the rows for bounds and changes of the motors.
fn small([low, high]: [f64; 2], x_max: f64, y_min: f64, q: [f64; 2]) -> StageQp {
    let mut qp = StageQp::new(1, false, 1);
    let terms = &mut qp.stages[0];
    (terms.weight[3][3], terms.weight[4][4]) = (1.0, 2.0);
    terms.force[3..].copy_from_slice(&q);
    let (rows, extra) = qp.rows_mut(0);
    rows[0].high = x_max;
    rows[2].low = y_min;
    extra[0] = StageRow {
        by: [0.0, 0.0, 0.0, 1.0, 1.0],
        by_before: [0.0; 2],
        low,
        high,
    };
    qp
}

/// The same with a sum of 3 and y not negative.
fn of_three(x_max: f64, q: [f64; 2]) -> StageQp {
    small([3.0; 2], x_max, 0.0, q)
}

fn solver(qp: StageQp) -> QpSolver {
    QpSolver::new(qp, exact()).unwrap()
}

fn inputs(solver: &QpSolver) -> [f64; 2] {
    solver.point().rollout.inputs[0]
}

fn assert_near(found: [f64; 2], expected: [f64; 2]) {
    let near = |i: usize| (found[i] - expected[i]).abs() < 1e-6;
    assert!(near(0) && near(1), "{found:?}, expected {expected:?}");
}

const MODES: [QpMode; 2] = [QpMode::ActiveSet, QpMode::InteriorPoint];

#[test]
fn known_optima_are_found_and_their_residuals_vanish() {
    for mode in MODES {
        let settings = QpSettings { mode, ..exact() };
        let mut solver = QpSolver::new(of_three(10.0, [0.0, 0.0]), settings).unwrap();
        for (qp, expected) in [
            // Free: x = 2 y by the gradient, so (2/3, 1/3) of the sum. Bound: the rest goes to y.
            (of_three(10.0, [0.0, 0.0]), [2.0, 1.0]),
            (of_three(0.5, [0.0, 0.0]), [0.5, 2.5]),
            // A price on y drives it to its bound.
            (of_three(10.0, [0.0, 100.0]), [3.0, 0.0]),
            (small([-1.0, 5.0], 10.0, 0.0, [-1.0, -2.0]), [1.0, 1.0]),
            (
                small([2.5, 5.0], 10.0, 0.0, [-1.0, -2.0]),
                [4.0 / 3.0, 3.5 / 3.0],
            ),
        ] {
            *solver.qp_mut() = qp;
            let residuals = solver.solve(None).unwrap();
            assert_near(inputs(&solver), expected);
            assert!(residuals.within(1e-6), "{residuals:?}");
        }
        assert_eq!(solver.rebuilds(), 0);
    }
}

#[test]
fn the_rows_that_bind_are_found_and_kept_for_the_next_solve() {
    let mut solver = QpSolver::new(of_three(10.0, [0.0, 0.0]), QpSettings::default()).unwrap();
    let mut solve = |qp: StageQp, expected: [f64; 2]| {
        *solver.qp_mut() = qp;
        solver.solve(None).unwrap();
        assert_near(inputs(&solver), expected);
        (solver.path(), solver.iterations())
    };
    let free = || small([-9.0, 9.0], 10.0, -9.0, [-1.0, -2.0]);
    let bound = || small([-9.0, 9.0], 0.5, -9.0, [-1.0, -2.0]);
    assert_eq!(solve(free(), [1.0, 1.0]), (SolvePath::Relaxed, 1));
    // The first set has no row, the next one the bound; then it is known.
    assert_eq!(solve(bound(), [0.5, 1.0]), (SolvePath::ActiveSet, 2));
    assert_eq!(solve(bound(), [0.5, 1.0]), (SolvePath::ActiveSet, 1));
    assert_eq!(solve(free(), [1.0, 1.0]), (SolvePath::Relaxed, 1));
}

#[test]
fn residuals_tell_a_wrong_answer() {
    let mut solver = solver(of_three(10.0, [0.0, 0.0]));
    solver.solve(None).unwrap();
    // The answer stays, the problem becomes another.
    *solver.qp_mut() = small([4.0; 2], 10.0, 0.0, [0.0, 0.0]);
    assert!((solver.residuals().primal - 1.0 / (1.0 + 3.0)).abs() < 1e-6);
    *solver.qp_mut() = of_three(1.5, [0.0, 0.0]);
    assert!((solver.residuals().primal - 0.5 / (1.0 + 3.0)).abs() < 1e-6);
    *solver.qp_mut() = of_three(10.0, [1.0, 0.0]);
    let residuals = solver.residuals();
    assert!((residuals.dual - 0.5).abs() < 1e-6, "{residuals:?}");
    *solver.qp_mut() = of_three(10.0, [f64::NAN, 0.0]);
    assert!(solver.residuals().dual.is_nan());
}

#[test]
fn nan_is_refused_and_leaves_no_trace() {
    for settings in [exact(), QpSettings::default()] {
        let mut solver = QpSolver::new(of_three(10.0, [0.0, 0.0]), settings).unwrap();
        for spoil in [
            (|qp: &mut StageQp, value| qp.stages[0].weight[3][3] = value) as fn(&mut StageQp, f64),
            |qp, value| qp.stages[0].force[4] = value,
            |qp, value| qp.stages[0].speed_error = value,
            |qp, value| qp.rows_mut(0).1[0].by[3] = value,
            |qp, value| qp.rows_mut(0).1[0].low = value.abs(),
            |qp, value| qp.rows_mut(0).0[0].high = -value.abs(),
        ] {
            for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
                spoil(solver.qp_mut(), value);
                assert_eq!(solver.solve(None), Err(QpFailure::NotFinite));
                assert_eq!(solver.iterations(), 0);
                *solver.qp_mut() = of_three(10.0, [0.0, 0.0]);
                solver.solve(None).unwrap();
                assert_near(inputs(&solver), [2.0, 1.0]);
            }
        }
        assert_eq!(solver.rebuilds(), 0);
    }
}

#[test]
fn a_poisoned_solver_is_made_new() {
    let mut solver = solver(of_three(10.0, [0.0, 0.0]));
    let mut overflowing = small([1e200; 2], 1e300, 0.0, [0.0, 0.0]);
    overflowing.stages[0].weight[3][3] = 1e300;
    overflowing.rows_mut(0).1[0].by[3] = 1e300;
    *solver.qp_mut() = overflowing;
    let failure = solver.solve(None).unwrap_err();
    assert!(matches!(failure, QpFailure::Numerical { .. }), "{failure}");
    assert_eq!(solver.rebuilds(), 1);
    *solver.qp_mut() = of_three(10.0, [0.0, 0.0]);
    solver.solve(None).unwrap();
    assert_near(inputs(&solver), [2.0, 1.0]);
    assert_eq!(solver.rebuilds(), 1);
}

#[test]
fn contradictions_are_infeasible() {
    for settings in [exact(), QpSettings::default()] {
        let mut solver = QpSolver::new(of_three(10.0, [0.0, 0.0]), settings).unwrap();
        *solver.qp_mut() = small([-1.0; 2], 10.0, 0.0, [0.0, 0.0]);
        solver.solve(None).unwrap();
        assert_near(inputs(&solver), [-1.0, 0.0]);
        // x <= 0.5 and y <= 2 leave no sum of 3.
        solver.qp_mut().clone_from(&of_three(0.5, [0.0, 0.0]));
        solver.qp_mut().rows_mut(0).0[2].high = 2.0;
        assert_eq!(solver.solve(None), Err(QpFailure::Infeasible));
        *solver.qp_mut() = of_three(10.0, [0.0, 0.0]);
        solver.solve(None).unwrap();
        assert_near(inputs(&solver), [2.0, 1.0]);
    }
}

#[test]
fn a_cost_without_a_minimum_by_its_rows_is_left_to_the_interior_point_method() {
    let mut qp = of_three(10.0, [0.0, 0.0]);
    qp.stages[0].weight[4][4] = 0.0;
    let mut solver = QpSolver::new(qp, QpSettings::default()).unwrap();
    solver.solve(None).unwrap();
    assert_eq!(solver.path(), SolvePath::InteriorPoint);
    let [x, y] = inputs(&solver);
    assert!(x.abs() < 1e-3 && (y - 3.0).abs() < 1e-3, "{x} {y}");
}

#[test]
fn a_deadline_in_the_past_ends_the_solve_and_the_next_one_is_whole() {
    for settings in [exact(), QpSettings::default()] {
        let mut solver = QpSolver::new(of_three(10.0, [0.0, 0.0]), settings).unwrap();
        let failure = solver.solve(Some(Instant::now())).unwrap_err();
        assert_eq!(failure, QpFailure::Deadline { iterations: 0 });
        let far = Instant::now() + Duration::from_secs(3600);
        solver.solve(Some(far)).unwrap();
        assert_near(inputs(&solver), [2.0, 1.0]);
        solver.solve(None).unwrap();
        assert_near(inputs(&solver), [2.0, 1.0]);
    }
}

#[test]
fn too_few_iterations_are_told_from_other_failures() {
    let mut solver = solver(of_three(0.5, [0.3, 0.0]));
    solver.set_max_iterations(1);
    let failure = solver.solve(None).unwrap_err();
    assert_eq!(failure, QpFailure::MaxIterations { iterations: 1 });
    solver.set_max_iterations(100);
    solver.solve(None).unwrap();
    assert_near(inputs(&solver), [0.5, 2.5]);
}

/// Cuts a solve of `qp` short and salvages it, with `from` and `to` as what is made of no correction and of the iterate.
fn salvaged(qp: StageQp, from: [f64; 2], to: [f64; 2]) -> Result<(Residuals, [f64; 2]), QpFailure> {
    let mut solver = solver(of_three(0.5, [0.3, 0.0]));
    solver.set_max_iterations(1);
    let failure = solver.solve(None).unwrap_err();
    *solver.qp_mut() = qp;
    let residuals = solver.salvage(failure, |corrections| {
        let none = corrections[0] == [0.0; 2];
        corrections[0] = if none { from } else { to };
    })?;
    assert_eq!(solver.path(), SolvePath::CutShort);
    Ok((residuals, inputs(&solver)))
}

#[test]
fn a_solve_cut_short_ends_at_the_cheapest_point_between_two_that_meet_the_constraints() {
    let free = |q| of_three(10.0, q);
    // The optimum is (2, 1), and all of x + y = 3 is between these or beyond them.
    for (from, to, expected) in [
        ([0.0, 3.0], [3.0, 0.0], [2.0, 1.0]),
        ([3.0, 0.0], [1.8, 1.2], [2.0, 1.0]),
        ([0.0, 3.0], [1.0, 2.0], [1.0, 2.0]),
        ([0.5, 2.5], [2.0, 1.0], [2.0, 1.0]),
    ] {
        let (residuals, found) = salvaged(free([0.0, 0.0]), from, to).unwrap();
        assert_near(found, expected);
        assert!(residuals.primal < 1e-12, "{residuals:?}");
    }
    // Nothing is cheaper than where the optimum itself or a way up begins.
    for (from, to) in [([2.0, 1.0], [0.0, 3.0]), ([1.0, 2.0], [0.0, 3.0])] {
        let failure = salvaged(free([0.0, 0.0]), from, to);
        assert_eq!(failure, Err(QpFailure::MaxIterations { iterations: 1 }));
    }
    // A cost that falls evenly is followed to the end, one that rounding has bent down nowhere.
    for (curvature, price, found) in [
        (0.0, -0.5, true),
        (0.0, 0.5, false),
        (-1.0, 0.2, false),
        (-1.0, -0.2, false),
    ] {
        let mut qp = free([price, 0.0]);
        (qp.stages[0].weight[3][3], qp.stages[0].weight[4][4]) = (curvature, curvature);
        let salvaged = salvaged(qp, [0.0, 3.0], [1.0, 3.0]);
        assert_eq!(salvaged.is_ok(), found, "{curvature} {price}");
        if let Ok((_, found)) = salvaged {
            assert_near(found, [1.0, 3.0]);
        }
    }
}

#[test]
fn residuals_are_the_largest_terms_relative_to_what_they_sum() {
    let qp = of_three(10.0, [0.5, -1.0]);
    let mut point = qp.zeros();
    point.rollout.inputs[0] = [1.0, 1.0];
    // Of the sum, 1 short; of x, which has 9 to spare; of y, which is 1 above its bound.
    let sum = qp.extra_rows(0).start;
    (
        point.multipliers[sum],
        point.multipliers[0],
        point.multipliers[2],
    ) = (2.0, 0.5, -0.25);
    let mut work = qp.work();
    let residuals = qp.residuals(&point, &mut work);
    // P z + q + A' y is (4, 2.75), the cost 1, and multipliers times slacks are 2 (2 - 3) + 0.5 (1 - 10) - 0.25 (1 - 0).
    assert!((residuals.primal - 1.0 / 3.0).abs() < 1e-12);
    assert!((residuals.dual - 4.0 / 2.0).abs() < 1e-12);
    assert!((residuals.gap - 6.75 / 2.0).abs() < 1e-12);
    point.rollout.inputs[0] = [1.0, -5.0];
    assert!((qp.residuals(&point, &mut work).primal - 7.0 / 6.0).abs() < 1e-12);
}

#[test]
fn residuals_are_within_a_limit_where_each_of_them_is() {
    let within = |primal, dual, gap| Residuals { primal, dual, gap }.within(1e-3);
    assert!(within(1e-3, 1e-3, 1e-3));
    for bad in [2e-3, f64::NAN] {
        assert!(!within(bad, 0.0, 0.0) && !within(0.0, bad, 0.0) && !within(0.0, 0.0, bad));
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn an_updated_solver_is_as_good_as_a_new_one(
        problems in prop::collection::vec(
            ([0.1..5.0_f64, 0.1..5.0, -3.0..3.0, -3.0..3.0, 0.2..5.0, 0.1..5.0], -1.0..1.0_f64),
            2..6,
        ),
    ) {
        let mut updated = solver(of_three(10.0, [0.0, 0.0]));
        let settings = QpSettings { mode: QpMode::ActiveSet, ..exact() };
        let mut active_set = QpSolver::new(of_three(10.0, [0.0, 0.0]), settings).unwrap();
        for ([p_x, p_y, q_x, q_y, sum, x_max], slope) in problems {
            let mut qp = small([sum; 2], x_max, 0.0, [q_x, q_y]);
            (qp.stages[0].weight[3][3], qp.stages[0].weight[4][4]) = (p_x, p_y);
            qp.rows_mut(0).1[0].by[3] = 1.0 + 0.5 * slope;
            *updated.qp_mut() = qp.clone();
            let mut fresh = solver(qp.clone());
            let expected = fresh.solve(None);
            prop_assert_eq!(updated.solve(None), expected);
            prop_assert_eq!(inputs(&updated), inputs(&fresh));
            prop_assert!(expected.is_ok(), "{:?}", expected);
            *active_set.qp_mut() = qp;
            prop_assert!(active_set.solve(None).is_ok());
            for (found, expected) in inputs(&active_set).iter().zip(inputs(&fresh)) {
                prop_assert!((found - expected).abs() < 1e-5, "{} {}", found, expected);
            }
        }
    }
}
