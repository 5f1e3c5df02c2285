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

/// Cuts a solve of `data` short and salvages it, with `from` and `to` as the projections of the origin and of the
/// iterate.
fn salvaged(
    data: QpData,
    from: [f64; 2],
    to: [f64; 2],
) -> Result<(Residuals, Vec<f64>), QpFailure> {
    let mut solver = solver(small(3.0, 0.5, [0.3, 0.0]));
    solver.set_max_iterations(1);
    let failure = solver.solve(None).unwrap_err();
    *solver.data_mut() = data;
    let residuals = solver.salvage(failure, |_, point| {
        let origin = point.iter().all(|value| *value == 0.0);
        point.copy_from_slice(if origin { &from } else { &to });
    })?;
    assert_eq!(solver.path(), SolvePath::CutShort);
    Ok((residuals, solver.primal().to_vec()))
}

#[test]
fn a_solve_cut_short_ends_at_the_cheapest_point_between_two_that_meet_the_constraints() {
    let free = |q| small(3.0, 10.0, q);
    // The optimum is (2, 1), and all of x + y = 3 is between these or beyond them.
    for (from, to, expected) in [
        ([0.0, 3.0], [3.0, 0.0], [2.0, 1.0]),
        ([3.0, 0.0], [1.8, 1.2], [2.0, 1.0]),
        ([0.0, 3.0], [1.0, 2.0], [1.0, 2.0]),
        ([0.5, 2.5], [2.0, 1.0], [2.0, 1.0]),
    ] {
        let (residuals, found) = salvaged(free([0.0, 0.0]), from, to).unwrap();
        assert_near(&found, expected);
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
        let mut data = free([price, 0.0]);
        data.p.nzval.fill(curvature);
        let salvaged = salvaged(data, [0.0, 3.0], [1.0, 3.0]);
        assert_eq!(salvaged.is_ok(), found, "{curvature} {price}");
        if let Ok((_, found)) = salvaged {
            assert_near(&found, [1.0, 3.0]);
        }
    }
}

#[test]
fn residuals_are_the_largest_terms_relative_to_what_they_sum() {
    let data = small(3.0, 10.0, [0.5, -1.0]);
    let mut point = Point {
        primal: vec![1.0, 1.0],
        dual: vec![2.0, 0.5, -0.25],
        slack: vec![0.0, 8.5, 3.0],
    };
    let mut work = Point::zeros(&data);
    let residuals = data.residuals(&point, &mut work);
    // A z + s - b is (-1, -0.5, 2), P z + q + A' y is (4, 3.25), z' P z = 3, q' z = -0.5 and b' y = 11.
    assert!((residuals.primal - 2.0 / 11.0).abs() < 1e-12);
    assert!((residuals.dual - 4.0 / 2.0).abs() < 1e-12);
    assert!((residuals.gap - 13.5 / 2.0).abs() < 1e-12);
    // What is outside the cone counts as well.
    point.dual[2] = -33.0;
    assert!((data.residuals(&point, &mut work).primal - 33.0 / 11.0).abs() < 1e-12);
    point.slack[2] = -44.0;
    assert!((data.residuals(&point, &mut work).primal - 45.0 / 11.0).abs() < 1e-12);
}

#[test]
fn residuals_are_within_a_limit_where_each_of_them_is() {
    let within = |primal, dual, gap| Residuals { primal, dual, gap }.within(1e-3);
    assert!(within(1e-3, 1e-3, 1e-3));
    for bad in [2e-3, f64::NAN] {
        assert!(!within(bad, 0.0, 0.0) && !within(0.0, bad, 0.0) && !within(0.0, 0.0, bad));
    }
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
