//! The price on corrections of planned inputs.

use super::super::step_limit::{Damping, StepCosts};
use super::closed_loop::{Course, mpc, settings, solve};
use super::*;

fn costs(actual: f64) -> StepCosts {
    StepCosts {
        before: 10.0,
        predicted: 0.0,
        actual,
    }
}

#[test]
fn the_price_grows_while_predictions_fail_and_falls_to_none_afterwards() {
    let limit = StepLimit::default();
    let mut damping = Damping::default();
    let mut prices = Vec::new();
    for actual in [6.0, 12.0, 6.0, 6.0, 6.0, 6.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0] {
        damping.learn(&costs(actual), &limit);
        prices.push(damping.s2_per_m2);
    }
    let expected = [
        3.0, 12.0, 48.0, 192.0, 768.0, 1000.0, 250.0, 62.5, 15.625, 3.90625, 0.9765625, 0.0,
    ];
    assert_eq!(prices, expected);
    let mut smallest = Damping { s2_per_m2: 3.0 };
    smallest.learn(&costs(4.0), &limit);
    assert_eq!(smallest.s2_per_m2, 0.0);
    let none = StepLimit {
        damping_max_s2_per_m2: 0.0,
        ..limit
    };
    damping.learn(&costs(12.0), &none);
    assert_eq!(damping.s2_per_m2, 0.0);
}

#[test]
fn steer_is_corrected_by_no_more_than_its_limit_at_the_first_try() {
    let limit = StepLimit {
        steer_m_s: 0.4,
        ..StepLimit::default()
    };
    for (largest_m_s, share) in [(0.0, 1.0), (0.3, 1.0), (0.4, 1.0), (0.8, 0.5), (4.0, 0.1)] {
        assert!((limit.first_share(largest_m_s) - share).abs() < 1e-12);
    }
}

#[test]
fn a_high_price_keeps_planned_inputs_and_a_new_plan_has_none() {
    let mut corrections_m_s = Vec::new();
    for price in [0.0, 1e6] {
        let mut course = Course::new();
        let mut mpc = mpc(settings(40));
        let horizon = course.horizon(&mpc.settings);
        solve(&mut mpc, &horizon, None).unwrap();
        course.drive(&mpc);
        mpc.damping.s2_per_m2 = price;
        let horizon = course.horizon(&mpc.settings);
        solve(&mut mpc, &horizon, None).unwrap();
        let corrections = mpc.solver.point().rollout.inputs.iter();
        corrections_m_s.push(corrections.fold([0.0_f64; 2], |[traction, steer], own| {
            [traction.max(own[0].abs()), steer.max(own[1].abs())]
        }));
        mpc.discard_plan();
        solve(&mut mpc, &horizon, None).unwrap();
        assert_eq!(mpc.damping.s2_per_m2, 0.0);
    }
    for motor in 0..2 {
        assert!(corrections_m_s[1][motor] < 1e-4, "{corrections_m_s:?}");
        assert!(corrections_m_s[0][motor] > 1e-3, "{corrections_m_s:?}");
    }
}

#[test]
fn the_price_keeps_its_share_of_the_cost_however_long_the_stages_are() {
    // The cost of an error at a stage's end, for a correction of the stage's traction, over the correction's price.
    let shares = [1.0, 2.5].map(|stretch| {
        let course = Course::new();
        let mut settings = settings(40);
        settings.last_step_s = 0.3;
        let mut mpc = mpc(settings);
        mpc.move_on(0.0, stretch, &Vector3::z());
        mpc.damping.s2_per_m2 = 5.0;
        let mut horizon = course.horizon(&mpc.settings);
        for target in &mut horizon.targets {
            target.normal_in_world = Vector3::z();
        }
        let stages = mpc.linearise(&horizon).mpc.stages.iter();
        let share = |stage: &Stage| {
            let moved = stage.step.by_traction.xy().norm_squared();
            stage.weights.cross_per_m2 * moved / stage.damping
        };
        stages.map(share).collect::<Vec<_>>()
    });
    for (share, stretched) in shares[0].iter().zip(&shares[1]) {
        assert!(
            (share / stretched - 1.0).abs() < 1e-6,
            "{share} {stretched}"
        );
    }
}
