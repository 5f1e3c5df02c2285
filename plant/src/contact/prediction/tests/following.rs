//! How a vehicle follows its balance, beside the contact plant.

use super::*;
use crate::speeds::MotorSpeeds;

/// Returns the velocity of the plant after steps of 1 ms at constant attitude and speeds.
fn drive(
    plant: &mut ContactModel,
    attitude: Attitude,
    speeds: MotorSpeeds,
    steps: usize,
) -> Vector3<f64> {
    let ground = GroundState {
        attitude,
        ..GroundState::default()
    };
    let mut velocity = Vector3::zeros();
    for _ in 0..steps {
        velocity = vector(plant.body_velocity(&ground, speeds.into(), 1e-3).unwrap());
    }
    velocity
}

#[test]
fn a_vehicle_without_inertia_follows_at_once_and_no_vehicle_in_no_time() {
    let (velocity, tilt) = (Vector3::new(0.1, 0.2, 0.3), attitude(0.1, 0.05));
    let before = BodyState::steady(velocity);
    for (inertia, time_s, at_once) in [(0.0, 0.05, true), (0.0, 1e-9, true), (1.0, 0.0, false)] {
        let mut vehicle = j8();
        vehicle.set_inertia(inertia);
        let found = ContactPrediction::new(&vehicle)
            .unwrap()
            .predict(tilt, motors(0.3, 0.2));
        let settled = vector(found.linearised.velocity);
        let followed = found.lag.over(time_s).from(&before, &settled);
        let expected = if at_once { settled } else { velocity };
        for found in [followed.mean, followed.end.velocity] {
            assert!((found - expected).norm() < 1e-12, "{inertia}, {time_s}");
        }
    }
}

/// In a steady turn the pull outwards is the weight of the centripetal acceleration, whatever the tyres.
#[test]
fn a_steady_turn_is_that_of_the_plant_with_inertia() {
    for (relaxation_length_m, tilt) in [
        (0.0, attitude(0.05, -0.1)),
        (0.0, attitude(0.0, 0.0)),
        (0.2, attitude(0.0, 0.0)),
    ] {
        steady_turn(relaxation_length_m, tilt);
    }
}

fn steady_turn(relaxation_length_m: f64, tilt: Attitude) {
    let mut vehicle = j8();
    vehicle.set_inertia(1.0);
    vehicle.friction.relaxation_length_m = relaxation_length_m;
    let mut model = ContactPrediction::new(&vehicle).unwrap();
    let speeds = motors(0.6, 0.4);
    let found = model.predict(tilt, speeds);
    let settled = vector(found.linearised.velocity);
    let mut state = BodyState::steady(settled);
    for _ in 0..2000 {
        state = found.lag.over(0.05).from(&state, &settled).end;
    }
    let velocity = state.velocity;
    let driven = drive(&mut ContactModel::new(vehicle), tilt, speeds, 5000);
    let outwards = (driven - settled).norm();
    assert!(outwards > 2e-3, "{outwards}");
    assert!(
        (velocity - driven).norm() < 0.1 * outwards,
        "{velocity}, {driven}, {settled}"
    );
}

/// A small change of the speeds on a flat turn, on a slope and near the end of grip.
#[test]
fn a_velocity_is_followed_as_by_the_plant_with_inertia() {
    for (tilt, tau, sigma) in [
        (attitude(0.0, 0.0), 0.4, 0.3),
        (attitude(0.1, -0.15), 0.4, 0.3),
        (attitude(0.0, -0.3), 0.2, 0.4),
        (attitude(-0.15, 0.1), -0.5, 0.2),
    ] {
        let mut vehicle = j8();
        vehicle.set_inertia(1.2);
        let found = ContactPrediction::new(&vehicle)
            .unwrap()
            .predict(tilt, motors(tau, sigma));
        let settled = vector(found.linearised.velocity);
        let mut plant = ContactModel::new(vehicle);
        let start = drive(&mut plant, tilt, motors(tau, sigma - 0.02), 5000);
        for (time_s, steps) in [(0.02, 20), (0.06, 40), (0.2, 140)] {
            let driven = drive(&mut plant, tilt, motors(tau, sigma), steps);
            let start = BodyState::steady(start);
            let followed = found.lag.over(time_s).from(&start, &settled).end;
            let missed = (followed.velocity - driven).norm() / (start.velocity - settled).norm();
            assert!(missed < 0.15, "{tilt:?}, {time_s} s: {missed}");
        }
    }
}

