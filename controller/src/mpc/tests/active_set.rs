//! The active set is that of the interior-point method.

use super::extra::states_of;
use super::stages::{any_stage, qp_of, stage};
use super::*;
use crate::mpc::active_set::ActiveSet;
use crate::mpc::assembling::make_feasible;
use crate::mpc::recursion::Recursion;
use crate::mpc::solve_limits::SolveLimits;
use crate::mpc::stage_qp::{Point, Rollout};
use proptest::strategy::ValueTree;
use proptest::test_runner::TestRunner;

/// Returns the QP of stages whose treads have limits of their own, or not.
fn qp(stages: &[Stage], treads: bool) -> StageQp {
    qp_of(
        stages,
        motors(0.3, -0.2),
        &input_limits(if treads { 1.3 } else { 2.0 }),
    )
}

/// Returns a point that presses the rows of the guess, from which a search can begin.
fn pressing(qp: &StageQp, guess: &[i8]) -> Point {
    let mut point = qp.zeros();
    for (multiplier, side) in point.multipliers.iter_mut().zip(guess) {
        *multiplier = 1e6 * f64::from(*side);
    }
    point
}

/// Asserts that what is found from a guess is optimal, at the cost that the interior-point method finds.
fn assert_found(qp: &StageQp, guess: &[i8]) {
    let mut search = ActiveSet::new(qp);
    search.begin_with(qp, &pressing(qp, guess));
    let mut point = qp.zeros();
    let found = search.find(qp, &mut point, &SolveLimits::new(1));
    let mut solver = QpSolver::new(qp.clone(), exact()).unwrap();
    if solver.solve(None).is_err() {
        // No inputs meet all limits.
        return;
    }
    assert_eq!(found, Ok(true));
    let mut work = qp.work();
    let residuals = qp.residuals(&point, &mut work);
    assert!(residuals.within(1e-7), "{residuals:?}");
    // The interior-point method's inputs are good to some 1e-5 m/s where the cost is flat; the least cost is not
    // so vague.
    let (cost, least) = (
        qp.cost(&point.rollout, &mut work),
        qp.cost(&solver.point().rollout, &mut work),
    );
    assert!(
        cost <= least + 1e-7 * (1.0 + least.abs()),
        "{cost}, expected {least}"
    );
}

/// Returns the minimum of a QP's cost without rows.
pub fn minimum(qp: &StageQp) -> Rollout {
    let stages = qp.stages.len();
    let mut recursion = Recursion::new(stages);
    assert!(recursion.factorise(&qp.stages));
    let (mut forces, mut path) = (vec![[0.0; 5]; stages], Rollout::zeros(stages));
    qp.linear(&mut forces);
    recursion.respond(&qp.stages, &forces, stages - 1, stages - 1, &mut path);
    path
}

proptest! {
    #[test]
    fn the_recursion_finds_the_minimum(
        stages in prop::collection::vec(stage(), 1..12),
        step in prop::collection::vec(prop::array::uniform2(-0.5..0.5_f64), 12),
    ) {
        let qp = qp(&stages, false);
        let path = minimum(&qp);
        let states = states_of(&stages, &path.inputs);
        for (own, expected) in path.states.iter().zip(&states) {
            prop_assert!((Vector3::from(*own) - expected).norm() < 1e-9);
        }
        let mut work = qp.work();
        let mut cost = |share: f64| {
            let mut moved = path.clone();
            let inputs = moved.inputs.as_flattened_mut().iter_mut();
            for (own, by) in inputs.zip(step.as_flattened()) {
                *own += share * by;
            }
            qp.roll(&mut moved);
            qp.cost(&moved, &mut work)
        };
        // The difference of a parabola is exact.
        let (least, there, back) = (cost(0.0), cost(1.0), cost(-1.0));
        prop_assert!(there > least - 1e-9 && (there - back).abs() < 1e-8 * (1.0 + there.abs()), "{} {} {}", least, there, back);
    }

    #[test]
    fn active_rows_are_found_from_nothing(stages in prop::collection::vec(stage(), 1..41), treads: bool) {
        let qp = qp(&stages, treads);
        assert_found(&qp, &vec![0; qp.rows().len()]);
    }

    #[test]
    fn active_rows_are_found_from_any_guess(
        stages in prop::collection::vec(stage(), 1..41),
        guess in prop::collection::vec(prop_oneof![8 => Just(0_i8), 1 => Just(1), 1 => Just(-1)], 6 * 40),
        treads: bool,
    ) {
        assert_found(&qp(&stages, treads), &guess);
    }

    #[test]
    fn active_rows_are_found_among_rows_of_states_and_inputs(
        stages in prop::collection::vec(stage(), 1..41),
        rows in prop::collection::vec((prop::array::uniform5(-1.0..1.0_f64), -0.2..0.0_f64, 0.0..0.2_f64), 2 * 40),
    ) {
        let (count, limits) = (stages.len(), input_limits(1.3));
        let previous = motors(0.3, -0.2);
        let plain = qp_of(&stages, previous, &limits);
        // One that meets all rows.
        let mut path = plain.zeros().rollout;
        make_feasible(&mut path.inputs, &stages, previous, &limits);
        plain.roll(&mut path);
        let mut qp = StageQp::new(count, true, 2);
        qp.stages.copy_from_slice(&plain.stages);
        for k in 0..count {
            let (own, extra) = qp.rows_mut(k);
            own.copy_from_slice(&plain.rows()[6 * k..6 * k + 6]);
            let ([x, y, yaw], [traction, steer]) = (path.states[k], path.inputs[k]);
            let v = [x, y, yaw, traction, steer];
            for (row, (by, low, high)) in extra.iter_mut().zip(&rows[2 * k..]) {
                let value: f64 = by.iter().zip(&v).map(|(by, v)| by * v).sum();
                (row.by, row.low, row.high) = (*by, value + low, value + high);
            }
        }
        assert_found(&qp, &vec![0; qp.rows().len()]);
    }

    #[test]
    fn a_search_that_begins_with_the_active_rows_needs_one_set(
        stages in prop::collection::vec(stage(), 1..41),
        treads: bool,
    ) {
        let qp = qp(&stages, treads);
        let limits = SolveLimits::new(1);
        let (mut search, mut point) = (ActiveSet::new(&qp), qp.zeros());
        prop_assume!(search.find(&qp, &mut point, &limits) == Ok(true));
        let (first, from_nothing) = (point.clone(), search.points());
        prop_assert_eq!(search.find(&qp, &mut point, &limits), Ok(true));
        prop_assert_eq!(search.points(), 1);
        for (now, before) in point.rollout.inputs.iter().zip(&first.rollout.inputs) {
            prop_assert!((now[0] - before[0]).abs() < 1e-7 && (now[1] - before[1]).abs() < 1e-7);
        }
        // One that was active in the QP before does not count.
        search.begin_with(&qp, &qp.zeros());
        prop_assert_eq!(search.find(&qp, &mut point, &limits), Ok(true));
        prop_assert_eq!(search.points(), from_nothing);
    }
}

