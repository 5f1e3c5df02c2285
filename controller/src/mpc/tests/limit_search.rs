//! The search stage by stage finds what the interior-point method finds.

use super::condensed::{any_stage, stage};
use super::extra::primal_of;
use super::*;
use crate::mpc::clarabel_qp::SolveLimits;
use crate::mpc::limit_search::LimitSearch;
use crate::mpc::recursion::{InputRule, Recursion};
use crate::mpc::rows::Rows;

/// Returns the QP of `stages` in which only bounds and changes limit the inputs.
fn qp(stages: &[Stage]) -> (Condenser, QpData) {
    let (mut condenser, mut data) =
        Condenser::new(stages.len(), 5, input_limits(2.0), None, COST_SCALE);
    condenser.assemble(stages, motors(0.3, -0.2), None, &mut data);
    (condenser, data)
}

/// Asserts that what is found from `members` is optimal, at the cost that the interior-point method finds.
fn assert_found(stages: &[Stage], mut members: Vec<bool>) {
    let (_, data) = qp(stages);
    let rows = Rows::new(&data);
    let mut search = LimitSearch::new(&data).unwrap();
    let found = search.find(&data, &rows, &mut members, &SolveLimits::new(1));
    let mut solver = QpSolver::new(data.clone(), exact()).unwrap();
    if solver.solve(None).is_err() {
        // No inputs meet all limits.
        return;
    }
    assert_eq!(found, Ok(true));
    let (mut point, mut work) = (Point::zeros(&data), Point::zeros(&data));
    search.put_optimum(&data, &rows, &mut point);
    let residuals = data.residuals(&point, &mut work);
    assert!(residuals.within(1e-7), "{residuals:?}");
    // The interior-point method's inputs are good to some 1e-5 m/s where the cost is flat; the least cost is not
    // so vague.
    let (cost, least) = (data.cost(&point.primal), data.cost(solver.primal()));
    assert!(
        cost <= least + 1e-7 * (1.0 + least.abs()),
        "{cost}, expected {least}"
    );
}

proptest! {
    #[test]
    fn the_recursion_has_the_cost_of_the_qp_and_its_slopes(
        stages in prop::collection::vec(stage(), 1..12),
        inputs in prop::collection::vec(prop::array::uniform2(-0.5..0.5_f64), 12),
        moved in 0..12_usize,
    ) {
        let (count, (_, data)) = (stages.len(), qp(&stages));
        let mut recursion = Recursion::new(count);
        let mut solved = |inputs: &[[f64; 2]]| {
            let rules: Vec<_> = inputs.iter().map(|own| own.map(InputRule::Fixed)).collect();
            let cost = recursion.solve(&data.stages, &rules, count - 1).unwrap();
            (cost, recursion.optimum.slopes.clone())
        };
        let inputs = &inputs[..count];
        let (cost, slopes) = solved(inputs);
        let expected = data.cost(&primal_of(&stages, inputs, 5));
        let found = cost - solved(&vec![[0.0; 2]; count]).0;
        prop_assert!((found - expected).abs() < 1e-9 * (1.0 + expected.abs()), "{} {}", found, expected);
        let stage = moved % count;
        for motor in 0..2 {
            // The difference of a parabola is exact.
            let mut by = |step: f64| {
                let mut inputs = inputs.to_vec();
                inputs[stage][motor] += step;
                solved(&inputs).0
            };
            let (found, expected) = (slopes[stage][motor], by(0.5) - by(-0.5));
            prop_assert!((found - expected).abs() < 1e-8 * (1.0 + cost.abs()), "{} {}", found, expected);
        }
    }

    #[test]
    fn active_limits_are_found_from_nothing(stages in prop::collection::vec(stage(), 1..41)) {
        let rows = 8 * stages.len();
        assert_found(&stages, vec![false; rows]);
    }

    #[test]
    fn active_limits_are_found_from_any_guess(
        (stages, guess) in (1..41_usize).prop_flat_map(|count| (
            prop::collection::vec(stage(), count),
            prop::collection::vec(prop::bool::weighted(0.2), 8 * count),
        )),
    ) {
        assert_found(&stages, guess);
    }
}

