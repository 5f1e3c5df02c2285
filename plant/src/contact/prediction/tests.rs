#![allow(clippy::unwrap_used)]

mod following;

use super::super::tests::j8;
use super::super::{Axle, ContactModel, PARAMETERS};
use super::search::SPEED_MAX;
use super::*;
use crate::frames::PlanarPose;
use crate::motion::{GroundState, MotionModel};
use crate::test_support::{attitude, motors, vector};
use proptest::prelude::*;

/// A vehicle of `axles` axles whose parameters are off the J8's by shares of their usual doubt.
fn vehicle(axles: usize, off: &[f64; PARAMETERS]) -> ContactVehicle {
    let mut vehicle = j8();
    let count = axles as f64;
    vehicle.axles = (0..axles)
        .map(|k| Axle {
            forward_m: 1.06 - 2.12 * k as f64 / (count - 1.0),
            load_share: 1.0 / count,
        })
        .collect();
    let doubt = [
        0.3, 0.1, 0.15, 0.1, 0.15, 1.0, 0.2, 0.5, 0.02, 0.007, 0.0, 0.0, 0.0, 0.0,
    ];
    let mut parameters = vehicle.parameters();
    for i in 0..PARAMETERS {
        parameters[i] += off[i] * doubt[i];
    }
    vehicle.with_parameters(&parameters)
}

fn offsets() -> impl Strategy<Value = [f64; PARAMETERS]> {
    prop::array::uniform14(-0.9..0.9f64)
}

/// Checks a Jacobian: every column against the central difference of `f` along it.
fn check_jacobian<const N: usize>(
    name: &str,
    columns: [Vector3<f64>; N],
    f: impl Fn([f64; N]) -> Vector3<f64>,
) -> Result<(), TestCaseError> {
    let h = 1e-6;
    for (i, column) in columns.iter().enumerate() {
        let at = |offset: f64| {
            let mut z = [0.0; N];
            z[i] = offset;
            f(z)
        };
        let difference = (at(h) - at(-h)) / (2.0 * h);
        prop_assert!(
            (difference - column).norm() < 2e-4 * (1.0 + column.norm()),
            "{name}, {i}: {column} is not {difference}"
        );
    }
    Ok(())
}

