//! The feedback of a plan is what its QP answers.

use super::condensed::stage;
use super::*;
use crate::mpc::recursion::{InputRule, PlanFeedback, Recursion};
use crate::mpc::stage_terms::dot;

proptest! {
    #[test]
    fn a_plan_answers_a_change_of_its_start_as_the_qp_that_begins_there(
        stages in prop::collection::vec(stage(), 8),
        start in prop::array::uniform3(-0.3..0.3_f64),
    ) {
        let mut terms: Vec<_> = stages
            .iter()
            .map(|stage| {
                let optimal = Stage { error: Vector3::zeros(), speed_error: 0.0, ..*stage };
                optimal.terms([0.0; 2], 1.0)
            })
            .collect();
        let mut feedback = PlanFeedback::new(8);
        feedback.find(terms.iter().map(|terms| (*terms, None))).unwrap();
        let answer: Vec<_> = feedback.answer(start).collect();

        // A QP's deviations begin with 0: the way that the change takes by itself is in the errors.
        let moved = |from: &[f64; 3], k: usize, inputs: &[f64; 2]| -> [f64; 3] {
            std::array::from_fn(|i| {
                from[i] + stages[k].step.by_yaw[i] * from[2]
                    + stages[k].step.by_traction[i] * inputs[0]
                    + stages[k].step.by_steer[i] * inputs[1]
            })
        };
        let mut alone = start;
        for (k, terms) in terms.iter_mut().enumerate() {
            terms.speed_error = stages[k].speed_row[0] * alone[2];
            alone = moved(&alone, k, &[0.0; 2]);
            terms.force = terms.weight.map(|line| dot(&line, &alone));
        }
        let mut qp = Recursion::new(8);
        qp.solve(&terms, &[[InputRule::Free; 2]; 8], 7).unwrap();
        let mut state = start;
        for (k, answer) in answer.iter().enumerate() {
            state = moved(&state, k, &qp.optimum.inputs[k]);
            for (own, expected) in answer.iter().zip(&state) {
                prop_assert!((own - expected).abs() < 1e-9, "stage {k}: {own} {expected}");
            }
        }
    }
}
