//! Normal loads of the wheels.

use super::vehicle::{ContactVehicle, Wheel};
use crate::frames::Attitude;
use nalgebra::{Matrix3, Vector3};

/// Standard gravity, m/s^2.
pub const GRAVITY_M_S2: f64 = 9.806_65;

/// Returns the weight in body axes at an attitude, N: the bottom row of `world_from_body`, negative.
pub(super) fn weight_in_body(mass_kg: f64, attitude: &Attitude) -> Vector3<f64> {
    let (s_alpha, c_alpha) = attitude.roll_rad.sin_cos();
    let (s_phi, c_phi) = attitude.pitch_rad.sin_cos();
    mass_kg * GRAVITY_M_S2 * Vector3::new(s_alpha, -s_phi * c_alpha, -c_phi * c_alpha)
}

/// Writes the normal load of every wheel, N, and returns whether the vehicle stands on its wheels.
///
/// Tyres and suspension press like springs of stiffness k under a rigid body, on top of what each carries
/// on level ground: `N = share m g + k (c_0 + c_x x + c_y y)`, with the three constants from the balance
/// of vertical force and of both tilting moments of the weight, which acts at the centre of mass.
/// A wheel that would pull is lifted: it carries nothing and the others are balanced without it.
/// False is returned when no set of at least three wheels that are not in line is left, so that the
/// vehicle overturns.
pub(super) fn write_wheel_loads(
    vehicle: &ContactVehicle,
    wheels: &[Wheel],
    weight_in_body: &Vector3<f64>,
    loads_n: &mut [f64],
) -> bool {
    let level_weight_n = vehicle.mass_kg * GRAVITY_M_S2;
    let centre = &vehicle.centre_of_mass;
    let pressing_n = -weight_in_body.z;
    let demand = Vector3::new(
        pressing_n,
        pressing_n * centre.right_m + weight_in_body.x * centre.height_m,
        pressing_n * centre.forward_m + weight_in_body.y * centre.height_m,
    );
    loads_n.fill(1.0);
    // Each pass lifts at least one more wheel or ends.
    for _ in 0..wheels.len() {
        let mut stiffness = Matrix3::zeros();
        let mut missing = demand;
        for (wheel, load) in wheels.iter().zip(loads_n.iter()) {
            if *load > 0.0 {
                let arm = Vector3::new(1.0, wheel.position.x, wheel.position.y);
                stiffness += wheel.stiffness * arm * arm.transpose();
                missing -= arm * (wheel.load_share * level_weight_n);
            }
        }
        let Some(inverse) = inverse_of(&stiffness) else {
            return false;
        };
        let constants = inverse * missing;
        let mut lifted = false;
        for (wheel, load) in wheels.iter().zip(loads_n.iter_mut()) {
            if *load > 0.0 {
                let arm = Vector3::new(1.0, wheel.position.x, wheel.position.y);
                let pressed_n = wheel.stiffness * constants.dot(&arm);
                *load = (wheel.load_share * level_weight_n + pressed_n).max(0.0);
                lifted |= *load <= 0.0;
            }
        }
        if !lifted {
            return true;
        }
    }
    false
}

/// Returns the inverse of a stiffness; none where the wheels on the ground stand in one line, but for
/// rounding.
pub(super) fn inverse_of(stiffness: &Matrix3<f64>) -> Option<Matrix3<f64>> {
    const DETERMINANT_MIN: f64 = 1e-9;
    let diagonal: f64 = stiffness.diagonal().iter().product();
    (stiffness.determinant() > DETERMINANT_MIN * diagonal)
        .then(|| stiffness.try_inverse())
        .flatten()
}

#[cfg(test)]
mod tests {
    use super::super::tests::j8;
    use super::*;
    use proptest::prelude::*;

