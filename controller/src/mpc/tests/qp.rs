//! The solver against problems whose answers are known, and its failures.

use super::*;
use crate::mpc::problem::{QpData, pattern};
use std::time::Duration;

/// minimise 1/2 (x^2 + 2 y^2) + q'(x, y)   subject to   x + y = sum,  x <= x_max,  -y <= 0
fn small(sum: f64, x_max: f64, q: [f64; 2]) -> QpData {
    let (mut p, places) = pattern(2, 2, &[(0, 0), (1, 1)]);
    p.nzval[places[1]] = 2.0;
    let (mut a, places) = pattern(3, 2, &[(0, 0), (0, 1), (1, 0), (2, 1)]);
    a.nzval[places[3]] = -1.0;
    QpData {
        p,
        q: q.to_vec(),
        a,
        b: vec![sum, x_max, 0.0],
        equalities: 1,
        stages: Vec::new(),
    }
}

fn solver(data: QpData) -> QpSolver {
    QpSolver::new(data, exact()).unwrap()
}

fn assert_near(found: &[f64], expected: [f64; 2]) {
    assert!(
        found
            .iter()
            .zip(expected)
            .all(|(f, e)| (f - e).abs() < 1e-6),
        "{found:?}, expected {expected:?}"
    );
}

#[test]
fn known_optima_are_found_and_their_residuals_vanish() {
    // Free: x = 2 y by the gradient, so (2/3, 1/3) of the sum. Bound: the rest goes to y.
    let mut solver = solver(small(3.0, 10.0, [0.0, 0.0]));
    let residuals = solver.solve(None).unwrap();
    assert_near(solver.primal(), [2.0, 1.0]);
    assert!(residuals.primal < 1e-7 && residuals.dual < 1e-7 && residuals.gap < 1e-7);
    *solver.data_mut() = small(3.0, 0.5, [0.0, 0.0]);
    solver.solve(None).unwrap();
    assert_near(solver.primal(), [0.5, 2.5]);
    // A price on y drives it to its bound.
    *solver.data_mut() = small(3.0, 10.0, [0.0, 100.0]);
    solver.solve(None).unwrap();
    assert_near(solver.primal(), [3.0, 0.0]);
    assert_eq!(solver.rebuilds(), 0);
}

#[test]
fn the_rows_that_bind_are_found_and_kept_for_the_next_solve() {
    let mut solver = QpSolver::new(small(3.0, 10.0, [0.0, 0.0]), QpSettings::default()).unwrap();
    let mut solve = |data: QpData, expected: [f64; 2]| {
        *solver.data_mut() = data;
        solver.solve(None).unwrap();
        assert_near(solver.primal(), expected);
        (solver.path(), solver.iterations())
    };
    let bound = || small(3.0, 0.5, [0.0, 0.0]);
    let free = || small(3.0, 10.0, [0.0, 0.0]);
    assert_eq!(solve(free(), [2.0, 1.0]), (SolvePath::Relaxed, 1));
    // One system finds that the bound is violated, the next has it; then it is known.
    assert_eq!(solve(bound(), [0.5, 2.5]), (SolvePath::WorkingSet, 2));
    assert_eq!(solve(bound(), [0.5, 2.5]), (SolvePath::WorkingSet, 1));
    // x at its bound of 10 drives y to its own, which comes in and goes again.
    assert_eq!(solve(free(), [2.0, 1.0]), (SolvePath::Relaxed, 3));
    assert_eq!(solve(free(), [2.0, 1.0]), (SolvePath::Relaxed, 1));
}

#[test]
fn residuals_tell_a_wrong_answer() {
    let mut solver = solver(small(3.0, 10.0, [0.0, 0.0]));
    solver.solve(None).unwrap();
    // The answer stays, the problem becomes another.
    solver.data_mut().b[0] = 4.0;
    assert!((solver.residuals().primal - 1.0 / (1.0 + 10.0)).abs() < 1e-6);
    *solver.data_mut() = small(3.0, 1.5, [0.0, 0.0]);
    assert!(solver.residuals().primal > 0.1);
    *solver.data_mut() = small(3.0, 10.0, [1.0, 0.0]);
    let residuals = solver.residuals();
    assert!((residuals.dual - 0.5).abs() < 1e-6, "{residuals:?}");
    *solver.data_mut() = small(3.0, 10.0, [f64::NAN, 0.0]);
    assert!(solver.residuals().dual.is_nan());
}

