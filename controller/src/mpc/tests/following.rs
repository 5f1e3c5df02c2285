//! The plan after a QP's solution was followed in part.

use super::closed_loop::{Course, begin, mpc, settings, solve};
use super::*;
use crate::mpc::step_limit::StepCosts;
use nalgebra::Rotation3;
use sidehill_plant::contact::{ContactPrediction, ContactVehicle};
use sidehill_plant::frames::Attitude;

/// Checks that a plan's states are those that the model has of its inputs, for a vehicle that moves as `moving`.
fn check_states(model: impl Into<Model>, moving: BodyState) {
    let mut course = Course::new();
    let mut settings = settings(40);
    settings.step_limit.steer_m_s = 0.001;
    let mut mpc = Mpc::new(settings, model).unwrap();
    for cycle in 0..20 {
        let mut horizon = course.horizon(&mpc.settings);
        horizon.moving = moving;
        mpc.move_on(0.05, 1.0, &horizon.targets[0].normal_in_world);
        solve(&mut mpc, &horizon, None).unwrap();
        let mut moving = moving;
        for (k, target) in horizon.targets.iter().enumerate() {
            let state = mpc.plan.states[k];
            let moved = mpc.model.increment_near(
                &mpc.starts[k],
                &target.normal_in_world,
                state.z,
                mpc.plan.inputs[k],
                mpc.times.step_s(k),
                &mut moving,
            );
            let gap = (mpc.plan.states[k + 1] - state - moved).norm();
            assert!(gap < 1e-9, "cycle {cycle}, stage {k}: {gap}");
        }
        course.drive(&mpc);
    }
}

#[test]
fn the_states_of_a_plan_are_those_of_its_inputs_however_little_of_a_solution_is_followed() {
    check_states(
        PredictionModel::new(Vehicle::j8(), 0.05),
        BodyState::steady(Vector3::new(0.0, 0.3, 0.2)),
    );
    for inertia in [0.0, 1.0] {
        let mut wheels = ContactVehicle::of_base("wheels", 0.6, 1.06);
        wheels.set_inertia(inertia);
        let model = ContactPrediction::new(&wheels).unwrap();
        let moving = BodyState {
            velocity: Vector3::new(0.0, 0.3, 0.2),
            force: Vector3::new(0.3, -0.2, 0.1),
        };
        check_states(model, moving);
    }
}

#[test]
fn a_step_is_taken_at_the_heading_that_a_vehicle_with_inertia_has_at_its_middle() {
    let mut wheels = ContactVehicle::of_base("wheels", 0.6, 1.06);
    wheels.set_inertia(1.0);
    let mut contact = ContactPrediction::new(&wheels).unwrap();
    let (driven, step_s) = (motors(0.4, 0.0), 0.3);
    let before = BodyState::steady(Vector3::new(0.0, 0.4, 0.6));
    let (settled, lag) = contact.body_velocity_near(&mut None, Attitude::default(), driven);
    let mean = |time_s: f64| {
        let following = lag.over(time_s);
        following.from(&before, &settled.velocity.vector()).mean
    };
    let turned_rad = 0.5 * step_s * mean(0.5 * step_s).z;
    let expected =
        step_s * (Rotation3::from_axis_angle(&Vector3::z_axis(), turned_rad) * mean(step_s));
    let mut moving = before;
    let start = &mut StepStart::default();
    let step =
        Model::from(contact).step_near(start, &Vector3::z(), 0.0, driven, step_s, &mut moving);
    assert!(
        (step.increment - expected).norm() < 1e-6,
        "{} {expected}",
        step.increment
    );
}

#[test]
fn a_vehicle_with_inertia_keeps_turning_for_a_while_and_one_without_does_not() {
    let turned_rad = |inertia| {
        let mut wheels = ContactVehicle::of_base("wheels", 0.6, 1.06);
        wheels.set_inertia(inertia);
        let mut model = Model::from(ContactPrediction::new(&wheels).unwrap());
        let mut moving = BodyState::steady(Vector3::new(0.0, 0.4, 0.3));
        let step = model.step_near(
            &mut StepStart::default(),
            &Vector3::z(),
            0.0,
            motors(0.4, 0.0),
            0.15,
            &mut moving,
        );
        (step.increment.z, moving.velocity.z)
    };
    let (turned, rate) = turned_rad(0.0);
    assert!(turned.abs() < 1e-9 && rate.abs() < 1e-9, "{turned}, {rate}");
    let (turned, rate) = turned_rad(1.0);
    assert!(turned > 1e-4 && turned < 0.3 * 0.15, "{turned}");
    assert!(rate.abs() < 0.1, "{rate}");
    let (twice, _) = turned_rad(2.0);
    assert!(twice > 1.5 * turned, "{twice}, {turned}");
}