    fn loads(vehicle: &ContactVehicle, attitude: Attitude) -> (bool, Vec<f64>, Vec<Wheel>) {
        let wheels = vehicle.wheels();
        let mut loads = vec![0.0; wheels.len()];
        let weight = weight_in_body(vehicle.mass_kg, &attitude);
        let stands = write_wheel_loads(vehicle, &wheels, &weight, &mut loads);
        (stands, loads, wheels)
    }

    #[test]
    fn level_axles_carry_their_shares_and_the_centre_of_mass_loads_its_side() {
        let mut vehicle = j8();
        vehicle.centre_of_mass.right_m = 0.0;
        vehicle.centre_of_mass.forward_m = 0.0;
        let (stands, loads_n, wheels) = loads(&vehicle, Attitude::LEVEL);
        assert!(stands);
        for (wheel, load) in wheels.iter().zip(&loads_n) {
            assert!((load - wheel.load_share * vehicle.mass_kg * GRAVITY_M_S2).abs() < 1e-6);
        }
    }

    #[test]
    fn stiff_inner_axles_take_the_weight_that_moves() {
        // What the second axle's right wheel carries more than its left one in a roll to the right.
        let moved_n = |inner_stiffness: f64| {
            let mut vehicle = j8();
            vehicle.inner_stiffness = inner_stiffness;
            vehicle.centre_of_mass.right_m = 0.0;
            let attitude = Attitude {
                roll_rad: 0.1,
                pitch_rad: 0.0,
            };
            let (stands, loads_n, _) = loads(&vehicle, attitude);
            assert!(stands);
            loads_n[5] - loads_n[1]
        };
        let (as_stiff, stiffer) = (moved_n(1.0), moved_n(3.0));
        assert!(as_stiff > 0.0);
        // One of four axles takes 1 / 4 and 3 / 8 of it.
        assert!(
            (stiffer / as_stiff - 1.5).abs() < 0.01,
            "{as_stiff}, {stiffer}"
        );
    }

    #[test]
    fn a_wheel_that_would_pull_is_lifted_and_a_steep_side_overturns() {
        let mut vehicle = j8();
        vehicle.centre_of_mass.height_m = 0.9;
        let steep = |degrees: f64| Attitude {
            roll_rad: degrees.to_radians(),
            pitch_rad: 0.1,
        };
        let (stands, loads_n, _) = loads(&vehicle, steep(25.0));
        assert!(stands && loads_n.contains(&0.0), "{loads_n:?}");
        // The weight leaves the base rectangle at atan(0.6 / 0.9) = 34 deg.
        assert!(!loads(&vehicle, steep(36.0)).0);
    }

    proptest! {
        #[test]
        fn loads_balance_the_weight(roll in -0.3..0.3f64, pitch in -0.4..0.4f64, height in 0.0..1.0f64,
                inner_stiffness in 0.05..20.0f64) {
            let mut vehicle = j8();
            vehicle.inner_stiffness = inner_stiffness;
            vehicle.centre_of_mass.height_m = height;
            let attitude = Attitude { roll_rad: roll, pitch_rad: pitch };
            let (stands, loads_n, wheels) = loads(&vehicle, attitude);
            prop_assert!(stands && loads_n.iter().all(|load| *load >= 0.0));
            let weight = weight_in_body(vehicle.mass_kg, &attitude);
            let centre = Vector3::new(vehicle.centre_of_mass.right_m,
                vehicle.centre_of_mass.forward_m, height);
            // Moment about the centre of mass of normal loads and of friction, which together balance
            // the weight along the ground and act at ground level.
            let mut moment = Vector3::zeros();
            for (wheel, load) in wheels.iter().zip(&loads_n) {
                let arm = Vector3::new(wheel.position.x, wheel.position.y, 0.0) - centre;
                moment += arm.cross(&Vector3::new(0.0, 0.0, *load));
            }
            moment += (-centre).cross(&Vector3::new(-weight.x, -weight.y, 0.0));
            let total: f64 = loads_n.iter().sum();
            prop_assert!((total + weight.z).abs() < 1e-6);
            prop_assert!(moment.xy().norm() < 1e-6, "{}", moment);
        }
    }
}
