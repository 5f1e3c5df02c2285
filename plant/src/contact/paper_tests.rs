//! What the contact vehicle does by itself, against what the paper measured on the real one.

use super::*;
use crate::frames::{Attitude, BodyVelocity};
use crate::motion::{GroundState, MotionError, MotionModel};
use crate::speeds::{MotorSpeeds, TreadSpeeds};

/// The J8 of `config/vehicles/j8_contact.yaml`.
pub(super) fn j8() -> ContactVehicle {
    serde_yaml::from_str(include_str!("../../../config/vehicles/j8_contact.yaml")).unwrap()
}

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

/// Where the vehicle stands on a slope, and how its motors turn.
#[derive(Clone, Copy, Default)]
struct Drive {
    slope_deg: f64,
    heading_from_uphill_deg: f64,
    traction_m_s: f64,
    steer_m_s: f64,
}

impl Drive {
    fn attitude(&self) -> Attitude {
        Attitude::from_slope(
            self.slope_deg.to_radians(),
            self.heading_from_uphill_deg.to_radians(),
        )
    }

    fn treads(&self) -> TreadSpeeds {
        TreadSpeeds::from(MotorSpeeds {
            traction_m_s: self.traction_m_s,
            steer_m_s: self.steer_m_s,
        })
    }

    fn try_velocity(&self, vehicle: &ContactVehicle) -> Result<BodyVelocity, MotionError> {
        let ground = GroundState {
            attitude: self.attitude(),
            ..GroundState::default()
        };
        ContactModel::new(vehicle.clone()).body_velocity(&ground, self.treads(), 0.0)
    }

    fn velocity(&self, vehicle: &ContactVehicle) -> BodyVelocity {
        self.try_velocity(vehicle).unwrap()
    }

    /// Slide down the slope and along its horizon that the slope adds, m/s.
    fn slide(&self, vehicle: &ContactVehicle) -> (f64, f64) {
        let level = Self {
            slope_deg: 0.0,
            ..*self
        };
        let (here, there) = (self.velocity(vehicle), level.velocity(vehicle));
        let (right, forward) = (
            here.right_m_s - there.right_m_s,
            here.forward_m_s - there.forward_m_s,
        );
        let (sin, cos) = self.heading_from_uphill_deg.to_radians().sin_cos();
        // Uphill in body axes is (sin gamma, cos gamma).
        (-(sin * right + cos * forward), cos * right - sin * forward)
    }
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

#[test]
fn ground_too_steep_is_reported_with_its_place() {
    let drive = Drive {
        slope_deg: 43.0,
        ..Drive::default()
    };
    let mut low = j8();
    low.centre_of_mass.height_m = 0.1;
    let error = drive.try_velocity(&low).unwrap_err();
    assert!(matches!(error, MotionError::NotConverged { .. }), "{error}");
    let error = Drive {
        slope_deg: 60.0,
        heading_from_uphill_deg: 90.0,
        ..drive
    }
    .try_velocity(&j8())
    .unwrap_err();
    assert!(matches!(error, MotionError::Overturned { .. }), "{error}");
}

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
fn patches_turn_a_vehicle_that_slides() {
    let mut patchy = j8();
    patchy.friction.field = FrictionField::Patches {
        minimum: 0.5,
        maximum: 0.9,
        cell_size_m: 1.5,
        seed: 3,
    };
    let mut model = ContactModel::new(patchy);
    let treads = TreadSpeeds {
        left_m_s: -0.3,
        right_m_s: 0.3,
    };
    let at = |x_m: f64, model: &mut ContactModel| {
        let mut ground = GroundState::default();
        ground.position.x_m = x_m;
        model
            .body_velocity(&ground, treads, 0.0)
            .unwrap()
            .yaw_rate_rad_s
    };
    let rates: Vec<f64> = (0..20).map(|k| at(f64::from(k), &mut model)).collect();
    let mean = rates.iter().sum::<f64>() / 20.0;
    let spread = rates.iter().map(|r| (r - mean).abs()).fold(0.0, f64::max) / mean;
    assert!((0.002..0.3).contains(&spread), "{rates:?}");
}

#[test]
fn keys_out_of_range_are_named() {
    let yaml = include_str!("../../../config/vehicles/j8_contact.yaml");
    let error = |from: &str, to: &str| {
        assert!(yaml.contains(from));
        serde_yaml::from_str::<ContactVehicle>(&yaml.replace(from, to))
            .unwrap_err()
            .to_string()
    };
    assert!(error("mass_kg: 1090.0", "mass_kg: -1").contains("mass_kg: -1"));
    assert!(error("load_share: 0.3715", "load_share: 0.5").contains("together carry 1"));
    assert!(error("coefficient: 0.9", "coefficient: 9").contains("from 0.05 to 2"));
    assert!(error("slip_scale_m_s", "slip_scale").contains("slip_scale"));
    let again = serde_yaml::to_string(&j8()).unwrap();
    assert_eq!(
        serde_yaml::from_str::<ContactVehicle>(&again).unwrap(),
        j8()
    );
}

/// A vehicle of the Warthog's size (two axles 0.91 m apart, treads 1.08 m) with planar inertia.
pub(super) fn warthog() -> ContactVehicle {
    let mut vehicle = j8();
    vehicle.mass_kg = 350.0;
    vehicle.half_width_m = 0.54;
    vehicle.axles = vec![
        Axle {
            forward_m: 0.455,
            load_share: 0.5,
        },
        Axle {
            forward_m: -0.455,
            load_share: 0.5,
        },
    ];
    vehicle.centre_of_mass = CentreOfMass {
        right_m: 0.0,
        forward_m: 0.0,
        height_m: 0.3,
    };
    vehicle.friction.field = FrictionField::Uniform { coefficient: 0.7 };
    vehicle.yaw_inertia_kg_m2 = Some(350.0 * (1.2 * 1.2 + 1.1 * 1.1) / 12.0);
    vehicle
}

/// Velocity of a steady turn on level ground, the vehicle's own inertia included.
pub(super) fn steady_turn(
    vehicle: &ContactVehicle,
    traction_m_s: f64,
    steer_m_s: f64,
) -> BodyVelocity {
    let mut model = ContactModel::new(vehicle.clone());
    let treads = TreadSpeeds::from(MotorSpeeds {
        traction_m_s,
        steer_m_s,
    });
    let mut velocity = BodyVelocity::default();
    for _ in 0..1000 {
        velocity = model
            .body_velocity(&GroundState::default(), treads, 0.01)
            .unwrap();
    }
    velocity
}

/// kappa and b of the extended model that a steady turn shows, see [`crate::extension`].
pub(super) fn outward_slip_and_loss(
    vehicle: &ContactVehicle,
    traction_m_s: f64,
    steer_m_s: f64,
) -> (f64, f64) {
    let turn = steady_turn(vehicle, traction_m_s, steer_m_s);
    (
        turn.right_m_s / (turn.yaw_rate_rad_s * turn.forward_m_s),
        (traction_m_s / turn.forward_m_s - 1.0) / turn.yaw_rate_rad_s,
    )
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
