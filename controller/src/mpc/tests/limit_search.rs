//! The search stage by stage finds what the interior-point method finds.

use super::condensed::stage;
use super::*;
use crate::mpc::clarabel_qp::SolveLimits;
use crate::mpc::limit_search::LimitSearch;
use crate::mpc::rows::Rows;

/// Returns the QP of `stages` in which only bounds and changes limit the inputs.
fn qp(stages: &[Stage]) -> (Condenser, QpData) {
    let (mut condenser, mut data) =
        Condenser::new(stages.len(), 5, input_limits(2.0), None, COST_SCALE);
    condenser.assemble(stages, motors(0.3, -0.2), None, &mut data);
    (condenser, data)
}

/// Asserts that the inputs found from `members` keep all limits, at the cost that the interior-point method
/// finds.
fn assert_found(stages: &[Stage], mut members: Vec<bool>) {
    let (condenser, data) = qp(stages);
    let rows = Rows::new(&data);
    let mut search = LimitSearch::new(&data).unwrap();
    let found = search.find(&data, &rows, &mut members, &SolveLimits::new(1));
    let mut solver = QpSolver::new(data.clone(), exact()).unwrap();
    if solver.solve(None).is_err() {
        // No inputs meet all limits.
        return;
    }
    assert_eq!(found, Ok(true));
    let mut point = Point::zeros(&data);
    search.put_inputs(&rows, &mut point);
    data.slacken(&mut point);
    for (row, member) in members.iter().enumerate() {
        let slack = point.slack[data.equalities + row];
        assert!(slack > -1e-7, "row {row} is violated by {slack}");
        assert!(!member || slack < 1e-7, "row {row} is slack by {slack}");
    }
    // Sets the states that follow from the inputs. The interior-point method's inputs are good to some
    // 1e-5 m/s where the cost is flat; the least cost is not so vague.
    condenser.make_feasible(stages, &data, &mut point.primal);
    let (cost, least) = (data.cost(&point.primal), data.cost(solver.primal()));
    assert!(
        cost <= least + 1e-7 * (1.0 + least.abs()),
        "{cost}, expected {least}"
    );
}

proptest! {
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
