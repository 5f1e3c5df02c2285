//! Where a vehicle slides to while it pivots on a slope.

use sidehill_plant::frames::{Attitude, PlanarPose};
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::vehicle::Vehicle;

/// Largest step of the integration, rad.
const STEP_RAD: f64 = 0.05;

/// Returns the distance by which the slope displaces a vehicle during a pivot by `angle_rad` at the yaw rate
/// `rate_rad_s`, m: that of the last of the [`pivot_poses`] from the first.
pub(crate) fn pivot_slide_m(
    vehicle: &Vehicle,
    attitude: Attitude,
    yaw_rad: f64,
    angle_rad: f64,
    rate_rad_s: f64,
) -> f64 {
    let from = PlanarPose {
        yaw_rad,
        ..PlanarPose::default()
    };
    let poses = pivot_poses(vehicle, attitude, from, angle_rad, rate_rad_s);
    poses.last().map_or(0.0, |pose| pose.x_m.hypot(pose.y_m))
}

/// Returns the poses of a vehicle during a pivot by `angle_rad` on a slope, from beginning to end, by the ICRIK
/// model: the part of the motion across the vehicle, which no tread speed can take back.
///
/// With the yaw rate omega the vehicle moves sideways at y_ICR omega. On a slope y_ICR is not that of level
/// ground, so over the pivot the vehicle is displaced by the integral of (y_ICR(attitude) - y_ICR(level))
/// along its right axis, which turns. `attitude` is that at the first pose on a plane, `rate_rad_s` the yaw
/// rate.
pub(crate) fn pivot_poses(
    vehicle: &Vehicle,
    attitude: Attitude,
    from: PlanarPose,
    angle_rad: f64,
    rate_rad_s: f64,
) -> Vec<PlanarPose> {
    let normal_in_world = attitude.plane_normal(from.yaw_rad);
    let level = vehicle.icrhk();
    let yaw_rate = rate_rad_s.abs().copysign(angle_rad);
    // About the origin, so that the treads alone make no forward motion.
    let treads = TreadSpeeds {
        left_m_s: yaw_rate * level.left_m,
        right_m_s: yaw_rate * level.right_m,
    };
    let steps = (angle_rad.abs() / STEP_RAD).ceil().max(1.0);
    let step_rad = angle_rad / steps;
    let mut poses = vec![from];
    let mut pose = from;
    for step in 0..steps as u32 {
        let heading_rad = from.yaw_rad + (f64::from(step) + 0.5) * step_rad;
        let attitude = Attitude::on_plane(&normal_in_world, heading_rad);
        let sideways_m = vehicle.icrik(attitude, treads).forward_m - level.forward_m;
        let (sin, cos) = heading_rad.sin_cos();
        pose = PlanarPose {
            x_m: pose.x_m + cos * sideways_m * step_rad,
            y_m: pose.y_m + sin * sideways_m * step_rad,
            yaw_rad: pose.yaw_rad + step_rad,
        };
        poses.push(pose);
    }
    poses
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::test_data::j8;
    use std::f64::consts::{FRAC_PI_2, PI};

    fn slide_m(vehicle: &Vehicle, slope_deg: f64, angle_rad: f64) -> f64 {
        let attitude = Attitude::from_slope(f64::to_radians(slope_deg), 0.0);
        pivot_slide_m(vehicle, attitude, 0.0, angle_rad, 0.3)
    }

    #[test]
    fn only_a_slope_displaces_and_more_the_steeper_it_is() {
        let j8 = j8();
        assert!(slide_m(&j8, 0.0, PI) < 1e-12);
        assert_eq!(slide_m(&j8.on_level_ground(), 10.0, PI), 0.0);
        let [gentle, steep] = [5.0, 10.0].map(|slope_deg| slide_m(&j8, slope_deg, PI));
        assert!(gentle > 0.1 && steep > 1.8 * gentle, "{gentle} {steep}");
    }

    /// Half a turn, with the roll beta sin(gamma) and g = v_y^m - |V_r + V_l|/2: the integral of
    /// lambda_1 g beta sin^2 is pi/2 lambda_1 g beta, downhill.
    #[test]
    fn half_a_turn_displaces_as_the_integral_says() {
        let j8 = j8();
        let slope_rad = 5.0_f64.to_radians();
        let g = j8.speed_max_m_s - 0.5 * 0.3 * (j8.icrs.right_m + j8.icrs.left_m).abs();
        let expected_m = FRAC_PI_2 * j8.slide.shift_s_per_rad * g * slope_rad;
        let found_m = slide_m(&j8, 5.0, PI);
        assert!(
            (found_m - expected_m).abs() < 0.01,
            "{found_m} {expected_m}"
        );
    }

    #[test]
    fn both_directions_displace_alike() {
        let j8 = j8();
        let [left, right] = [1.0, -1.0].map(|sign| slide_m(&j8, 8.0, sign * 2.5));
        assert!((left - right).abs() < 1e-9, "{left} {right}");
    }
}
