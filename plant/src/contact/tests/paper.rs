//! What the paper measured on the real J8.

use super::*;

fn j8_with_inner_share(inner_share: f64) -> ContactVehicle {
    let mut vehicle = j8();
    for axle in &mut vehicle.axles {
        let inner = axle.forward_m.abs() < 0.5;
        axle.load_share = 0.5
            * if inner {
                inner_share
            } else {
                1.0 - inner_share
            };
    }
    vehicle
}

/// Slide downhill per slope and turn rate, m/rad, for turning on the spot both ways at headings
/// `heading_deg` and opposite.
fn slide_gain(vehicle: &ContactVehicle, heading_deg: f64, traction_m_s: f64) -> f64 {
    let mut total = 0.0;
    for steer_m_s in [-0.33, 0.33] {
        for heading_from_uphill_deg in [heading_deg, heading_deg + 180.0] {
            let drive = Drive {
                slope_deg: 4.0,
                heading_from_uphill_deg,
                traction_m_s,
                steer_m_s,
            };
            let turn = drive.velocity(vehicle).yaw_rate_rad_s.abs();
            total += drive.slide(vehicle).0 / (4.0_f64.to_radians() * turn);
        }
    }
    0.25 * total
}

/// Mean of 2 sigma / omega for both ways of turning on the spot, m.
fn effective_track_m(vehicle: &ContactVehicle, slope_deg: f64, heading_deg: f64) -> f64 {
    let track = |steer_m_s: f64, heading_from_uphill_deg: f64| {
        let drive = Drive {
            slope_deg,
            heading_from_uphill_deg,
            steer_m_s,
            ..Drive::default()
        };
        2.0 * steer_m_s / drive.velocity(vehicle).yaw_rate_rad_s
    };
    let opposite_deg = heading_deg + 180.0;
    0.25 * (track(0.33, heading_deg)
        + track(-0.33, heading_deg)
        + track(0.33, opposite_deg)
        + track(-0.33, opposite_deg))
}

#[test]
fn level_icrs_are_those_of_table_one() {
    for traction_m_s in [0.0, 0.3, 0.6] {
        for steer_m_s in [-0.5, -0.15, 0.15, 0.5] {
            let drive = Drive {
                traction_m_s,
                steer_m_s,
                ..Drive::default()
            };
            let v = drive.velocity(&j8());
            // Equation (4) solved for the ICRs.
            let left = (drive.treads().left_m_s - v.forward_m_s) / v.yaw_rate_rad_s;
            let right = (drive.treads().right_m_s - v.forward_m_s) / v.yaw_rate_rad_s;
            let forward = v.right_m_s / v.yaw_rate_rad_s;
            let off = [left + 0.980, right - 1.073, forward - 0.206];
            assert!(off.iter().all(|m| m.abs() < 0.05), "{off:?}");
        }
    }
}

#[test]
fn straight_ahead_there_is_only_a_creep() {
    // Without rolling resistance all wheels slip alike: mu = tan(slope) sqrt(s^2 + eps^2) / s.
    let mut free = j8();
    free.friction.rolling_resistance = 0.0;
    for (slope_deg, creep_mm_s) in [(4.0, 1.6), (5.3, 2.1), (10.0, 4.0), (15.0, 6.2)] {
        let tan = f64::to_radians(slope_deg).tan();
        let expected = 0.02 * tan / (0.9_f64.powi(2) - tan * tan).sqrt();
        assert!((1e3 * expected - creep_mm_s).abs() < 0.06, "{expected}");
        for heading in 0..8 {
            let drive = Drive {
                slope_deg,
                heading_from_uphill_deg: 45.0 * f64::from(heading),
                traction_m_s: 0.5,
                steer_m_s: 0.0,
            };
            let (down, along) = drive.slide(&free);
            let turn = drive.velocity(&free).yaw_rate_rad_s;
            // Roll and pitch by equation (1) are those of a plane to third order in the slope.
            assert!(
                (down - expected).abs() < 0.02 * expected,
                "{down} {expected}"
            );
            assert!(along.abs() < 1e-4 && turn.abs() < 1e-9, "{along} {turn}");
            let (down, along) = drive.slide(&j8());
            let turn = drive.velocity(&j8()).yaw_rate_rad_s;
            assert!(
                down < 1.1 * expected && along.abs() < 3e-4,
                "{down} {along}"
            );
            assert!(turn.abs() < 1e-4, "{turn}");
        }
    }
}

