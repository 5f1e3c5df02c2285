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
    condenser.assemble(stages, motors(0.3, -0.2), &mut data);
    (condenser, data)
}

/// Asserts that the inputs found from `members` are those of the interior-point method.
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
    let expected = condenser.input_corrections(solver.primal());
    for (found, expected) in condenser.input_corrections(&point.primal).zip(expected) {
        let traction = found.traction_m_s - expected.traction_m_s;
        let steer = found.steer_m_s - expected.steer_m_s;
        assert!(
            traction.abs() < 1e-5 && steer.abs() < 1e-5,
            "{found:?}, expected {expected:?}"
        );
    }
    for (row, member) in members.iter().enumerate() {
        let slack = solver.point().slack[data.equalities + row];
        assert!(!member || slack < 1e-4, "row {row} is slack by {slack}");
    }
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
