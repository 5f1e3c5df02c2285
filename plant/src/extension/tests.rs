use super::*;
use crate::prediction::PredictionModel;
use crate::test_support::{attitude, motors, slope, vector};
use crate::vehicle::Vehicle;
use proptest::prelude::*;

const GAINS: ExtensionGains = ExtensionGains {
    outward_slip_s: 0.3,
    turn_loss_s_per_rad: 0.5,
    creep_per_rad: 0.2,
    creep_m_s_per_rad: 0.05,
};

fn with(gains: ExtensionGains) -> Vehicle {
    let mut vehicle = Vehicle::j8();
    vehicle.extension = Some(Extension {
        gains,
        icrs: vehicle.icrs,
        slide: vehicle.slide,
        encoder_scale: vehicle.encoder_scale,
    });
    vehicle
}

#[test]
fn a_left_turn_slips_to_the_right_and_takes_speed() {
    let vehicle = with(ExtensionGains {
        creep_per_rad: 0.0,
        creep_m_s_per_rad: 0.0,
        ..GAINS
    });
    let treads = TreadSpeeds::from(motors(0.6, 0.3));
    let icrik = vehicle.body_velocity(Attitude::LEVEL, treads);
    let extended = vehicle.extended_velocity(Attitude::LEVEL, treads);
    let omega = icrik.yaw_rate_rad_s;
    assert!(omega > 0.0);
    assert_eq!(extended.yaw_rate_rad_s, omega);
    let forward = icrik.forward_m_s / (1.0 + 0.5 * omega);
    assert!((extended.forward_m_s - forward).abs() < 1e-15);
    assert!((extended.right_m_s - icrik.right_m_s - 0.3 * omega * forward).abs() < 1e-15);
}

#[test]
fn creep_leads_downhill_and_stops_with_the_treads() {
    let vehicle = with(GAINS);
    // Right side down and nose up: downhill is right and back.
    let slope = attitude(0.1, 0.05);
    let at = |tau| vehicle.extended_velocity(slope, motors(tau, 0.0).into());
    let creep = 0.2 * 0.5 + 0.05;
    assert!((at(0.5).right_m_s - creep * 0.1).abs() < 1e-15);
    assert!((at(0.5).forward_m_s - (0.5 - creep * 0.05)).abs() < 1e-15);
    assert!((at(-0.5).right_m_s - creep * 0.1).abs() < 1e-15);
    assert_eq!(at(0.0), BodyVelocity::default());
}

#[test]
fn without_gains_it_is_icrik() {
    let vehicle = with(ExtensionGains::default());
    let treads = TreadSpeeds::from(motors(0.4, -0.2));
    let slope = attitude(0.1, -0.2);
    assert_eq!(
        vehicle.extended_velocity(slope, treads),
        Vehicle::j8().body_velocity(slope, treads)
    );
    let at = |vehicle| PredictionModel::new(vehicle, 0.05).body_velocity(slope, motors(0.4, -0.2));
    assert_eq!(at(vehicle), at(Vehicle::j8()));
}

#[test]
fn yaml_replaces_parameters_and_names_what_is_out_of_range() {
    let yaml = include_str!("../../../config/vehicles/j8.yaml");
    let parse = |extension: &str| {
        serde_yaml::from_str::<Vehicle>(&format!("{yaml}extension: {extension}\n"))
    };
    let vehicle = parse("{outward_slip_s: 0.2, correction_left: 1.1}").unwrap();
    let extended = vehicle.extended();
    assert_eq!(vehicle.encoder_scale.left, 1.004);
    assert_eq!(extended.encoder_scale.left, 1.1);
    assert_eq!(extended.icrs, vehicle.icrs);
    assert_eq!(extended.extended(), extended);
    assert_eq!(vehicle.on_level_ground().extension, None);
    let again: Vehicle = serde_yaml::from_str(&serde_yaml::to_string(&vehicle).unwrap()).unwrap();
    assert_eq!(again, vehicle);
    for (extension, key) in [
        ("{outward_slip_s: -0.1}", "extension.outward_slip_s: -0.1"),
        ("{creep_per_rad: .nan}", "extension.creep_per_rad: NaN"),
        ("{x_icr_left_m: -0.5}", "extension.x_icr_left_m: -0.5"),
        ("{outward: 1}", "outward"),
    ] {
        let error = parse(extension).unwrap_err().to_string();
        assert!(error.contains(key), "{error}");
    }
}

proptest! {
    #[test]
    fn prediction_tends_to_the_exact_terms(
        roll in -0.3..0.3f64, pitch in -0.3..0.3f64, tau in -1.0..1.0f64, sigma in -1.0..1.0f64) {
        prop_assume!(sigma.abs() > 0.01);
        let smooth = PredictionModel::new(with(GAINS), 1e-7)
            .body_velocity(attitude(roll, pitch), motors(tau, sigma)).velocity;
        let exact = with(GAINS).extended_velocity(attitude(roll, pitch), motors(tau, sigma).into());
        prop_assert!((vector(smooth) - vector(exact)).norm() < 1e-5);
    }

    #[test]
    fn jacobians_are_central_differences(
        roll in -0.3..0.3f64, pitch in -0.3..0.3f64, tau in -0.9..0.9f64, sigma in -0.9..0.9f64) {
        prop_assume!((roll.abs() - pitch.abs()).abs() > 1e-3 && roll.abs() > 1e-3 && pitch.abs() > 1e-3);
        // Clear of the limits of the ICRs, which are kinks.
        let mut vehicle = with(GAINS);
        vehicle.base_half_width_m = 0.3;
        vehicle.icrs.left_m = -2.0;
        vehicle.icrs.right_m = 2.1;
        let model = PredictionModel::new(vehicle, 0.05);
        let f = |a, m| vector(model.body_velocity(a, m).velocity);
        let at = model.body_velocity(attitude(roll, pitch), motors(tau, sigma));
        for (analytic, numeric) in [
            (at.by_roll, slope(|h| f(attitude(roll + h, pitch), motors(tau, sigma)))),
            (at.by_pitch, slope(|h| f(attitude(roll, pitch + h), motors(tau, sigma)))),
            (at.by_traction, slope(|h| f(attitude(roll, pitch), motors(tau + h, sigma)))),
            (at.by_steer, slope(|h| f(attitude(roll, pitch), motors(tau, sigma + h)))),
        ] {
            prop_assert!((analytic - numeric).norm() < 1e-6, "{analytic} {numeric}");
        }
    }

    #[test]
    fn left_and_right_are_mirrored(
        roll in -0.3..0.3f64, pitch in -0.3..0.3f64, tau in -1.0..1.0f64, sigma in -1.0..1.0f64) {
        let mut vehicle = with(GAINS);
        vehicle.icrs.left_m = -vehicle.icrs.right_m;
        let at = |roll, sigma| vehicle.extended_velocity(attitude(roll, pitch), motors(tau, sigma).into());
        let (one, other) = (at(roll, sigma), at(-roll, -sigma));
        prop_assert!((one.right_m_s + other.right_m_s).abs() < 1e-12);
        prop_assert!((one.forward_m_s - other.forward_m_s).abs() < 1e-12);
        prop_assert!((one.yaw_rate_rad_s + other.yaw_rate_rad_s).abs() < 1e-12);
    }
}
