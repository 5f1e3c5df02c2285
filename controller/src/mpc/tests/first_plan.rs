//! The plan that a first QP is linearised about.

use super::closed_loop::{begin, mpc, settings, solve};
use super::*;
use crate::tracked_point::TrackedPoint;
use sidehill_plant::frames::wrap_angle;

/// Returns a horizon along +Y_g at `speed_m_s` on 10 degrees, for a vehicle so far to the right of it, ahead of it and
/// turned.
fn beside(speed_m_s: f64, right_m: f64, ahead_m: f64, yaw_rad: f64) -> Horizon {
    let slope = 10.0_f64.to_radians();
    let target = |k: usize| StageTarget {
        pose: PlanarPose {
            x_m: 0.0,
            y_m: speed_m_s * 0.15 * k as f64,
            yaw_rad: 0.0,
        },
        tracked_point: TrackedPoint::ORIGIN,
        along_heading_rad: 0.0,
        curvature_per_m: 0.0,
        normal_in_world: Vector3::new(slope.sin(), 0.0, slope.cos()),
        feedforward: motors(speed_m_s, 0.0),
        speed_m_s,
        slip: Vector3::zeros(),
        weights: StageWeights {
            along_per_m2: 1.0,
            cross_per_m2: 50.0,
            heading_per_rad2: 0.02,
            speed_s2_per_m2: 0.0,
        },
        errors_share: 1.0,
    };
    Horizon {
        start: PlanarPose {
            x_m: right_m,
            y_m: ahead_m,
            yaw_rad,
        },
        moving: BodyState::default(),
        previous: MotorSpeeds::STOP,
        change_weights: ChangeWeights {
            traction: 0.05,
            steer: 0.05,
        },
        half_track_m: 1.0,
        targets: (1..=40).map(target).collect(),
    }
}

#[test]
fn a_first_plan_from_or_to_nowhere_is_a_failure_and_the_next_one_is_right() {
    let horizon = beside(0.5, 0.3, 0.0, 0.2);
    let mut mpc = mpc(settings(40));
    let mut lost = horizon.clone();
    lost.start.x_m = f64::NAN;
    let mut nowhere = horizon.clone();
    nowhere.targets[7].pose.yaw_rad = f64::NAN;
    for horizon in [&lost, &nowhere] {
        let failure = solve(&mut mpc, horizon, None);
        assert_eq!(failure, Err(QpFailure::NotFinite));
        let finite = |plan: &Plan| plan.states.iter().flatten().all(|value| value.is_finite());
        assert!(mpc.plan().is_none_or(finite));
    }
    solve(&mut mpc, &horizon, None).unwrap();
}

#[test]
fn an_input_changes_in_the_time_of_the_stage_before_it() {
    let mut settings = settings(40);
    settings.last_step_s = 0.4;
    settings.limits.traction.acceleration_m_s2 = 0.1;
    let mut mpc = mpc(settings);
    begin(&mut mpc, &beside(0.7, 0.0, 0.0, 0.0));
    let (mut time_s, mut k) = (mpc.settings.period_s, 0);
    while 0.1 * time_s < 0.7 {
        let traction_m_s = mpc.plan.inputs[k].traction_m_s;
        assert!((traction_m_s - 0.1 * time_s).abs() < 1e-9, "{k}");
        time_s += mpc.times.step_s(k);
        k += 1;
    }
    assert!(k > 20, "{k}");
}

#[test]
fn a_plan_that_got_stuck_is_given_up_for_a_drive_towards_the_path() {
    let horizon = beside(0.5, 0.3, 0.0, 0.2);
    let mut settings = settings(40);
    // So little of a QP's solution is followed that only a new plan gets the vehicle out.
    settings.step_limit.steer_m_s = 1e-3;
    let mut mpc = mpc(settings);
    solve(&mut mpc, &horizon, None).unwrap();
    let good = mpc.plan().unwrap().clone();
    let back = motors(-0.5, 0.0);
    mpc.plan.inputs.fill(back);
    for (k, target) in horizon.targets.iter().enumerate() {
        let state = mpc.plan.states[k];
        let normal = &target.normal_in_world;
        let step = mpc.model.step_on_plane(normal, state.z, back, 0.15);
        mpc.plan.states[k + 1] = state + step.increment;
    }
    mpc.cost = mpc.cost_of(&mpc.plan, &horizon);
    solve(&mut mpc, &horizon, None).unwrap();
    let end = mpc.plan.states[40];
    assert!((end - good.states[40]).norm() < 0.2, "{end}");
    assert!(
        mpc.plan
            .inputs
            .iter()
            .all(|input| input.traction_m_s >= 0.0)
    );
}