proptest! {
    #[test]
    fn it_is_the_plants_balance(axles in 2..9_usize, off in offsets(),
            roll in -0.25..0.25f64, pitch in -0.25..0.25f64, tau in -0.8..0.8f64, sigma in -0.8..0.8f64) {
        let vehicle = vehicle(axles, &off);
        let mut model = ContactPrediction::new(&vehicle).unwrap();
        let found = model.predict(attitude(roll, pitch), motors(tau, sigma));
        let ground = GroundState { position: PlanarPose::default(), attitude: attitude(roll, pitch) };
        match ContactModel::new(vehicle).body_velocity(&ground, motors(tau, sigma).into(), 0.0) {
            Ok(exact) => {
                prop_assert!(found.holds);
                let off = vector(found.linearised.velocity) - vector(exact);
                prop_assert!(off.norm() < 1e-8, "{off}");
            }
            Err(_) => prop_assert!(!found.holds),
        }
    }

    #[test]
    fn jacobians_are_central_differences(axles in 2..9_usize, off in offsets(),
            roll in -0.2..0.2f64, pitch in -0.2..0.2f64, tau in -0.8..0.8f64, sigma in -0.8..0.8f64) {
        let vehicle = vehicle(axles, &off);
        let mut model = ContactPrediction::new(&vehicle).unwrap();
        let mut parameters = *model.parameters();
        parameters[Parameter::LeftTread.index()] = 0.3 * off[Parameter::LeftTread.index()];
        parameters[Parameter::RightTread.index()] = 0.3 * off[Parameter::RightTread.index()];
        model.set_parameters(&parameters);
        let found = model.clone().predict(attitude(roll, pitch), motors(tau, sigma));
        prop_assume!(found.holds);
        // A wheel that lifts or lands between the points of a difference has two derivatives.
        let loads = Loads::of(&model.geometry, &model.ground, &LoadCase::at(&attitude(roll, pitch).into()));
        prop_assume!(loads.of_wheel[..2 * axles].iter().all(|load| *load > 1e-4));
        let by = &found.linearised;
        check_jacobian("input", [by.by_roll, by.by_pitch, by.by_traction, by.by_steer], |[a, p, t, s]| {
            let found = model.clone().body_velocity(attitude(roll + a, pitch + p), motors(tau + t, sigma + s));
            vector(found.velocity)
        })?;
        let columns: [Vector3<f64>; PARAMETERS] = std::array::from_fn(|i| found.by_parameters.column(i).into());
        check_jacobian("parameter", columns, |offset| {
            let mut moved = model.clone();
            moved.set_parameters(&(model.parameters + ParameterVector::from(offset)));
            vector(moved.body_velocity(attitude(roll, pitch), motors(tau, sigma)).velocity)
        })?;
    }

    #[test]
    fn derivatives_of_what_is_left_are_central_differences(axles in 2..9_usize, off in offsets(),
            roll in -0.2..0.2f64, pitch in -0.2..0.2f64, tau in -0.5..0.5f64, sigma in -0.5..0.5f64,
            inertia in 0.1..2.0f64, length_m in 0.01..0.5f64, time_s in 0.001..0.3f64,
            velocity in prop::array::uniform3(-0.5..0.5f64), force in prop::array::uniform3(-0.5..0.5f64)) {
        let vehicle = vehicle(axles, &off);
        let of = |inertia: f64, length_m: f64| {
            let mut vehicle = vehicle.clone();
            vehicle.set_inertia(inertia);
            vehicle.friction.relaxation_length_m = length_m;
            let predicted = ContactPrediction::new(&vehicle).unwrap().predict(attitude(roll, pitch), motors(tau, sigma));
            (predicted.lag.over(time_s), vector(predicted.linearised.velocity))
        };
        let before = BodyState { velocity: Vector3::from(velocity), force: Vector3::from(force) };
        let (following, settled) = of(inertia, length_m);
        let h = 1e-5;
        let length = Parameter::RelaxationLength;
        let of_entry = |by: f64| of(inertia, length.value(length.entry(length_m) + by));
        let sides = [
            (of(inertia + h, length_m), of(inertia - h, length_m)),
            (of_entry(h), of_entry(-h)),
        ];
        for (by, (up, down)) in following.by_lag(&before, &settled, &following.from(&before, &settled).end).into_iter().zip(sides) {
            let (up, down) = (up.0.from(&before, &up.1), down.0.from(&before, &down.1));
            for (by, difference) in [
                (by.mean, up.mean - down.mean),
                (by.end.velocity, up.end.velocity - down.end.velocity),
                (by.end.force, up.end.force - down.end.force),
            ] {
                let difference = difference / (2.0 * h);
                prop_assert!((difference - by).norm() < 1e-4 * (1.0 + by.norm()), "{by}, {difference}");
            }
        }
    }

    /// Down to the point, where a difference can only lead to larger patches.
    #[test]
    fn a_patch_may_be_as_small_as_a_point(axles in 2..9_usize, off in offsets(), radius_m in prop_oneof![Just(0.0), 0.0..0.03f64],
            roll in -0.2..0.2f64, pitch in -0.2..0.2f64, tau in -0.8..0.8f64, sigma in -0.8..0.8f64) {
        let mut vehicle = vehicle(axles, &off);
        vehicle.friction.patch_radius_m = radius_m;
        let model = ContactPrediction::new(&vehicle).unwrap();
        let found = model.clone().predict(attitude(roll, pitch), motors(tau, sigma));
        prop_assume!(found.holds);
        let ground = GroundState { position: PlanarPose::default(), attitude: attitude(roll, pitch) };
        let exact = ContactModel::new(vehicle).body_velocity(&ground, motors(tau, sigma).into(), 0.0).unwrap();
        let velocity = vector(found.linearised.velocity);
        prop_assert!((velocity - vector(exact)).norm() < 1e-8);
        let h = 2e-6;
        let ahead = |step: f64| {
            let mut parameters = model.parameters;
            parameters[Parameter::PatchRadius.index()] += step;
            let mut larger = model.clone();
            larger.set_parameters(&parameters);
            vector(larger.body_velocity(attitude(roll, pitch), motors(tau, sigma)).velocity)
        };
        let difference = (4.0 * ahead(h) - ahead(2.0 * h) - 3.0 * velocity) / (2.0 * h);
        let column: Vector3<f64> = found.by_parameters.column(Parameter::PatchRadius.index()).into();
        prop_assert!((difference - column).norm() < 2e-3 * (1.0 + column.norm()), "{column} is not {difference}");
        prop_assert!(found.by_parameters.iter().all(|d| d.is_finite()), "{found:?}");
    }

    #[test]
    fn the_start_of_the_search_is_nothing_to_its_end(axles in 2..9_usize, off in prop::array::uniform14(-3.0..3.0f64), roll in -0.3..0.3f64, pitch in -0.3..0.3f64,
            tau in -0.8..0.8f64, sigma in -0.8..0.8f64, before in prop::array::uniform4(-1.0..1.0f64)) {
        let mut fresh = ContactPrediction::new(&vehicle(axles, &[0.0; PARAMETERS])).unwrap();
        fresh.set_parameters(&(fresh.parameters + ParameterVector::from(off.map(|o| 0.3 * o))));
        let mut used = fresh.clone();
        used.body_velocity(attitude(0.3 * before[0], 0.3 * before[1]), motors(before[2], before[3]));
        let a = fresh.predict(attitude(roll, pitch), motors(tau, sigma));
        let b = used.predict(attitude(roll, pitch), motors(tau, sigma));
        prop_assert_eq!(a.holds, b.holds);
        let off = vector(a.linearised.velocity) - vector(b.linearised.velocity);
        // Where friction hardly holds, what rounding does to the forces moves the balance.
        let found = vector(a.linearised.velocity);
        let tilt = attitude(roll, pitch).into();
        let (_, solution, _) = fresh.balance(found, &fresh.loads(&tilt), tilt, motors(tau, sigma));
        prop_assert!(off.norm() < 1e-8 + 1e-14 * solution.inverse_hessian.norm(), "{off}");
        // So it is for a roll-out, but for what it needs no more.
        let mut near = None;
        used.body_velocity_near(&mut near, attitude(roll + 0.01, pitch), motors(tau, sigma + 0.02));
        let alone = fresh.velocity_near(near.as_ref(), attitude(roll, pitch), motors(tau, sigma));
        let off = vector(alone) - found;
        prop_assert!(off.norm() < 1e-6 * (1.0 + solution.inverse_hessian.norm()), "{off}");
    }

    #[test]
    fn everything_has_a_finite_answer(axles in 2..17_usize, off in prop::array::uniform14(-40.0..40.0f64),
            roll in -1.5..1.5f64, pitch in -1.5..1.5f64, tau in -2.0..2.0f64, sigma in -2.0..2.0f64) {
        let vehicle = vehicle(axles, &[0.0; PARAMETERS]);
        let mut model = ContactPrediction::new(&vehicle).unwrap();
        model.set_parameters(&(model.parameters + ParameterVector::from(off)));
        let found = model.predict(attitude(roll, pitch), motors(tau, sigma));
        let l = &found.linearised;
        prop_assert!(vector(l.velocity).norm() <= SPEED_MAX);
        let all = [l.by_roll, l.by_pitch, l.by_traction, l.by_steer];
        prop_assert!(all.iter().flatten().chain(&found.by_parameters).all(|d| d.is_finite()), "{found:?}");
    }
}

