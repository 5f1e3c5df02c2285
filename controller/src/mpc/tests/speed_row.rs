//! Errors of a state, and the linearised speed along the path.

use super::closed_loop::{mpc, settings};
use super::*;

fn target(
    tracked_point: TrackedPoint,
    along_rad: f64,
    normal_in_world: Vector3<f64>,
) -> StageTarget {
    StageTarget {
        pose: PlanarPose::default(),
        tracked_point,
        along_heading_rad: along_rad,
        curvature_per_m: 0.0,
        normal_in_world,
        feedforward: MotorSpeeds::STOP,
        speed_m_s: 0.3,
        slip: Vector3::zeros(),
        weights: StageWeights {
            along_per_m2: 0.0,
            cross_per_m2: 0.0,
            heading_per_rad2: 0.0,
            speed_s2_per_m2: 1.0,
        },
        errors_share: 1.0,
    }
}

proptest! {
    /// Against differences of the model's own steps, also of a tracked point off the origin.
    #[test]
    fn the_speed_row_is_the_derivative_of_the_speed(
        yaw_rad in -3.0..3.0_f64,
        along_rad in -3.0..3.0_f64,
        (traction_m_s, steer_m_s) in (-1.0..1.0_f64, -0.8..0.8_f64),
        (slope_x, slope_y) in (-0.3..0.3_f64, -0.3..0.3_f64),
        (right_m, forward_m) in (-0.5..0.5_f64, -0.8..0.8_f64),
        step_s in 0.05..0.6_f64,
    ) {
        let normal_in_world = Vector3::new(-slope_x, -slope_y, 1.0).normalize();
        let target = target(TrackedPoint { right_m, forward_m }, along_rad, normal_in_world);
        let along = target.along();
        let mut model = mpc(settings(2)).model;
        let step = model.step_on_plane(
            &normal_in_world,
            yaw_rad,
            motors(traction_m_s, steer_m_s),
            step_s,
        );
        let mut speed_error = |at: [f64; 3]| {
            let from = Vector3::new(0.2, -0.4, at[0]);
            let input = motors(at[1], at[2]);
            let step = model.step_on_plane(&normal_in_world, at[0], input, step_s);
            target.speed_error(along, &from, &(from + step.increment), step_s)
        };
        let at = [yaw_rad, traction_m_s, steer_m_s];
        let from = Vector3::new(0.2, -0.4, yaw_rad);
        let row = target.speed_row(along, &from, &(from + step.increment), &step, step_s);
        for (i, derivative) in row.into_iter().enumerate() {
            let mut moved = |by: f64| {
                let mut moved = at;
                moved[i] += by;
                speed_error(moved)
            };
            // The model has kinks: there the slopes to both sides differ.
            let here = moved(0.0);
            let slopes = [(here - moved(-1e-5)) / 1e-5, (moved(1e-5) - here) / 1e-5];
            let [low, high] = [slopes[0].min(slopes[1]) - 1e-4, slopes[0].max(slopes[1]) + 1e-4];
            prop_assert!((low..high).contains(&derivative), "{}: {} {:?}", i, derivative, slopes);
        }
    }

    /// Of a tracked point off the origin, whose place the pose of the vehicle tells.
    #[test]
    fn errors_are_those_of_the_tracked_point(
        (x_m, y_m, yaw_rad) in (-2.0..2.0_f64, -2.0..2.0_f64, -3.0..3.0_f64),
        along_rad in -3.0..3.0_f64,
        (slope_x, slope_y) in (-0.3..0.3_f64, -0.3..0.3_f64),
        (right_m, forward_m) in (-0.5..0.5_f64, -0.8..0.8_f64),
        curvature_per_m in -1.0..1.0_f64,
        turns in -2..3_i32,
    ) {
        let normal_in_world = Vector3::new(-slope_x, -slope_y, 1.0).normalize();
        let tracked_point = TrackedPoint { right_m, forward_m };
        let mut target = target(tracked_point, along_rad, normal_in_world);
        target.pose = PlanarPose { x_m: 0.7, y_m: -0.3, yaw_rad: 0.9 };
        target.curvature_per_m = curvature_per_m;
        let place = |state: &Vector3<f64>| {
            let pose = PlanarPose { x_m: state.x, y_m: state.y, yaw_rad: state.z };
            tracked_point.of(&pose, &normal_in_world)
        };
        let (sin, cos) = along_rad.sin_cos();
        let state = Vector3::new(x_m, y_m, yaw_rad + f64::from(turns) * std::f64::consts::TAU);
        let found = target.error_of(target.along(), &state);
        let point = place(&state);
        let (x, y) = (point.x_m - 0.7, point.y_m + 0.3);
        let yaw = wrap_angle(yaw_rad - 0.9) - curvature_per_m * (cos * y - sin * x);
        prop_assert!((found.state - Vector3::new(x, y, yaw)).norm() < 1e-9, "{}", found.state);
        let moved = place(&(state + Vector3::new(0.0, 0.0, 1e-6)));
        let (by_x, by_y) = ((moved.x_m - point.x_m) / 1e-6, (moved.y_m - point.y_m) / 1e-6);
        let (own_x, own_y) = found.point_by_yaw_m;
        prop_assert!((own_x - by_x).abs() < 1e-5 && (own_y - by_y).abs() < 1e-5);

        let to = state + Vector3::new(0.2, -0.1, 0.3);
        let next = place(&to);
        let along_m_s = (cos * (next.y_m - point.y_m) - sin * (next.x_m - point.x_m)) / 0.4;
        let found = target.speed_error(target.along(), &state, &to, 0.4);
        prop_assert!((found - (along_m_s - 0.3)).abs() < 1e-9, "{} {}", found, along_m_s);
    }
}
