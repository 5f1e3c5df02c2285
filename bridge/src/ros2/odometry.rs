//! Odometry as messages.

use crate::ros2::conversions::{to_pose, to_transform};
use crate::ros2::convert::{to_twist, world_from_base_link};
use crate::ros2::message::{
    Covariance6, Header, Odometry, PoseWithCovariance, TransformStamped, TwistWithCovariance,
};
use nalgebra::Matrix3;
use sidehill_plant::frames::{Attitude, BodyVelocity, Pose};

/// Variance of what is not estimated, so that a filter that reads the message leaves it out.
const UNKNOWN: f64 = 1e6;
/// Standard deviation of roll and pitch, rad: that of a common AHRS.
const ATTITUDE_STD_RAD: f64 = 0.01;

/// What a nav_msgs/Odometry says.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryState {
    /// Instant, s.
    pub time_s: f64,
    /// Pose in the frame of the odometry.
    pub pose: Pose,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Velocity in body axes.
    pub velocity: BodyVelocity,
    /// Covariance of (x, y, yaw), m^2, m rad and rad^2.
    pub covariance: Matrix3<f64>,
    /// Standard deviation of the velocity, m/s.
    pub velocity_std_m_s: f64,
    /// Standard deviation of the yaw rate, rad/s.
    pub yaw_rate_std_rad_s: f64,
}

/// Returns the message of a state.
pub fn odometry_message(state: &OdometryState, header: Header, base: &str) -> Odometry {
    let attitude = ATTITUDE_STD_RAD.powi(2);
    // z, roll and pitch, then x, y and the rotation about z.
    let mut pose = diagonal([0.0, 0.0, UNKNOWN, attitude, attitude, 0.0]);
    for (i, row) in [0, 1, 5].into_iter().enumerate() {
        for (j, column) in [0, 1, 5].into_iter().enumerate() {
            pose[row][column] = state.covariance[(i, j)];
        }
    }
    let (speed, turn) = (
        state.velocity_std_m_s.powi(2),
        state.yaw_rate_std_rad_s.powi(2),
    );
    Odometry {
        header,
        child_frame_id: base.to_owned(),
        pose: PoseWithCovariance {
            pose: to_pose(&world_from_base_link(&state.pose, &state.attitude)),
            covariance: pose,
        },
        twist: TwistWithCovariance {
            twist: to_twist(&state.velocity),
            covariance: diagonal([speed, speed, UNKNOWN, UNKNOWN, UNKNOWN, turn]),
        },
    }
}

/// Returns the transform from the vehicle to the frame of a header.
pub fn transform_message(state: &OdometryState, header: Header, base: &str) -> TransformStamped {
    TransformStamped {
        header,
        child_frame_id: base.to_owned(),
        transform: to_transform(&world_from_base_link(&state.pose, &state.attitude)),
    }
}

fn diagonal(variances: [f64; 6]) -> Covariance6 {
    let mut covariance = [[0.0; 6]; 6];
    for (index, variance) in variances.into_iter().enumerate() {
        covariance[index][index] = variance;
    }
    covariance
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_message_has_the_axes_of_ros_and_says_what_is_unknown() {
        let mut covariance = Matrix3::zeros();
        covariance[(0, 0)] = 0.01;
        covariance[(0, 2)] = 0.002;
        let state = OdometryState {
            time_s: 1.0,
            pose: Pose {
                x_m: 2.0,
                ..Pose::default()
            },
            attitude: Attitude::LEVEL,
            velocity: BodyVelocity {
                right_m_s: 0.1,
                forward_m_s: 0.5,
                yaw_rate_rad_s: 0.2,
            },
            covariance,
            velocity_std_m_s: 0.1,
            yaw_rate_std_rad_s: 0.2,
        };
        let message = odometry_message(&state, Header::default(), "base_link");
        let twist = &message.twist.twist;
        assert_eq!(
            (twist.linear.x, twist.linear.y, twist.angular.z),
            (0.5, -0.1, 0.2)
        );
        assert_eq!(message.pose.covariance[0][5], 0.002);
        assert_eq!(message.pose.covariance[2][2], UNKNOWN);
        assert!((message.twist.covariance[1][1] - 0.01).abs() < 1e-12);
        let transform = transform_message(&state, Header::default(), "base_link");
        assert_eq!(transform.transform.translation.x, 2.0);
    }
}
