//! The linearised speed along the path.

use super::closed_loop::{mpc, settings};
use super::*;

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
        let target = StageTarget {
            pose: PlanarPose::default(),
            tracked_point: TrackedPoint { right_m, forward_m },
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
            }, errors_share: 1.0,
        };
        let along = target.along();
        let mut model = mpc(settings(2, 1)).model;
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
}