#[test]
fn ground_that_does_not_hold_is_told_and_slid_on_downhill() {
    let mut vehicle = j8();
    vehicle.centre_of_mass.height_m = 0.1;
    let mut model = ContactPrediction::new(&vehicle).unwrap();
    for slope in [0.7_f64, 0.9] {
        // Across the slope, right side down.
        let found = model.predict(attitude(slope, 0.0), motors(0.4, 0.1));
        assert_eq!(found.holds, slope.tan() < 0.9);
        assert!(found.linearised.velocity.right_m_s > 0.0, "{found:?}");
    }
}

#[test]
fn learned_friction_holds_the_vehicle_where_it_stands() {
    let mut model = ContactPrediction::new(&vehicle(4, &[0.0; PARAMETERS])).unwrap();
    let friction = Parameter::Friction.index();
    for lateral_share in [0.6, 1.4] {
        let mut parameters = *model.parameters();
        parameters[friction] = Parameter::Friction.entry(0.2);
        parameters[Parameter::LateralShare.index()] = Parameter::LateralShare.entry(lateral_share);
        for (roll, pitch) in [(0.24, 0.0), (0.0, -0.24), (0.17, 0.17)] {
            let attitude = attitude(roll, pitch);
            model.set_parameters(&parameters);
            assert!(lateral_share > 1.0 || !model.predict(attitude, motors(0.4, 0.0)).holds);
            model.set_parameters(&model.holding(&parameters, &attitude));
            assert!(model.predict(attitude, motors(0.4, 0.0)).holds);
        }
        // What holds is left as it is.
        parameters[friction] = Parameter::Friction.entry(0.8);
        let held = model.holding(&parameters, &attitude(0.24, 0.0));
        assert_eq!(held, parameters);
    }
}

#[test]
fn parameters_come_back_from_a_vehicle() {
    let vehicle = vehicle(
        4,
        &[
            0.5, 0.2, -0.3, 0.4, 0.6, 0.3, -0.7, 0.8, 0.9, -0.4, 0.0, 0.0, 0.0, 0.0,
        ],
    );
    let again = j8().with_parameters(&vehicle.parameters());
    assert!((again.parameters() - vehicle.parameters()).norm() < 1e-12);
    let shares: f64 = again.axles.iter().map(|axle| axle.load_share).sum();
    assert!((shares - 1.0).abs() < 1e-12);
}

