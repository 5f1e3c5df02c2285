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

#[test]
fn a_base_has_four_axles_evenly_spaced_however_short_it_is() {
    for (half_width_m, half_length_m) in [(0.6, 1.06), (0.5, 0.5), (0.5, 0.2)] {
        let vehicle = ContactVehicle::of_base("base", half_width_m, half_length_m);
        assert_eq!(vehicle.half_width_m, half_width_m);
        let forward_m: Vec<f64> = vehicle.axles.iter().map(|a| a.forward_m).collect();
        assert_eq!(forward_m.len(), 4);
        assert_eq!(
            (forward_m[0], forward_m[3]),
            (half_length_m, -half_length_m)
        );
        for pair in forward_m.windows(2) {
            assert!((pair[0] - pair[1] - half_length_m / 1.5).abs() < 1e-12);
        }
        let carried: f64 = vehicle.axles.iter().map(|a| a.load_share).sum();
        assert!((carried - 1.0).abs() < 1e-12);
        // So the load of its inner axles can be learned.
        assert!(vehicle.has_inner_axles());
        assert!(ContactPrediction::new(&vehicle).is_ok());
    }
}
