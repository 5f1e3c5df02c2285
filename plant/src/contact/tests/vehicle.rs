//! Values out of range, ground that is too steep, and friction that varies.

use super::*;
use crate::test_support::treads;

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
fn patches_turn_a_vehicle_that_slides() {
    let mut patchy = j8();
    patchy.friction.field = FrictionField::Patches {
        minimum: 0.5,
        maximum: 0.9,
        cell_size_m: 1.5,
        seed: 3,
    };
    let mut model = ContactModel::new(patchy);
    let treads = treads(-0.3, 0.3);
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
    let yaml = include_str!("../../../../config/vehicles/j8_contact.yaml");
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
