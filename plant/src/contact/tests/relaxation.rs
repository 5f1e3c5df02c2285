//! Tyres whose force builds up over a length: alone, and under a vehicle.

use super::*;
use crate::contact::balance::Contact;
use crate::contact::relaxation::Relaxation;
use crate::test_support::treads;
use nalgebra::{Vector2, Vector3};

const LENGTH_M: f64 = 0.3;

/// A vehicle of the Warthog's size on soft tyres.
fn soft() -> ContactVehicle {
    let mut vehicle = warthog();
    vehicle.friction.relaxation_length_m = LENGTH_M;
    vehicle.friction.slip_share = 0.1;
    vehicle
}

fn on_slope(slope_deg: f64, heading_from_uphill_deg: f64) -> GroundState {
    GroundState {
        attitude: Attitude::from_slope(
            slope_deg.to_radians(),
            heading_from_uphill_deg.to_radians(),
        ),
        ..GroundState::default()
    }
}

#[test]
fn the_force_of_a_tyre_builds_up_over_its_length_whatever_the_step() {
    let friction = soft().friction;
    let velocity = Vector3::new(0.05, 0.6, 0.1);
    let contact = Contact {
        position: Vector2::new(0.5, 0.4),
        tread_m_s: 0.6,
        load_n: 900.0,
        friction: 0.7,
    };
    let settled = contact.friction_force(&friction, &velocity);
    for (dt_s, steps) in [(0.001, 1000), (0.01, 100), (0.05, 20)] {
        let mut tyre = Relaxation::of(&friction).unwrap();
        // At rest without a slope it bears no force.
        let free = Contact {
            tread_m_s: 0.0,
            ..contact
        };
        tyre.begin(
            &friction,
            &mut [free],
            &Vector3::zeros(),
            Vector3::zeros(),
            dt_s,
        );
        let mut kept = Vector3::zeros();
        for _ in 0..steps {
            let mut contacts = [contact];
            tyre.begin(&friction, &mut contacts, &velocity, Vector3::zeros(), dt_s);
            tyre.end(&friction, &contacts, &velocity);
            // What it keeps over no time is its force but for the share at once.
            kept = tyre.begin(&friction, &mut [contact], &velocity, Vector3::zeros(), 0.0);
        }
        let passed_m = 0.6_f64.hypot(0.05 - 0.1 * 0.4).hypot(0.1 * 0.5);
        let expected = 0.98 * settled * (1.0 - (-passed_m / LENGTH_M).exp());
        assert!(
            (kept.xy() - expected.xy()).norm() < 1e-6 * settled.norm(),
            "{kept} {expected}"
        );
    }
}

/// Velocity in balance without inertia, which is where regularised friction creeps.
fn creep(ground: &GroundState, treads: TreadSpeeds) -> BodyVelocity {
    let mut still = soft();
    still.yaw_inertia_kg_m2 = None;
    still.friction.relaxation_length_m = 0.0;
    ContactModel::new(still)
        .body_velocity(ground, treads, 0.0)
        .unwrap()
}

fn difference(a: &BodyVelocity, b: &BodyVelocity) -> f64 {
    let (x, y) = (a.right_m_s - b.right_m_s, a.forward_m_s - b.forward_m_s);
    x.hypot(y).max((a.yaw_rate_rad_s - b.yaw_rate_rad_s).abs())
}

#[test]
fn at_rest_on_a_slope_the_tyres_hold_the_vehicle_from_the_first_step() {
    for heading_deg in [0.0, 45.0, 90.0] {
        let ground = on_slope(15.0, heading_deg);
        let creep = creep(&ground, treads(0.0, 0.0));
        let mut model = ContactModel::new(soft());
        for _ in 0..2000 {
            let v = model
                .body_velocity(&ground, treads(0.0, 0.0), 0.005)
                .unwrap();
            let (size, limit) = (
                v.right_m_s.hypot(v.forward_m_s),
                creep.right_m_s.hypot(creep.forward_m_s),
            );
            assert!(size < 1.1 * limit, "{heading_deg}: {v:?} {creep:?}");
        }
    }
}

#[test]
fn a_vehicle_that_drives_and_stops_settles_where_friction_balances() {
    let mut model = ContactModel::new(soft());
    let ground = on_slope(10.0, 60.0);
    for (speed, steps) in [(0.6, 800), (0.0, 2000)] {
        let treads = treads(speed, speed);
        let mut last = BodyVelocity::default();
        for _ in 0..steps {
            last = model.body_velocity(&ground, treads, 0.005).unwrap();
            assert!(last.forward_m_s.abs() < 0.8 && last.right_m_s.abs() < 0.2);
        }
        let creep = creep(&ground, treads);
        assert!(difference(&last, &creep) < 1e-3, "{last:?} {creep:?}");
    }
}

#[test]
fn a_steady_turn_slips_outward_by_inertia_as_without_relaxation() {
    let mut rigid = soft();
    rigid.friction.relaxation_length_m = 0.0;
    for (traction_m_s, steer_m_s) in [(0.6, 0.5), (1.0, 1.2)] {
        let (with, without) = (
            outward_slip_and_loss(&soft(), traction_m_s, steer_m_s),
            outward_slip_and_loss(&rigid, traction_m_s, steer_m_s),
        );
        assert!((with.0 - without.0).abs() < 1e-3, "{with:?} {without:?}");
        assert!((with.1 - without.1).abs() < 1e-3, "{with:?} {without:?}");
    }
}

#[test]
fn a_turn_begins_later_on_soft_tyres() {
    let mut rigid = soft();
    rigid.friction.relaxation_length_m = 0.0;
    // Time until a vehicle that drives straight on has turned by 0.1 rad.
    let begins_s = |vehicle: &ContactVehicle| {
        let mut model = ContactModel::new(vehicle.clone());
        let mut yaw_rad = 0.0;
        let mut time_s = -4.0;
        while yaw_rad < 0.1 && time_s < 4.0 {
            let steer_m_s = if time_s < 0.0 { 0.0 } else { 0.3 };
            let v = model
                .body_velocity(
                    &GroundState::default(),
                    treads(0.5 - steer_m_s, 0.5 + steer_m_s),
                    0.005,
                )
                .unwrap();
            yaw_rad += 0.005 * v.yaw_rate_rad_s;
            time_s += 0.005;
        }
        time_s
    };
    let later_s = begins_s(&soft()) - begins_s(&rigid);
    assert!((0.01..0.3).contains(&later_s), "{later_s}");
    let rate = |vehicle| steady_turn(vehicle, 0.5, 0.3).yaw_rate_rad_s;
    assert!((rate(&soft()) - rate(&rigid)).abs() < 1e-3);
}

#[test]
fn relaxation_without_inertia_is_refused() {
    let mut vehicle = soft();
    vehicle.yaw_inertia_kg_m2 = None;
    let error = vehicle.validated().unwrap_err().to_string();
    assert!(
        error.contains("relaxation_length_m") && error.contains("yaw_inertia_kg_m2"),
        "{error}"
    );
}
