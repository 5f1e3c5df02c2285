//! Between the body axes of ROS and those of the models: the one place where axes change.
//!
//! ROS bodies have x forward and y left; the worlds share their axes, X_g = x and Y_g = y. Attitudes pass
//! through rotations ([`sidehill_plant::frames`]).

use crate::drives::MeasuredMotorSpeeds;
use crate::ros2::conversions::MessageError;
use crate::ros2::message::{self, Twist};
use nalgebra::{Isometry3, Translation3};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::{Attitude, BodyVelocity, Pose, paper_attitude, ros_quaternion};
use sidehill_plant::vehicle::{RangeError, Vehicle};

/// Returns the transform from a vehicle's ROS axes to the world of a pose.
pub fn world_from_base_link(pose: &Pose, attitude: &Attitude) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(pose.x_m, pose.y_m, pose.z_m),
        ros_quaternion(attitude, pose.yaw_rad),
    )
}

/// Returns pose and attitude of a vehicle from the transform of its ROS axes to the world; yaw is from -pi
/// to pi.
pub fn pose_and_attitude(world_from_base_link: &Isometry3<f64>) -> (Pose, Attitude) {
    let (attitude, yaw_rad) = paper_attitude(&world_from_base_link.rotation);
    let at = &world_from_base_link.translation;
    let pose = Pose {
        x_m: at.x,
        y_m: at.y,
        z_m: at.z,
        yaw_rad,
    };
    (pose, attitude)
}

/// Returns the body velocity of a twist in base_link.
///
/// # Errors
/// A number that is not finite.
pub fn from_twist(twist: &Twist) -> Result<BodyVelocity, MessageError> {
    let velocity = BodyVelocity {
        right_m_s: -twist.linear.y,
        forward_m_s: twist.linear.x,
        yaw_rate_rad_s: twist.angular.z,
    };
    let all = [
        velocity.right_m_s,
        velocity.forward_m_s,
        velocity.yaw_rate_rad_s,
    ];
    if all.iter().all(|value| value.is_finite()) {
        Ok(velocity)
    } else {
        Err(MessageError::NotFinite { field: "twist" })
    }
}

/// Returns a body velocity as a twist in base_link.
pub fn to_twist(velocity: &BodyVelocity) -> Twist {
    Twist {
        linear: message::Vector3 {
            x: velocity.forward_m_s,
            y: -velocity.right_m_s,
            z: 0.0,
        },
        angular: message::Vector3 {
            x: 0.0,
            y: 0.0,
            z: velocity.yaw_rate_rad_s,
        },
    }
}

/// How a vehicle that obeys `cmd_vel` converts it to tread speeds: as a differential drive of some track
/// width. A controller that knows the width commands both treads exactly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TwistMapping {
    /// Distance b of the treads in v_r - v_l = b omega, m.
    pub track_width_m: f64,
}

impl TwistMapping {
    /// Returns the mapping by a width, which is the distance of the vehicle's tread ICRs where none
    /// is given.
    ///
    /// # Errors
    /// [`RangeError`] for a width out of range.
    pub fn new(track_width_m: Option<f64>, vehicle: &Vehicle) -> Result<Self, RangeError> {
        let icr_distance_m = vehicle.icrs.right_m - vehicle.icrs.left_m;
        let value = track_width_m.unwrap_or(icr_distance_m);
        let track_width_m = Bounds::new(0.05, 20.0, "m").check("track_width_m", value)?;
        Ok(Self { track_width_m })
    }

    /// Returns the twist that commands these speeds.
    pub fn twist(&self, motors: MeasuredMotorSpeeds) -> Twist {
        to_twist(&BodyVelocity {
            right_m_s: 0.0,
            forward_m_s: motors.traction_m_s,
            yaw_rate_rad_s: 2.0 * motors.steer_m_s / self.track_width_m,
        })
    }

    /// Returns the speeds that a twist commands.
    ///
    /// # Errors
    /// A number that is not finite.
    pub fn motors(&self, twist: &Twist) -> Result<MeasuredMotorSpeeds, MessageError> {
        let velocity = from_twist(twist)?;
        Ok(MeasuredMotorSpeeds {
            traction_m_s: velocity.forward_m_s,
            steer_m_s: 0.5 * self.track_width_m * velocity.yaw_rate_rad_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::conversions::{from_pose, to_pose};
    use nalgebra::Vector3;
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
        fn pose_and_attitude_survive_the_message((pose, attitude) in standing()) {
            let message = to_pose(&world_from_base_link(&pose, &attitude));
            let (back, attitude_back) = pose_and_attitude(&from_pose(&message).unwrap());
            prop_assert!((back.x_m - pose.x_m).abs() < 1e-9 && (back.y_m - pose.y_m).abs() < 1e-9);
            prop_assert!((back.z_m - pose.z_m).abs() < 1e-9);
            prop_assert!(wrap_angle(back.yaw_rad - pose.yaw_rad).abs() < 1e-9);
            prop_assert!((attitude_back.roll_rad - attitude.roll_rad).abs() < 1e-9);
            prop_assert!((attitude_back.pitch_rad - attitude.pitch_rad).abs() < 1e-9);
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
    fn a_twist_that_is_not_finite_is_refused() {
        let mut twist = Twist::default();
        twist.angular.z = f64::INFINITY;
        assert!(TwistMapping { track_width_m: 1.0 }.motors(&twist).is_err());
    }
}