/// Returns the plan that a share of the QP's solution leads to, with what it costs by the linearised dynamics and by the
/// model.
fn moved(mpc: &Mpc, horizon: &Horizon, share: f64) -> (Plan, f64, f64) {
    let mut plan = mpc.plan.clone();
    let corrections = &mpc.solver.point().rollout.inputs;
    let mut deviation = Vector3::zeros();
    for (k, (stage, correction)) in mpc.stages.iter().zip(corrections).enumerate() {
        let [traction, steer] = correction.map(|c| share * c);
        plan.inputs[k].traction_m_s += traction;
        plan.inputs[k].steer_m_s += steer;
        let step = &stage.step;
        deviation = deviation
            + step.by_yaw * deviation.z
            + step.by_traction * traction
            + step.by_steer * steer;
        plan.states[k + 1] += deviation;
    }
    let predicted = mpc.cost_of(&plan, horizon);
    let mut moving = horizon.moving;
    for (k, target) in horizon.targets.iter().enumerate() {
        let from = plan.states[k];
        let (input, step_s) = (plan.inputs[k], mpc.times.step_s(k));
        let (start, normal) = (&mpc.starts[k], &target.normal_in_world);
        let model = &mpc.model;
        let moved = model.increment_near(start, normal, from.z, input, step_s, &mut moving);
        plan.states[k + 1] = from + moved + step_s * target.slip;
    }
    let actual = mpc.cost_of(&plan, horizon);
    (plan, predicted, actual)
}

fn assert_same(own: &Plan, expected: &Plan, at: &str) {
    for (own, expected) in own.states.iter().zip(&expected.states) {
        assert!((own - expected).norm() < 1e-9, "{at}");
    }
    for (own, expected) in own.inputs.iter().zip(&expected.inputs) {
        let traction_m_s = own.traction_m_s - expected.traction_m_s;
        let steer_m_s = own.steer_m_s - expected.steer_m_s;
        assert!(traction_m_s.abs() < 1e-9 && steer_m_s.abs() < 1e-9, "{at}");
    }
}

#[test]
fn a_solution_is_followed_by_the_largest_share_that_the_model_confirms() {
    let mut seen = [0; 4];
    // More than all of the predicted reduction is achieved by no share: then it is the smallest.
    for (accepted_share, steer_m_s) in [(0.1, 0.5), (0.5, 9.0), (0.9, 9.0), (0.97, 9.0), (1.5, 0.2)]
    {
        let mut settings = settings(40);
        settings.step_limit.accepted_share = accepted_share;
        settings.step_limit.steer_m_s = steer_m_s;
        let mut mpc = mpc(settings);
        let mut extra = ExtraCost::default();
        extra.weight[0][0] = 3.0;
        let terms = ExtraTerms::new(vec![extra; 40], Vec::new()).unwrap();
        mpc.set_extra_terms(Some(terms)).unwrap();
        let mut course = Course::new();
        for cycle in 0..25 {
            course.pose.yaw_rad += 1.2 * f64::from(cycle).sin();
            course.pose.x_m += 0.3 * f64::from(cycle).cos();
            let mut horizon = course.horizon(&mpc.settings);
            for target in &mut horizon.targets {
                target.slip = Vector3::new(0.05, -0.03, 0.02);
            }
            mpc.move_on(0.05, 1.0, &horizon.targets[0].normal_in_world);
            if !mpc.planned {
                begin(&mut mpc, &horizon);
            }
            mpc.damping.s2_per_m2 = 0.0;
            let _ = mpc.linearise(&horizon).assemble();
            mpc.solver.solve(None).unwrap();
            let at = format!("accepted {accepted_share}, cycle {cycle}");
            assert_same(&mpc.plan, &moved(&mpc, &horizon, 0.0).0, &at);
            let limit = mpc.settings.step_limit;
            let corrections = mpc.solver.point().rollout.inputs.iter();
            let largest_m_s = corrections.fold(0.0_f64, |m, [_, steer]| m.max(steer.abs()));
            let first = (steer_m_s / largest_m_s).min(1.0);
            let before = mpc.cost_of(&mpc.plan, &horizon);
            let tries = [1.0, 0.5, 0.25, 0.125].map(|share| moved(&mpc, &horizon, first * share));
            let halvings = tries[..3]
                .iter()
                .position(|(_, predicted, actual)| {
                    before - actual >= accepted_share * (before - predicted)
                })
                .unwrap_or(3);
            seen[halvings] += 1;
            mpc.damping.s2_per_m2 = 20.0;
            let mut damping = mpc.damping;
            let (_, predicted, actual) = tries[0];
            let costs = StepCosts {
                before,
                predicted,
                actual,
            };
            damping.learn(&costs, &limit);

            mpc.follow(&horizon);
            let (plan, _, cost) = &tries[halvings];
            assert_same(&mpc.plan, plan, &at);
            assert!((mpc.cost - cost).abs() < 1e-9 * cost, "{at}");
            // A try that achieves too little is not run to its end, and counts as one that achieves nothing.
            if accepted_share <= 0.5 {
                assert_eq!(mpc.damping, damping, "{at}");
            }
            mpc.planned = true;
            course.drive(&mpc);
        }
    }
    assert!(seen.iter().all(|count| *count > 2), "{seen:?}");
}