/// On tyres that relax it swings about its balance; steps of 10 ms on level ground, where the weight pulls nowhere.
#[test]
fn a_vehicle_on_relaxing_tyres_swings_as_the_plant_does() {
    let tilt = attitude(0.0, 0.0);
    for (tau, sigma) in [(0.4, 0.3), (0.6, 0.05), (0.2, 0.4), (-0.5, 0.2)] {
        let mut vehicle = j8();
        vehicle.set_inertia(1.2);
        let stiff = vehicle.clone();
        vehicle.friction.relaxation_length_m = 0.2;
        let mut plant = ContactModel::new(vehicle.clone());
        let before = drive(&mut plant, tilt, motors(tau, sigma - 0.02), 20_000);
        let mut models = [vehicle, stiff].map(|vehicle| {
            let mut model = ContactPrediction::new(&vehicle).unwrap();
            let found = model.predict(tilt, motors(tau, sigma));
            let settled = vector(found.linearised.velocity);
            (
                found.lag.over(0.01),
                settled,
                BodyState::steady(before),
                0.0,
            )
        });
        for _ in 0..60 {
            let driven = drive(&mut plant, tilt, motors(tau, sigma), 10);
            for (following, settled, state, missed) in &mut models {
                *state = following.from(state, settled).end;
                *missed += (state.velocity - driven).norm_squared() / 60.0;
            }
        }
        let change = (models[0].1 - before).norm();
        let [relaxing, stiff] = models.map(|(_, _, _, missed)| missed.sqrt() / change);
        assert!(
            relaxing < 0.3 && stiff > 1.5 * relaxing,
            "{tau}, {sigma}: {relaxing}, {stiff}"
        );
    }
}

/// Turns on a slope of 12 degrees: the tyres' forces come late, which is as if the weight acted ahead of the turn.
#[test]
fn on_relaxing_tyres_a_turn_on_a_slope_is_that_of_the_plant() {
    let speeds = motors(0.5, 0.4);
    let normal = attitude(0.0, 0.21).plane_normal(0.0);
    let mut vehicle = j8();
    vehicle.set_inertia(1.0);
    let stiff = vehicle.clone();
    vehicle.friction.relaxation_length_m = 0.2;
    let mut plant = ContactModel::new(vehicle.clone());
    let mut models = [vehicle, stiff].map(|vehicle| {
        let model = ContactPrediction::new(&vehicle).unwrap();
        (model, BodyState::default(), 0.0)
    });
    let (mut yaw_rad, dt_s) = (0.0, 5e-3);
    for step in 0..8000 {
        let ground = GroundState {
            attitude: Attitude::on_plane(&normal, yaw_rad),
            ..GroundState::default()
        };
        let driven = vector(plant.body_velocity(&ground, speeds.into(), dt_s).unwrap());
        for (model, state, missed) in &mut models {
            let found = model.predict(ground.attitude, speeds);
            let settled = vector(found.linearised.velocity);
            *state = found.lag.over(dt_s).from(state, &settled).end;
            if step >= 2000 {
                *missed += (state.velocity - driven).norm_squared() / 6000.0;
            }
        }
        yaw_rad += dt_s * driven.z;
    }
    let [relaxing, stiff] = models.map(|(_, _, missed)| missed.sqrt());
    // One relaxation time stands for those of all wheels.
    assert!(
        stiff > 1e-2 && relaxing < 0.7 * stiff,
        "{relaxing}, {stiff}"
    );
}
