//! Inertia, and what tyres add in turns and across a slope.

use super::*;

#[test]
fn inertia_settles_on_the_quasi_static_velocity_at_any_step() {
    let mut heavy = j8();
    // A uniform plate of 2.2 m by 1.4 m.
    heavy.yaw_inertia_kg_m2 = Some(1090.0 * (2.2 * 2.2 + 1.4 * 1.4) / 12.0);
    let drive = Drive {
        slope_deg: 5.0,
        heading_from_uphill_deg: 30.0,
        traction_m_s: 0.3,
        steer_m_s: 0.3,
    };
    let ground = GroundState {
        attitude: drive.attitude(),
        ..GroundState::default()
    };
    let still = drive.velocity(&j8());
    for (dt_s, steps) in [(0.001, 4000), (0.005, 800), (0.05, 80)] {
        let mut model = ContactModel::new(heavy.clone());
        let first = model.body_velocity(&ground, drive.treads(), dt_s).unwrap();
        // Friction cannot accelerate by more than mu g and the slope's pull.
        assert!(first.forward_m_s <= (0.9 * 9.81) * dt_s);
        for _ in 1..steps {
            model.body_velocity(&ground, drive.treads(), dt_s).unwrap();
        }
        let settled = model.body_velocity(&ground, drive.treads(), 0.0).unwrap();
        // What remains is the centripetal force of the turn: omega v of 0.1 m/s^2.
        assert!(
            (settled.right_m_s - still.right_m_s).abs() < 0.02,
            "{settled:?} {still:?}"
        );
        assert!((settled.forward_m_s - still.forward_m_s).abs() < 0.02);
        assert!((settled.yaw_rate_rad_s - still.yaw_rate_rad_s).abs() < 0.02);
    }
}

#[test]
fn a_turn_at_speed_slips_outward_by_inertia_and_not_by_tyres() {
    let heavy = warthog();
    let mut soft = warthog();
    soft.yaw_inertia_kg_m2 = None;
    soft.friction.slip_share = 0.3;
    for traction_m_s in [0.4, 0.8, 1.2] {
        let (slow, _) = outward_slip_and_loss(&heavy, traction_m_s, 0.5);
        let (fast, _) = outward_slip_and_loss(&heavy, traction_m_s, 1.2);
        // Logs of real vehicles say 0.2 to 0.4 s, at 0.5 to 2 rad/s.
        assert!((0.08..0.13).contains(&slow), "{slow}");
        assert!((0.2..0.3).contains(&fast), "{fast}");
        let (without_inertia, _) = outward_slip_and_loss(&soft, traction_m_s, 1.2);
        assert!(without_inertia.abs() < 1e-6, "{without_inertia}");
    }
}

#[test]
fn turning_takes_forward_speed_where_tyres_give_way_or_roll_hard() {
    let rigid = outward_slip_and_loss(&warthog(), 0.8, 0.5).1;
    let mut soft = warthog();
    soft.friction.slip_share = 0.3;
    let mut resisting = warthog();
    resisting.friction.rolling_resistance = 0.1;
    assert!((0.0..0.06).contains(&rigid), "{rigid}");
    for vehicle in [soft, resisting] {
        let loss = outward_slip_and_loss(&vehicle, 0.8, 0.5).1;
        // Logs of real vehicles say 0.2 (Warthog) and 0.9 s/rad (Husky).
        assert!((0.15..0.35).contains(&loss), "{loss}");
    }
}

#[test]
fn a_rolling_tyre_creeps_across_a_slope_in_proportion_to_its_speed() {
    let mut vehicle = j8();
    vehicle.friction.slip_share = 0.1;
    let creep = |traction_m_s| {
        let drive = Drive {
            slope_deg: 10.0,
            heading_from_uphill_deg: 90.0,
            traction_m_s,
            ..Drive::default()
        };
        drive.velocity(&vehicle).right_m_s.abs()
    };
    // k V tan(beta) / sqrt(mu^2 - tan(beta)^2) where it is large against eps.
    let share = (10.0_f64.to_radians().tan() / 0.9).asin().tan();
    for speed in [0.5, 1.0] {
        let expected = share * (0.02_f64.hypot(0.1 * speed));
        assert!((creep(speed) / expected - 1.0).abs() < 0.05, "{speed}");
    }
}
