use super::*;
use proptest::prelude::*;
use sidehill_plant::frames::{pose_rate, wrap_angle};
use std::f64::consts::FRAC_PI_2;

prop_compose! {
    fn standing()(x in -1e3..1e3f64, y in -1e3..1e3f64, z in -50.0..50.0f64, yaw in -3.1..3.1f64,
                  roll in -1.2..1.2f64, pitch in -1.2..1.2f64) -> (Pose, Attitude) {
        (Pose { x_m: x, y_m: y, z_m: z, yaw_rad: yaw }, Attitude { roll_rad: roll, pitch_rad: pitch })
    }
}

proptest! {
    #[test]
    fn a_pose_survives_the_message((pose, attitude) in standing()) {
        let message = to_pose(&world_from_base_link(&pose, &attitude));
        let (back, attitude_back) = pose_and_attitude(&from_pose(&message).unwrap());
        prop_assert!((back.x_m - pose.x_m).abs() < 1e-9 && (back.y_m - pose.y_m).abs() < 1e-9);
        prop_assert!((back.z_m - pose.z_m).abs() < 1e-9);
        prop_assert!(wrap_angle(back.yaw_rad - pose.yaw_rad).abs() < 1e-9);
        prop_assert!((attitude_back.roll_rad - attitude.roll_rad).abs() < 1e-9);
        prop_assert!((attitude_back.pitch_rad - attitude.pitch_rad).abs() < 1e-9);
    }

    #[test]
    fn a_transform_survives_the_message((pose, attitude) in standing()) {
        let isometry = world_from_base_link(&pose, &attitude);
        let back = from_transform(&to_transform(&isometry)).unwrap();
        prop_assert!((back.to_homogeneous() - isometry.to_homogeneous()).norm() < 1e-9);
    }

    /// A twist in base_link, turned into the world by the pose's rotation, is the rate of the pose.
    #[test]
    fn a_twist_moves_the_pose_as_equation_12((pose, attitude) in standing(),
                                             right in -1.0..1.0f64, forward in -1.0..1.0f64) {
        let velocity = BodyVelocity { right_m_s: right, forward_m_s: forward, yaw_rate_rad_s: 0.0 };
        let twist = to_twist(&velocity);
        let in_world = world_from_base_link(&pose, &attitude)
            * Vector3::new(twist.linear.x, twist.linear.y, twist.linear.z);
        let rate = pose_rate(&velocity, &attitude, pose.yaw_rad);
        let expected = Vector3::new(rate.x_m_s, rate.y_m_s, rate.z_m_s);
        prop_assert!((in_world - expected).norm() < 1e-9);
        prop_assert_eq!(from_twist(&twist).unwrap(), velocity);
    }

    #[test]
    fn a_twist_commands_both_treads(traction in -2.0..2.0f64, steer in -2.0..2.0f64, width in 0.1..5.0f64) {
        let mapping = TwistMapping { track_width_m: width };
        let motors = MeasuredMotorSpeeds { traction_m_s: traction, steer_m_s: steer };
        let back = mapping.motors(&mapping.twist(motors)).unwrap();
        prop_assert!((back.traction_m_s - traction).abs() < 1e-12);
        prop_assert!((back.steer_m_s - steer).abs() < 1e-12);
    }

    #[test]
    fn joints_carry_both_treads(left in -2.0..2.0f64, right in -2.0..2.0f64, radius in 0.05..1.0f64) {
        let joints = TreadJoints { radius_m: radius, ..TreadJoints::default() };
        let treads = MeasuredTreadSpeeds { left_m_s: left, right_m_s: right };
        let mut state = joints.joint_state(Header::default(), treads, [0.0; 2]);
        state.name.reverse();
        state.velocity.reverse();
        for back in [joints.treads(&state).unwrap(), joints.commanded(&joints.command(treads)).unwrap()] {
            prop_assert!((back.left_m_s - left).abs() < 1e-12);
            prop_assert!((back.right_m_s - right).abs() < 1e-12);
        }
    }

    #[test]
    fn stamps_survive(time_ns in (i64::from(i32::MIN) * NANOS)..(i64::from(i32::MAX) * NANOS)) {
        prop_assert_eq!(nanoseconds(stamp(time_ns)).unwrap(), time_ns);
    }
}

#[test]
fn on_level_ground_yaw_is_90_deg_more() {
    let pose = Pose {
        yaw_rad: 0.4,
        ..Pose::default()
    };
    let q = to_pose(&world_from_base_link(&pose, &Attitude::LEVEL)).orientation;
    let yaw_rad = 2.0 * q.z.atan2(q.w);
    assert!((yaw_rad - 0.4 - FRAC_PI_2).abs() < 1e-12);
}

#[test]
fn what_is_no_number_or_no_rotation_is_refused() {
    let mut pose = message::Pose::default();
    pose.position.y = f64::NAN;
    assert_eq!(
        from_pose(&pose).unwrap_err(),
        MessageFault::NotFinite { field: "position" }
    );
    let mut pose = message::Pose::default();
    pose.orientation.w = 0.0;
    assert_eq!(
        from_pose(&pose).unwrap_err(),
        MessageFault::Orientation { norm: 0.0 }
    );
    let mut twist = Twist::default();
    twist.angular.z = f64::INFINITY;
    assert!(TwistMapping { track_width_m: 1.0 }.motors(&twist).is_err());
    let late = Time {
        sec: 0,
        nanosec: 1_000_000_000,
    };
    assert!(nanoseconds(late).is_err());
    let joints = TreadJoints::default();
    assert!(joints.treads(&JointState::default()).is_err());
    assert!(joints.commanded(&Float64MultiArray::default()).is_err());
}
