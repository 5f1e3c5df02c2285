//! The plan after a QP's solution was followed in part.

use super::closed_loop::{Course, mpc, settings, solve};
use super::*;

#[test]
fn the_states_of_a_plan_are_those_of_its_inputs_however_little_of_a_solution_is_followed() {
    let mut course = Course::new();
    let mut settings = settings(40, 5);
    settings.step_limit = Some(StepLimit {
        steer_m_s: 0.001,
        ..StepLimit::default()
    });
    let mut mpc = mpc(settings);
    for cycle in 0..20 {
        let horizon = course.horizon(&mpc.settings);
        solve(&mut mpc, &horizon, None).unwrap();
        for (k, target) in horizon.targets.iter().enumerate() {
            let state = mpc.plan.states[k];
            let moved = mpc.model.increment_near(
                &mpc.starts[k],
                &target.normal_in_world,
                state.z,
                mpc.plan.inputs[k],
                mpc.times.step_s(k),
            );
            let gap = (mpc.plan.states[k + 1] - state - moved).norm();
            assert!(gap < 1e-9, "cycle {cycle}, stage {k}: {gap}");
        }
        course.drive(&mpc);
    }
}
