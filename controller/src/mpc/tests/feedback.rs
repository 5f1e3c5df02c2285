//! The feedback of a plan is what its QP answers.

use super::active_set::minimum;
use super::stages::{any_stage, qp_of, stage};
use super::*;

proptest! {
    #[test]
    fn a_plan_answers_a_change_of_its_start_as_the_qp_that_begins_there(
        stages in prop::collection::vec(stage(), 8),
        start in prop::array::uniform3(-0.3..0.3_f64),
    ) {
        let mut qp = qp_of(&stages, motors(0.3, -0.2), &input_limits(2.0));
        let mut solver = QpSolver::new(qp.clone(), QpSettings::default()).unwrap();
        prop_assert!(solver.find_feedback());
        let answer: Vec<_> = solver.answer(start).collect();

        // A QP's deviations begin with 0: the way that the change takes by itself is in the errors.
        let moved = |from: &[f64; 3], k: usize, inputs: &[f64; 2]| -> [f64; 3] {
            std::array::from_fn(|i| {
                from[i] + stages[k].step.by_yaw[i] * from[2]
                    + stages[k].step.by_traction[i] * inputs[0]
                    + stages[k].step.by_steer[i] * inputs[1]
            })
        };
        let mut alone = start;
        for (k, terms) in qp.stages.iter_mut().enumerate() {
            terms.speed_error = stages[k].speed_row[0] * alone[2];
            alone = moved(&alone, k, &[0.0; 2]);
            terms.force = terms.weight.map(|line| {
                line.iter().zip(&alone).map(|(weight, own)| weight * own).sum()
            });
            terms.change = [0.0; 2];
        }
        let optimum = minimum(&qp);
        let mut state = start;
        for (k, answer) in answer.iter().enumerate() {
            state = moved(&state, k, &optimum.inputs[k]);
            for (own, expected) in answer.iter().zip(&state) {
                prop_assert!((own - expected).abs() < 1e-9, "stage {k}: {own} {expected}");
            }
        }
    }
}

#[test]
fn feedback_is_that_of_the_qp_as_it_is() {
    let limits = input_limits(2.0);
    let [first, second] = [0.02, 0.5].map(|damping| {
        let stages = [Stage {
            damping,
            ..any_stage()
        }; 8];
        qp_of(&stages, motors(0.3, -0.2), &limits)
    });
    for mode in [QpMode::ActiveSet, QpMode::InteriorPoint] {
        let settings = QpSettings {
            mode,
            ..QpSettings::default()
        };
        let answer = |qp: &StageQp, solved: bool| {
            let mut solver = QpSolver::new(first.clone(), settings).unwrap();
            solver.solve(None).unwrap();
            assert!(solver.find_feedback());
            solver.qp_mut().clone_from(qp);
            if solved {
                solver.solve(None).unwrap();
            }
            assert!(solver.find_feedback());
            solver.answer([0.1, 0.0, 0.0]).collect::<Vec<_>>()
        };
        assert_eq!(answer(&second, false), answer(&second, true));
        assert_ne!(answer(&second, true), answer(&first, true));
        let mut solver = QpSolver::new(first.clone(), settings).unwrap();
        solver.solve(None).unwrap();
        solver.qp_mut().stages[3].weight[0][0] = f64::NAN;
        assert_eq!(solver.solve(None), Err(QpFailure::NotFinite));
        assert!(!solver.find_feedback());
    }
}