#[test]
fn a_plan_that_is_nearly_as_good_as_a_drive_is_kept() {
    let horizon = beside(0.5, 0.3, 0.0, 0.2);
    let mut mpc = mpc(settings(40));
    for _ in 0..20 {
        solve(&mut mpc, &horizon, None).unwrap();
    }
    let kept = mpc.plan().unwrap().clone();
    let cost = mpc.cost_of(&mpc.plan, &horizon);
    assert!(cost > 0.02 * 0.02 * 50.0 * 40.0, "{cost}");
    assert!(mpc.wants_first_plan());
    begin(&mut mpc, &horizon);
    assert_eq!(mpc.plan, kept);
}

#[test]
fn a_plan_is_given_up_for_a_drive_that_costs_less_than_four_fifths_of_it() {
    let horizon = beside(0.5, 0.3, 0.0, 0.2);
    let mut mpc = mpc(settings(40));
    let mut extra = ExtraCost::default();
    extra.weight[0][0] = 3.0;
    let terms = ExtraTerms::new(vec![extra; 40], Vec::new()).unwrap();
    mpc.set_extra_terms(Some(terms)).unwrap();
    solve(&mut mpc, &horizon, None).unwrap();
    let plan = mpc.plan().unwrap().clone();
    mpc.discard_plan();
    begin(&mut mpc, &horizon);
    let drive = mpc.cost_of(&mpc.plan, &horizon);
    for (share, is_kept) in [(0.81, true), (0.79, false)] {
        mpc.plan = plan.clone();
        mpc.cost = drive / share;
        begin(&mut mpc, &horizon);
        assert_eq!(mpc.plan == plan, is_kept, "{share}");
    }
}

#[test]
fn a_plan_that_leaves_little_to_gain_is_kept_however_much_better_a_drive_is() {
    let mut horizon = beside(0.5, 0.0, 0.0, 0.0);
    horizon.previous = motors(0.5, 0.0);
    let mut mpc = mpc(settings(40));
    solve(&mut mpc, &horizon, None).unwrap();
    mpc.plan.inputs[39].traction_m_s = 0.4;
    let kept = mpc.plan().unwrap().clone();
    // Little is less than 2 cm across the path, at a weight of 50 in 40 stages.
    let little = 0.02 * 0.02 * 50.0 * 40.0;
    mpc.cost = 0.99 * little;
    assert!(!mpc.wants_first_plan());
    mpc.cost = 1.01 * little;
    assert!(mpc.wants_first_plan());
    begin(&mut mpc, &horizon);
    assert_ne!(mpc.plan, kept);
    assert!(mpc.cost_of(&mpc.plan, &horizon) < 0.8 * little);
}

proptest! {
    #[test]
    fn a_first_plan_leads_to_the_path_within_the_limits(
        speed_m_s in prop_oneof![-0.7..-0.3, 0.3..0.7],
        right_m in -0.5..0.5,
        ahead_m in -0.3..0.3,
        yaw_rad in -0.6..0.6,
    ) {
        let horizon = beside(speed_m_s, right_m, ahead_m, yaw_rad);
        let mut mpc = mpc(settings(40));
        begin(&mut mpc, &horizon);
        let limits = mpc.settings.limits;
        let mut before = horizon.previous;
        for k in 0..40 {
            let input = mpc.plan.inputs[k];
            let kept = limits.project(input, before, mpc.change_time_s(k));
            prop_assert!((kept.traction_m_s - input.traction_m_s).abs() < 1e-12, "{k}");
            prop_assert!((kept.steer_m_s - input.steer_m_s).abs() < 1e-12, "{k}");
            prop_assert!(input.traction_m_s * speed_m_s >= 0.0, "{k}: {input:?}");
            let target = &horizon.targets[k];
            let state = &mpc.plan.states[k];
            let step = mpc.model.step_on_plane(&target.normal_in_world, state.z, input, 0.15);
            prop_assert!((mpc.plan.states[k + 1] - state - step.increment).norm() < 1e-12, "{k}");
            before = input;
        }
        let (end, target) = (&mpc.plan.states[40], &horizon.targets[39].pose);
        // What is left beside the path makes up for the slide.
        prop_assert!((end.x - target.x_m).abs() < 0.2, "{end}");
        let whole_m = target.y_m.abs();
        prop_assert!(speed_m_s.signum() * (end.y - ahead_m) > 0.6 * whole_m, "{end}");
        // The slower, the less of the way back lies within the horizon.
        let way_back_rad = (2.0 * (end.x - target.x_m).abs()).atan();
        prop_assert!(wrap_angle(end.z - target.yaw_rad).abs() < way_back_rad + 0.25, "{end}");
    }
}