#[test]
fn nan_is_refused_and_leaves_no_trace() {
    let mut solver = solver(small(3.0, 10.0, [0.0, 0.0]));
    for spoil in [
        (|data: &mut QpData, value| data.p.nzval[0] = value) as fn(&mut QpData, f64),
        |data, value| data.q[1] = value,
        |data, value| data.a.nzval[2] = value,
        |data, value| data.b[0] = value,
    ] {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            spoil(solver.data_mut(), value);
            assert_eq!(solver.solve(None), Err(QpFailure::NotFinite));
            assert_eq!(solver.iterations(), 0);
            *solver.data_mut() = small(3.0, 10.0, [0.0, 0.0]);
            solver.solve(None).unwrap();
            assert_near(solver.primal(), [2.0, 1.0]);
        }
    }
    assert_eq!(solver.rebuilds(), 0);
}

#[test]
fn a_poisoned_solver_is_made_new() {
    let mut solver = solver(small(3.0, 10.0, [0.0, 0.0]));
    let mut overflowing = small(1e200, 1e300, [0.0, 0.0]);
    overflowing.p.nzval[0] = 1e300;
    overflowing.a.nzval[0] = 1e300;
    *solver.data_mut() = overflowing;
    let failure = solver.solve(None).unwrap_err();
    assert!(matches!(failure, QpFailure::Numerical { .. }), "{failure}");
    assert_eq!(solver.rebuilds(), 1);
    *solver.data_mut() = small(3.0, 10.0, [0.0, 0.0]);
    solver.solve(None).unwrap();
    assert_near(solver.primal(), [2.0, 1.0]);
    assert_eq!(solver.rebuilds(), 1);
}

#[test]
fn contradictions_are_infeasible() {
    let mut solver = solver(small(-1.0, 10.0, [0.0, 0.0]));
    solver.solve(None).unwrap();
    assert_near(solver.primal(), [-1.0, 0.0]);
    let mut contradiction = small(-1.0, -2.0, [0.0, 0.0]);
    // x <= -2 and y <= -2 leave no x + y = -1.
    contradiction.a.nzval[3] = 1.0;
    contradiction.b[2] = -2.0;
    *solver.data_mut() = contradiction;
    assert_eq!(solver.solve(None), Err(QpFailure::Infeasible));
    *solver.data_mut() = small(3.0, 10.0, [0.0, 0.0]);
    solver.solve(None).unwrap();
    assert_near(solver.primal(), [2.0, 1.0]);
}

#[test]
fn a_deadline_in_the_past_ends_the_solve_and_the_next_one_is_whole() {
    for settings in [exact(), QpSettings::default()] {
        let mut solver = QpSolver::new(small(3.0, 10.0, [0.0, 0.0]), settings).unwrap();
        let failure = solver.solve(Some(Instant::now())).unwrap_err();
        assert_eq!(failure, QpFailure::Deadline { iterations: 0 });
        let far = Instant::now() + Duration::from_secs(3600);
        solver.solve(Some(far)).unwrap();
        assert_near(solver.primal(), [2.0, 1.0]);
        solver.solve(None).unwrap();
        assert_near(solver.primal(), [2.0, 1.0]);
    }
}

#[test]
fn too_few_iterations_are_told_from_other_failures() {
    let mut solver = solver(small(3.0, 0.5, [0.3, 0.0]));
    solver.set_max_iterations(1);
    let failure = solver.solve(None).unwrap_err();
    assert_eq!(failure, QpFailure::MaxIterations { iterations: 1 });
    solver.set_max_iterations(100);
    solver.solve(None).unwrap();
    assert_near(solver.primal(), [0.5, 2.5]);
}

#[test]
fn data_of_another_size_is_rejected() {
    for settings in [exact(), QpSettings::default()] {
        let mut solver = QpSolver::new(small(3.0, 10.0, [0.0, 0.0]), settings).unwrap();
        solver.data_mut().q.push(0.0);
        assert_eq!(solver.solve(None), Err(QpFailure::Rejected));
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
        let mut updated = solver(small(3.0, 10.0, [0.0, 0.0]));
        let settings = QpSettings { mode: QpMode::WorkingSet, ..exact() };
        let mut working_set = QpSolver::new(small(3.0, 10.0, [0.0, 0.0]), settings).unwrap();
        for ([p_x, p_y, q_x, q_y, sum, x_max], slope) in problems {
            let mut data = small(sum, x_max, [q_x, q_y]);
            data.p.nzval.copy_from_slice(&[p_x, p_y]);
            data.a.nzval[0] = 1.0 + 0.5 * slope;
            *updated.data_mut() = data.clone();
            let mut fresh = solver(data.clone());
            let expected = fresh.solve(None);
            prop_assert_eq!(updated.solve(None), expected);
            prop_assert_eq!(updated.primal(), fresh.primal());
            prop_assert!(expected.is_ok(), "{:?}", expected);
            *working_set.data_mut() = data;
            prop_assert!(working_set.solve(None).is_ok());
            for (found, expected) in working_set.primal().iter().zip(fresh.primal()) {
                prop_assert!((found - expected).abs() < 1e-5, "{} {}", found, expected);
            }
        }
    }
}