#[test]
fn the_entry_of_a_patch_is_the_square_of_its_radius() {
    let patch = Parameter::PatchRadius;
    assert_eq!(patch.entry(0.09), 0.09 * 0.09);
    for radius_m in [0.0, 1e-9, 0.004, 0.09, 0.5] {
        let again = patch.value(patch.entry(radius_m));
        assert!((again - radius_m).abs() < 1e-12, "{again}");
        let mut vehicle = j8();
        vehicle.friction.patch_radius_m = radius_m;
        let again = j8().with_parameters(&vehicle.parameters());
        assert!((again.friction.patch_radius_m - radius_m).abs() < 1e-12);
    }
    // A filter may leave the range: no patch is smaller than a point, or longer than the vehicle is wide.
    let mut model = ContactPrediction::new(&j8()).unwrap();
    for (entry, radius_m) in [(-0.01, 0.0), (f64::NAN, 0.0), (0.0, 0.0), (1.0, 0.3)] {
        assert!(entry >= 0.0 || patch.value(entry) == 0.0);
        let mut parameters = *model.parameters();
        parameters[patch.index()] = entry;
        model.set_parameters(&parameters);
        let kept = patch.value(model.parameters()[patch.index()]);
        assert!((kept - radius_m).abs() < 1e-12, "{entry}: {kept}");
        let found = model.predict(attitude(0.1, 0.1), motors(0.3, 0.3));
        assert!(found.holds && found.by_parameters.iter().all(|d| d.is_finite()));
    }
}

#[test]
fn nothing_is_left_to_the_inner_axles_where_there_are_none() {
    let mut model = ContactPrediction::new(&vehicle(2, &[0.0; PARAMETERS])).unwrap();
    let found = model.predict(attitude(0.1, 0.1), motors(0.3, 0.3));
    for parameter in [Parameter::InnerShare, Parameter::InnerStiffness] {
        assert_eq!(found.by_parameters.column(parameter.index()).norm(), 0.0);
    }
}

/// A vehicle whose search for the balance went round in circles, and one that overturns until the wheels
/// left on the ground stand in a line.
#[test]
fn no_search_goes_round_in_circles_and_no_load_is_that_of_rounding() {
    let standard = ContactPrediction::new(&vehicle(4, &[0.0; PARAMETERS])).unwrap();
    let mut circling = standard.clone();
    let off = [
        0.24, 0.46, -0.82, 0.2, -0.59, 0.0, -0.22, -0.77, 0.19, 0.0, 0.0, 0.0, 0.0, 0.0,
    ];
    circling.set_parameters(&(standard.parameters + ParameterVector::from(off)));
    circling.body_velocity(Attitude::default(), MotorSpeeds::default());
    let found = circling.predict(attitude(-0.1156, 0.0166), motors(-0.2275, -0.761));
    assert!(found.holds, "{found:?}");
    let mut overturning = standard.clone();
    let parameters = [
        -0.6226, 0.3, -0.0836, 1.0667, 0.02, 0.0, -0.462, -3.276, 0.3, 0.0081, 0.0, 0.0, 0.0, 0.0,
    ];
    overturning.set_parameters(&parameters.into());
    let stance = LoadCase::at(&attitude(0.296, -0.1613).into());
    let loads = Loads::of(&overturning.geometry, &overturning.ground, &stance);
    assert!(!loads.stands);
    assert!(loads.of_wheel.iter().sum::<f64>() <= 1.0, "{loads:?}");
}

#[test]
fn treads_that_slip_move_as_slower_treads_do() {
    let standard = ContactPrediction::new(&vehicle(4, &[0.0; PARAMETERS])).unwrap();
    let mut slipping = standard.clone();
    let mut parameters = *standard.parameters();
    parameters[Parameter::LeftTread.index()] = Parameter::LeftTread.entry(0.7);
    parameters[Parameter::RightTread.index()] = Parameter::RightTread.entry(0.8);
    slipping.set_parameters(&parameters);
    let commanded = TreadSpeeds {
        left_m_s: 0.3,
        right_m_s: 0.5,
    };
    let effective = TreadSpeeds {
        left_m_s: 0.7 * 0.3,
        right_m_s: 0.8 * 0.5,
    };
    let found = slipping.predict(attitude(0.1, -0.05), commanded.into());
    let expected = standard
        .clone()
        .predict(attitude(0.1, -0.05), effective.into());
    let off = vector(found.linearised.velocity) - vector(expected.linearised.velocity);
    assert!(off.norm() < 1e-8, "{off}");
}