proptest! {
    #[test]
    fn a_search_that_begins_with_the_active_limits_needs_one_recursion(
        stages in prop::collection::vec(stage(), 1..41),
    ) {
        let (_, data) = qp(&stages);
        let (rows, limits) = (Rows::new(&data), SolveLimits::new(1));
        let nothing = vec![false; 8 * stages.len()];
        let mut members = nothing.clone();
        let mut search = LimitSearch::new(&data).unwrap();
        prop_assume!(search.find(&data, &rows, &mut members, &limits) == Ok(true));
        let (active, from_nothing) = (members.clone(), search.systems());
        prop_assert_eq!(search.find(&data, &rows, &mut members, &limits), Ok(true));
        prop_assert_eq!(search.systems(), 1);
        prop_assert_eq!(&members, &active);
        // One that was active in the QP before does not count.
        members.clone_from(&nothing);
        prop_assert_eq!(search.find(&data, &rows, &mut members, &limits), Ok(true));
        prop_assert_eq!(search.systems(), from_nothing);
    }
}

/// Searches from nothing; returns how many limits are active, and the recursions that it took to find them.
fn search_from_nothing(stages: &[Stage]) -> Option<(usize, u32)> {
    let (_, data) = qp(stages);
    let mut members = vec![false; 8 * stages.len()];
    let mut search = LimitSearch::new(&data).unwrap();
    let limits = SolveLimits::new(1);
    let found = search.find(&data, &Rows::new(&data), &mut members, &limits);
    let active = members.iter().filter(|member| **member).count();
    (found == Ok(true)).then_some((active, search.systems()))
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
fn random_limits_are_found_in_fewer_recursions_than_there_are() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let (mut active, mut systems, mut most) = (0, 0, 0);
    for _ in 0..200 {
        let stages = prop::collection::vec(stage(), 40);
        let stages = proptest::strategy::ValueTree::current(&stages.new_tree(&mut runner).unwrap());
        if let Some((own, own_systems)) = search_from_nothing(&stages) {
            active += own;
            systems += own_systems as usize;
            most = most.max(own_systems);
        }
    }
    assert!(
        3 * systems < active && most < 30,
        "{systems} {active} {most}"
    );
}

#[test]
fn the_search_applies_where_bounds_and_changes_are_all_that_is_added() {
    for (tread_speed_m_s, extra_rows, applies) in [
        (2.0, None, true),
        (1.3, None, false),
        // Extra costs without rows.
        (2.0, Some(0), false),
        (2.0, Some(1), false),
    ] {
        let limits = input_limits(tread_speed_m_s);
        let (_, data) = Condenser::new(3, 2, limits, extra_rows, COST_SCALE);
        assert_eq!(LimitSearch::new(&data).is_some(), applies, "{extra_rows:?}");
    }
}

#[test]
fn the_terms_of_a_stage_are_those_of_their_numbers() {
    let mut numbers: Vec<f64> = (1..=StageTerms::COUNT).map(|i| i as f64).collect();
    numbers[9..12].fill(0.0);
    let terms = StageTerms::from_numbers(&numbers);
    assert_eq!(terms.to_array()[..], numbers);
    assert_eq!(terms.by_input[1], [7.0, 8.0, 9.0]);
    assert_eq!((terms.weight[0][0], terms.speed_error), (13.0, 34.0));
}

#[test]
fn a_deadline_in_the_past_ends_the_search() {
    let mut runner = proptest::test_runner::TestRunner::deterministic();
    let stages = prop::collection::vec(stage(), 20);
    let stages = proptest::strategy::ValueTree::current(&stages.new_tree(&mut runner).unwrap());
    let (_, data) = qp(&stages);
    let mut search = LimitSearch::new(&data).unwrap();
    let limits = SolveLimits::new(1);
    limits.set_deadline(Some(Instant::now()));
    let mut members = vec![true; data.b.len() - data.equalities];
    let found = search.find(&data, &Rows::new(&data), &mut members, &limits);
    assert_eq!(found, Err(()));
    assert_eq!(search.systems(), 0);
}
