use super::*;
use crate::test_support::{attitude, motors, slope, vector};
use crate::vehicle::Vehicle;
use proptest::prelude::*;

proptest! {
    #[test]
    fn smoothing_to_zero_gives_the_exact_model_limits_included(
        roll in -0.6..0.6f64, pitch in -0.6..0.6f64, tau in -1.2..1.2f64, sigma in 0.01..1.0f64,
        left in proptest::bool::ANY) {
        let sigma = if left { sigma } else { -sigma };
        let model = PredictionModel::new(Vehicle::j8(), 1e-7);
        let smooth = model.body_velocity(attitude(roll, pitch), motors(tau, sigma)).velocity;
        let exact = Vehicle::j8().body_velocity(attitude(roll, pitch), motors(tau, sigma).into());
        prop_assert!((vector(smooth) - vector(exact)).norm() < 1e-5);
    }

    #[test]
    fn body_jacobians_are_central_differences(
        roll in -0.3..0.3f64, pitch in -0.3..0.3f64, tau in -0.9..0.9f64, sigma in -0.9..0.9f64) {
        prop_assume!((roll.abs() - pitch.abs()).abs() > 1e-3 && roll.abs() > 1e-3 && pitch.abs() > 1e-3);
        // Wide base limits would put kinks everywhere; this vehicle keeps clear of them.
        let mut vehicle = Vehicle::j8();
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
    fn step_jacobians_are_central_differences(
        nx in -0.25..0.25f64, ny in -0.25..0.25f64, yaw in -3.0..3.0f64,
        tau in -0.9..0.9f64, sigma in -0.9..0.9f64) {
        let normal = Vector3::new(nx, ny, 1.0).normalize();
        let model = PredictionModel::new(Vehicle::j8(), 0.05);
        let h_s = 0.15;
        // Away from the kinks in attitude at both evaluations of the midpoint rule.
        for psi in [yaw, yaw + 0.5 * h_s * model.rate_on_plane(&normal, yaw, motors(tau, sigma)).rate.z] {
            let a = Attitude::on_plane(&normal, psi);
            prop_assume!((a.roll_rad.abs() - a.pitch_rad.abs()).abs() > 1e-4);
            prop_assume!(a.roll_rad.abs() > 1e-4 && a.pitch_rad.abs() > 1e-4);
            for side in [1.0, -1.0] {
                let x_l = Vehicle::j8().icrik(a, motors(tau, side).into()).left_m;
                let x_r = Vehicle::j8().icrik(a, motors(tau, side).into()).right_m;
                prop_assume!(x_l < -0.62 && x_r > 0.62);
            }
        }
        let f = |psi: f64, m| model.step_on_plane(&normal, psi, m, h_s).increment;
        let at = model.step_on_plane(&normal, yaw, motors(tau, sigma), h_s);
        let alone = model.increment_on_plane(&normal, yaw, motors(tau, sigma), h_s);
        prop_assert!((alone - at.increment).norm() < 1e-15);
        for (analytic, numeric) in [
            (at.by_yaw, slope(|h| f(yaw + h, motors(tau, sigma)))),
            (at.by_traction, slope(|h| f(yaw, motors(tau + h, sigma)))),
            (at.by_steer, slope(|h| f(yaw, motors(tau, sigma + h)))),
        ] {
            prop_assert!((analytic - numeric).norm() < 1e-6, "{analytic} {numeric}");
        }
    }

    #[test]
    fn rate_on_plane_is_equation_twelve(
        nx in -0.3..0.3f64, ny in -0.3..0.3f64, yaw in -3.0..3.0f64, tau in -0.9..0.9f64, sigma in -0.9..0.9f64) {
        let normal = Vector3::new(nx, ny, 1.0).normalize();
        let model = PredictionModel::new(Vehicle::j8(), 0.05);
        let a = Attitude::on_plane(&normal, yaw);
        let v = model.body_velocity(a, motors(tau, sigma)).velocity;
        let expected = crate::frames::pose_rate(&v, &a, yaw);
        let rate = model.rate_on_plane(&normal, yaw, motors(tau, sigma)).rate;
        prop_assert!((rate - Vector3::new(expected.x_m_s, expected.y_m_s, expected.yaw_rad_s)).norm() < 1e-12);
    }
}

#[test]
fn standing_or_straight_ahead_nothing_slides() {
    let model = PredictionModel::new(Vehicle::j8(), 0.05);
    for tau in [0.0, 0.5] {
        let v = model
            .body_velocity(attitude(0.2, 0.1), motors(tau, 0.0))
            .velocity;
        assert_eq!(v.right_m_s, 0.0);
        assert_eq!(v.yaw_rate_rad_s, 0.0);
        assert!((v.forward_m_s - tau).abs() < 1e-12);
    }
}
