#![allow(clippy::unwrap_used)]

use super::tests::{contact_logs, contact_logs_of};
use super::*;
use crate::contact::{ContactVehicle, Parameter};
use crate::log::DriveLog;
use crate::vehicle::Vehicle;

fn settings() -> IdentificationSettings {
    IdentificationSettings {
        segmentation: Segmentation::of_length(8.0).unwrap(),
        attitude_smoothing_s: 0.2,
    }
}

fn j8() -> ContactVehicle {
    serde_yaml::from_str(include_str!("../../../config/vehicles/j8_contact.yaml")).unwrap()
}

/// A vehicle of which only the geometry of `truth` is known, and whose encoders are taken as right.
fn measured(truth: &ContactVehicle) -> Vehicle {
    let mut vehicle = Vehicle::j8();
    vehicle.encoder_scale.left = 1.0;
    vehicle.encoder_scale.right = 1.0;
    vehicle.contact = Some(truth.geometry_alone());
    vehicle
}

fn estimate(report: &ContactReport, name: &str) -> ContactParameterEstimate {
    *report.estimates.iter().find(|e| e.name == name).unwrap()
}

/// Returns how many of the ten intervals of parameters hold the truth.
fn intervals_with(report: &ContactReport, truth: &ContactVehicle) -> usize {
    let parameters = truth.parameters();
    let holds = |parameter: &&Parameter| {
        let (low, high) = estimate(report, parameter.key()).interval;
        let value = parameter.value(parameters[parameter.index()]);
        (low..=high).contains(&value)
    };
    let of_vehicle = Parameter::ALL.iter().filter(|p| p.is_identified());
    of_vehicle.filter(holds).count()
}

#[test]
fn the_wheels_are_found_from_geometry_alone() {
    let truth = j8();
    let logs = contact_logs(&truth, 3);
    let (vehicle, report) = identify_contact(&logs, &measured(&truth), &settings()).unwrap();
    let inside = intervals_with(&report, &truth);
    assert!(inside >= 8, "{inside} of 10 intervals hold the truth");
    let scale = vehicle.contact_encoder_scale.unwrap();
    assert!((scale.left / 1.004 - 1.0).abs() < 0.004, "{scale:?}");
    assert!((scale.right / 1.011 - 1.0).abs() < 0.004, "{scale:?}");
    let (guess, found) = (&report.guess, &report.held_out);
    assert!(found.lateral_m < 0.5 * guess.lateral_m, "{report:?}");
}

#[test]
fn what_level_logs_do_not_tell_stays_a_guess() {
    let truth = j8();
    let [level, ..] = contact_logs(&truth, 5);
    let vehicle = measured(&truth);
    let (_, report) =
        identify_contact(std::slice::from_ref(&level), &vehicle, &settings()).unwrap();
    assert!(intervals_with(&report, &truth) >= 8, "{report:?}");
    // On level ground only ratios of forces count.
    for name in ["friction", "centre_of_mass_height_m"] {
        assert!(!estimate(&report, name).determined, "{report:?}");
    }
    let apart = |one, other| {
        let mut pairs = report.not_told_apart.iter();
        !pairs.any(|(a, b, _)| (*a, *b) == (one, other))
    };
    assert!(!apart("friction", "rolling_resistance"), "{report:?}");
    assert!(
        apart("centre_of_mass_right_m", "slip_scale_m_s"),
        "{report:?}"
    );
}

#[test]
fn the_radius_of_a_patch_is_found_even_where_it_is_a_point() {
    // On 4 deg, as in the paper, it is not told apart from the stiffness of inner axles.
    let procedure = Procedure {
        slope_deg: 8.0,
        ..Procedure::of_the_paper()
    };
    for radius_m in [0.0, 0.15] {
        let mut truth = j8();
        truth.friction.patch_radius_m = radius_m;
        let start = measured(&truth);
        let guess_m = start.contact_vehicle().friction.patch_radius_m;
        let logs = contact_logs_of(&procedure, &truth, 3);
        let (vehicle, report) = identify_contact(&logs, &start, &settings()).unwrap();
        let found = estimate(&report, "patch_radius_m");
        assert!(found.determined, "{found:?}");
        assert_eq!(
            vehicle.contact_vehicle().friction.patch_radius_m,
            found.value
        );
        let (low, high) = found.interval;
        assert!((low..=high).contains(&radius_m), "{found:?}");
        assert!(!(low..=high).contains(&guess_m), "{found:?}");
    }
}

#[test]
fn the_stiffness_of_inner_axles_is_found_on_slopes() {
    let mut truth = j8();
    truth.inner_stiffness = 3.0;
    let [level, ..] = contact_logs(&truth, 3);
    for (logs, determined) in [
        (contact_logs(&truth, 3).to_vec(), true),
        (vec![level], false),
    ] {
        let (vehicle, report) = identify_contact(&logs, &measured(&truth), &settings()).unwrap();
        let found = estimate(&report, "inner_stiffness");
        assert_eq!(found.determined, determined, "{found:?}");
        assert_eq!(vehicle.contact_vehicle().inner_stiffness, found.value);
        let (low, high) = found.interval;
        assert!((low..=high).contains(&3.0), "{found:?}");
        assert!(!determined || low > 1.5, "{found:?}");
    }
}

#[test]
fn level_ground_leaves_the_radius_of_a_patch_at_its_guess() {
    let mut truth = j8();
    truth.friction.patch_radius_m = 0.0;
    let [level, ..] = contact_logs(&truth, 5);
    let (_, report) = identify_contact(&[level], &measured(&truth), &settings()).unwrap();
    let found = estimate(&report, "patch_radius_m");
    assert!(!found.determined, "{found:?}");
    assert_eq!(found.interval.0, 0.0);
    assert!(found.interval.1 > 0.09, "{found:?}");
}

#[test]
fn too_little_is_told() {
    let truth = j8();
    let [level, ..] = contact_logs(&truth, 5);
    let short = DriveLog::new(level.rows()[..400].to_vec()).unwrap();
    let error = identify_contact(&[short], &measured(&truth), &settings()).unwrap_err();
    assert!(
        matches!(error, IdentificationError::TooFewSegments { .. }),
        "{error}"
    );
}
