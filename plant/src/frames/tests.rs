use super::*;
use proptest::prelude::*;
use std::f64::consts::FRAC_PI_2;

fn close(a: f64, b: f64) {
    assert!((a - b).abs() < 1e-9, "{a} != {b}");
}

#[test]
fn level_ground_keeps_roll_and_turns_pitch_around_when_only_one_is_set() {
    let ros = RosAttitude::from_paper(
        &Attitude {
            roll_rad: 0.1,
            pitch_rad: 0.0,
        },
        0.0,
    );
    close(ros.roll_rad, 0.1);
    close(ros.yaw_rad, FRAC_PI_2);
    let ros = RosAttitude::from_paper(
        &Attitude {
            roll_rad: 0.0,
            pitch_rad: 0.2,
        },
        0.3,
    );
    close(ros.pitch_rad, -0.2);
    close(ros.yaw_rad, 0.3 + FRAC_PI_2);
}

#[test]
fn swapping_signs_is_wrong_when_both_angles_are_set() {
    let attitude = Attitude {
        roll_rad: 0.3,
        pitch_rad: 0.3,
    };
    let ros = RosAttitude::from_paper(&attitude, 0.0);
    assert!((ros.roll_rad - 0.3).abs() > 0.01 || (ros.yaw_rad - FRAC_PI_2).abs() > 0.01);
}

#[test]
fn attitude_on_a_plane_meets_equation_one_for_small_slopes() {
    let slope = 1e-3_f64;
    let normal = Vector3::new(0.0, -slope.sin(), slope.cos());
    for i in 0..12 {
        let yaw = f64::from(i) * 0.5;
        let exact = Attitude::on_plane(&normal, yaw);
        let small = Attitude::from_slope(slope, yaw);
        assert!((exact.roll_rad - small.roll_rad).abs() < 1e-8);
        assert!((exact.pitch_rad - small.pitch_rad).abs() < 1e-8);
    }
}

proptest! {
    #[test]
    fn paper_to_ros_and_back(roll in -1.2..1.2f64, pitch in -1.2..1.2f64, yaw in -3.1..3.1f64) {
        let attitude = Attitude { roll_rad: roll, pitch_rad: pitch };
        let (back, yaw_back) = RosAttitude::from_paper(&attitude, yaw).to_paper();
        prop_assert!((back.roll_rad - roll).abs() < 1e-9);
        prop_assert!((back.pitch_rad - pitch).abs() < 1e-9);
        prop_assert!(wrap_angle(yaw_back - yaw).abs() < 1e-9);
    }

    #[test]
    fn forward_is_the_ros_x_axis(roll in -1.0..1.0f64, pitch in -1.0..1.0f64, yaw in -3.1..3.1f64) {
        let attitude = Attitude { roll_rad: roll, pitch_rad: pitch };
        let forward = attitude.world_from_body(yaw) * Vector3::y();
        let x_ros = ros_quaternion(&attitude, yaw) * Vector3::x();
        prop_assert!((forward - x_ros).norm() < 1e-12);
    }

    #[test]
    fn pose_rate_is_the_rotated_velocity(roll in -1.0..1.0f64, pitch in -1.0..1.0f64,
                                         yaw in -3.1..3.1f64, v_x in -1.0..1.0f64, v_y in -1.0..1.0f64) {
        let attitude = Attitude { roll_rad: roll, pitch_rad: pitch };
        let v = BodyVelocity { right_m_s: v_x, forward_m_s: v_y, yaw_rate_rad_s: 0.0 };
        let rate = pose_rate(&v, &attitude, yaw);
        let expected = attitude.world_from_body(yaw) * Vector3::new(v_x, v_y, 0.0);
        prop_assert!((Vector3::new(rate.x_m_s, rate.y_m_s, rate.z_m_s) - expected).norm() < 1e-12);
    }

    #[test]
    fn a_plane_gives_its_attitude_and_back(nx in -0.5..0.5f64, ny in -0.5..0.5f64, yaw in -3.1..3.1f64) {
        let normal = Vector3::new(nx, ny, 1.0).normalize();
        let back = Attitude::on_plane(&normal, yaw).plane_normal(yaw);
        prop_assert!((normal - back).norm() < 1e-12);
    }

    #[test]
    fn wrapping_keeps_the_direction(angle in -100.0..100.0f64) {
        let w = wrap_angle(angle);
        prop_assert!(w > -PI && w <= PI);
        prop_assert!((w.sin() - angle.sin()).abs() < 1e-9 && (w.cos() - angle.cos()).abs() < 1e-9);
    }
}