/// Searches from nothing; returns how many rows are active, and how many sets it took to find them.
fn search_from_nothing(stages: &[Stage]) -> Option<(usize, u32)> {
    let qp = qp(stages, false);
    let (mut search, mut point) = (ActiveSet::new(&qp), qp.zeros());
    let found = search.find(&qp, &mut point, &SolveLimits::new(1));
    let active = point.multipliers.iter().filter(|own| **own != 0.0).count();
    (found == Ok(true)).then_some((active, search.points()))
}

#[test]
fn limits_that_are_exceeded_alike_are_taken_in_at_once() {
    // Each stage wants 5 m/s of traction, or -5 m/s, and has 1 m/s.
    let stage = Stage {
        input: motors(0.0, 0.0),
        weights: any_stage().weights.scaled(0.0),
        speed_row: [0.0, 1.0, 0.0],
        speed_error: -5.0,
        change_weights: ChangeWeights {
            traction: 0.0,
            steer: 1.0,
        },
        damping: 1.0,
        traction_change: Change {
            fall: 3.0,
            rise: 3.0,
        },
        steer_change: Change {
            fall: 3.0,
            rise: 3.0,
        },
        ..any_stage()
    };
    let with_speed = StageWeights {
        speed_s2_per_m2: 10.0,
        ..stage.weights
    };
    for error_m_s in [-5.0, 5.0] {
        let stage = Stage {
            weights: with_speed,
            speed_error: error_m_s,
            ..stage
        };
        assert_eq!(search_from_nothing(&[stage; 40]), Some((40, 2)));
        // Where they are exceeded by less than half as much as the worst they wait for their turn.
        let little = Stage {
            speed_error: 0.4 * error_m_s,
            ..stage
        };
        let mut stages = [little; 40];
        stages[..10].fill(stage);
        assert_eq!(search_from_nothing(&stages), Some((40, 3)));
    }
}

#[test]
fn random_rows_are_found_in_fewer_sets_than_there_are() {
    let mut runner = TestRunner::deterministic();
    let (mut active, mut sets, mut most) = (0, 0, 0);
    for _ in 0..200 {
        let stages = prop::collection::vec(stage(), 40)
            .new_tree(&mut runner)
            .unwrap();
        if let Some((own, own_sets)) = search_from_nothing(&stages.current()) {
            active += own;
            sets += own_sets as usize;
            most = most.max(own_sets);
        }
    }
    assert!(3 * sets < active && most < 30, "{sets} {active} {most}");
}

#[test]
fn a_deadline_ends_a_search_and_leaves_the_last_optimum() {
    let stages = prop::collection::vec(stage(), 20).new_tree(&mut TestRunner::deterministic());
    let qp = qp(&stages.unwrap().current(), true);
    let (mut search, mut point) = (ActiveSet::new(&qp), qp.zeros());
    let limits = SolveLimits::new(1);
    point.rollout.inputs.fill([7.0; 2]);
    limits.begin_cycle(Some(0));
    assert_eq!(search.find(&qp, &mut point, &limits), Err(()));
    assert_eq!((search.points(), point.rollout.inputs[0]), (0, [7.0; 2]));
    limits.begin_cycle(Some(1));
    assert_eq!(search.find(&qp, &mut point, &limits), Err(()));
    assert_eq!(
        (search.points(), point.rollout.inputs),
        (1, minimum(&qp).inputs)
    );
}