#[test]
fn turning_slides_downhill_in_proportion_to_the_turn() {
    for steer_m_s in [-0.4, 0.4] {
        let (mut total_down, mut total_along) = (0.0, 0.0);
        for heading in 0..24 {
            let drive = Drive {
                slope_deg: 4.0,
                heading_from_uphill_deg: 15.0 * f64::from(heading),
                traction_m_s: 0.0,
                steer_m_s,
            };
            let (down, along) = drive.slide(&j8());
            assert!(down > 0.02 && along.abs() < 0.75 * down, "{down} {along}");
            total_down += down;
            total_along += along;
            let half = Drive {
                steer_m_s: 0.5 * steer_m_s,
                ..drive
            };
            let ratio = half.slide(&j8()).0 / down;
            assert!((0.47..0.51).contains(&ratio), "{ratio}");
        }
        assert!(total_along.abs() < 0.1 * total_down, "{total_along}");
    }
}

#[test]
fn speed_reduces_the_slide_by_as_much_as_wheels_resist_rolling() {
    let gains = |rolling_resistance, heading_deg| {
        let mut vehicle = j8();
        vehicle.friction.rolling_resistance = rolling_resistance;
        [0.0, 0.6].map(|traction_m_s| slide_gain(&vehicle, heading_deg, traction_m_s))
    };
    // Coulomb friction knows slip only, so without rolling resistance a common tread speed is nothing.
    for heading_deg in [0.0, 90.0] {
        let [slow, fast] = gains(0.0, heading_deg);
        assert!((slow - fast).abs() < 1e-6, "{slow} {fast}");
    }
    let share = |rolling_resistance, heading_deg| {
        let [slow, fast] = gains(rolling_resistance, heading_deg);
        fast / slow
    };
    let up = [0.02, 0.05, 0.1].map(|c| share(c, 0.0));
    assert!(
        (0.94..0.96).contains(&up[0]) && (0.76..0.80).contains(&up[2]),
        "{up:?}"
    );
    assert!(up.is_sorted_by(|less, more| less > more));
    let across = share(0.02, 90.0);
    assert!((0.98..0.999).contains(&across), "{across}");
}

#[test]
fn equal_loads_slide_twice_as_much_up_and_down_as_across() {
    let ratio = |inner_share| {
        let vehicle = j8_with_inner_share(inner_share);
        slide_gain(&vehicle, 0.0, 0.0) / slide_gain(&vehicle, 90.0, 0.0)
    };
    let ratios = [0.5, 0.6, 0.7, 0.743, 0.8, 0.9].map(ratio);
    assert!((1.9..2.2).contains(&ratios[0]), "{ratios:?}");
    assert!((1.45..1.6).contains(&ratios[3]), "{ratios:?}");
    assert!((1.0..1.15).contains(&ratios[5]), "{ratios:?}");
    assert!(ratios.is_sorted_by(|equal, inner| equal > inner));
}

#[test]
fn the_track_is_wider_up_and_down_than_across() {
    for inner_share in [0.5, 0.743] {
        let vehicle = j8_with_inner_share(inner_share);
        let up = effective_track_m(&vehicle, 8.0, 0.0);
        let across = effective_track_m(&vehicle, 8.0, 90.0);
        let level = effective_track_m(&vehicle, 0.0, 0.0);
        assert!(
            up > level + 0.05 && up > across + 0.05,
            "{up} {across} {level}"
        );
    }
}
