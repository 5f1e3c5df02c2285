//! The plan after a QP's solution was followed in part.

use super::closed_loop::{Course, settings, solve};
use super::*;
use sidehill_plant::contact::{ContactPrediction, ContactVehicle};

/// Checks that a plan's states are those that the model has of its inputs, for a vehicle that moves as `moving`.
fn check_states(model: impl Into<Model>, moving: BodyState) {
    let mut course = Course::new();
    let mut settings = settings(40, 5);
    settings.step_limit.steer_m_s = 0.001;
    let mut mpc = Mpc::new(settings, model).unwrap();
    for cycle in 0..20 {
        let mut horizon = course.horizon(&mpc.settings);
        horizon.moving = moving;
        mpc.move_on(0.05, 1.0, &horizon.targets[0].normal_in_world);
        solve(&mut mpc, &horizon, None).unwrap();
        let open = mpc
            .stages
            .iter()
            .position(|stage| stage.defect != Vector3::zeros());
        assert_eq!(
            open, None,
            "the QP of cycle {cycle} has a gap between states and inputs"
        );
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
