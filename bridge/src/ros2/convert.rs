//! Between ROS and this project: the one file that turns messages into frames, stamps and speeds,
//! and back. Attitudes pass through rotations ([`sidehill_plant::frames`]).
//!
//! ROS bodies have x forward and y left; the world is shared, X_g = x and Y_g = y.

use super::message::{self, Float64MultiArray, Header, JointState, Time, Twist};
use crate::drives::MeasuredMotorSpeeds;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{Attitude, BodyVelocity, Pose, paper_attitude, ros_quaternion};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::{RangeError, Vehicle};

/// Why a message cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MessageFault {
    /// A number is infinite or none.
    #[error("{field} is not finite")]
    NotFinite {
        /// Which.
        field: &'static str,
    },
    /// A quaternion is no rotation.
    #[error("the norm of the orientation is {norm}, not 1")]
    Orientation {
        /// Its norm.
        norm: f64,
    },
    /// A stamp's nanoseconds are a second or more.
    #[error("a stamp has {nanosec} ns after its second")]
    Stamp {
        /// The nanoseconds.
        nanosec: u32,
    },
    /// A joint is missing or has no velocity.
    #[error("there is no velocity of joint {joint}")]
    Joint {
        /// Its name.
        joint: String,
    },
    /// An array is too short.
    #[error("{length} values where {needed} are needed")]
    Length {
        /// How many there are.
        length: usize,
        /// How many there must be.
        needed: usize,
    },
}

const NANOS: i64 = 1_000_000_000;

/// Returns a stamp in ns since the beginning of its clock.
///
/// # Errors
/// [`MessageFault::Stamp`].
pub fn nanoseconds(time: Time) -> Result<i64, MessageFault> {
    if i64::from(time.nanosec) >= NANOS {
        return Err(MessageFault::Stamp {
            nanosec: time.nanosec,
        });
    }
    Ok(i64::from(time.sec) * NANOS + i64::from(time.nanosec))
}

/// Returns the stamp of a time in ns, held within the seconds that a stamp can carry.
pub fn stamp(time_ns: i64) -> Time {
    let sec = time_ns
        .div_euclid(NANOS)
        .clamp(i64::from(i32::MIN), i64::from(i32::MAX));
    Time {
        sec: sec as i32,
        nanosec: time_ns.rem_euclid(NANOS) as u32,
    }
}

/// Returns the transform from a vehicle's ROS axes to the world of a pose.
pub fn world_from_base_link(pose: &Pose, attitude: &Attitude) -> Isometry3<f64> {
    Isometry3::from_parts(
        Translation3::new(pose.x_m, pose.y_m, pose.z_m),
        ros_quaternion(attitude, pose.yaw_rad),
    )
}

/// Returns pose and attitude of a vehicle from the transform of its ROS axes to the world; yaw is
/// from -pi to pi.
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

/// Returns a message's pose as a transform.
///
/// # Errors
/// A number that is not finite, or an orientation that is no rotation.
pub fn from_pose(pose: &message::Pose) -> Result<Isometry3<f64>, MessageFault> {
    let at = &pose.position;
    isometry([at.x, at.y, at.z], &pose.orientation)
}

/// Returns a transform as a message's pose.
pub fn to_pose(isometry: &Isometry3<f64>) -> message::Pose {
    let at = &isometry.translation;
    message::Pose {
        position: message::Point {
            x: at.x,
            y: at.y,
            z: at.z,
        },
        orientation: to_quaternion(&isometry.rotation),
    }
}

/// Returns a message's transform.
///
/// # Errors
/// A number that is not finite, or a rotation that is none.
pub fn from_transform(transform: &message::Transform) -> Result<Isometry3<f64>, MessageFault> {
    let at = &transform.translation;
    isometry([at.x, at.y, at.z], &transform.rotation)
}

/// Returns a transform as a message's.
pub fn to_transform(isometry: &Isometry3<f64>) -> message::Transform {
    let at = &isometry.translation;
    message::Transform {
        translation: to_vector(&at.vector),
        rotation: to_quaternion(&isometry.rotation),
    }
}

fn isometry(at: [f64; 3], rotation: &message::Quaternion) -> Result<Isometry3<f64>, MessageFault> {
    let at = Vector3::from(at);
    if !at.iter().all(|value| value.is_finite()) {
        return Err(MessageFault::NotFinite { field: "position" });
    }
    Ok(Isometry3::from_parts(at.into(), from_quaternion(rotation)?))
}

/// Returns a rotation. A norm within 1 % of 1 is rounding, as of single precision, and divided out.
///
/// # Errors
/// A number that is not finite, or another norm.
pub fn from_quaternion(
    quaternion: &message::Quaternion,
) -> Result<UnitQuaternion<f64>, MessageFault> {
    let q = Quaternion::new(quaternion.w, quaternion.x, quaternion.y, quaternion.z);
    if !q.coords.iter().all(|value| value.is_finite()) {
        return Err(MessageFault::NotFinite {
            field: "orientation",
        });
    }
    let norm = q.norm();
    if (norm - 1.0).abs() > 0.01 {
        return Err(MessageFault::Orientation { norm });
    }
    Ok(UnitQuaternion::from_quaternion(q))
}

/// Returns a rotation as a message's.
pub fn to_quaternion(rotation: &UnitQuaternion<f64>) -> message::Quaternion {
    message::Quaternion {
        x: rotation.i,
        y: rotation.j,
        z: rotation.k,
        w: rotation.w,
    }
}

/// Returns a vector as a message's.
pub fn to_vector(vector: &Vector3<f64>) -> message::Vector3 {
    message::Vector3 {
        x: vector.x,
        y: vector.y,
        z: vector.z,
    }
}

/// Returns the body velocity of a twist in base_link.
///
/// # Errors
/// A number that is not finite.
pub fn from_twist(twist: &Twist) -> Result<BodyVelocity, MessageFault> {
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
        Err(MessageFault::NotFinite { field: "twist" })
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

/// How a vehicle that obeys cmd_vel turns it into speeds of its treads: as a differential drive of a
/// width of its own. A controller that knows the width can so command both treads exactly.
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
        let track_width_m =
            RangeError::check("track_width_m", value, 0.05, 20.0, "from 0.05 to 20 m")?;
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
    pub fn motors(&self, twist: &Twist) -> Result<MeasuredMotorSpeeds, MessageFault> {
        let velocity = from_twist(twist)?;
        Ok(MeasuredMotorSpeeds {
            traction_m_s: velocity.forward_m_s,
            steer_m_s: 0.5 * self.track_width_m * velocity.yaw_rate_rad_s,
        })
    }
}

/// The joints that stand for the treads.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TreadJoints {
    /// Name of the left joint.
    pub left: String,
    /// Name of the right joint.
    pub right: String,
    /// Tread speed over joint velocity, m: the radius of a wheel.
    pub radius_m: f64,
}

impl Default for TreadJoints {
    /// Joints whose velocity is the tread's speed.
    fn default() -> Self {
        Self {
            left: "left_tread_joint".to_owned(),
            right: "right_tread_joint".to_owned(),
            radius_m: 1.0,
        }
    }
}

impl TreadJoints {
    /// Checks the range.
    ///
    /// # Errors
    /// [`RangeError`].
    pub fn validate(&self) -> Result<(), RangeError> {
        let (key, value) = ("joints.radius_m", self.radius_m);
        RangeError::check(key, value, 0.01, 10.0, "from 0.01 to 10 m").map(|_| ())
    }

    /// Returns the tread speeds of a message, wherever in it the joints stand.
    ///
    /// # Errors
    /// A joint without velocity, or one that is not finite.
    pub fn treads(&self, message: &JointState) -> Result<MeasuredTreadSpeeds, MessageFault> {
        let speed_m_s = |joint: &str| {
            let index = message.name.iter().position(|name| name == joint);
            let velocity = index.and_then(|index| message.velocity.get(index));
            let velocity = velocity.ok_or_else(|| MessageFault::Joint {
                joint: joint.to_owned(),
            })?;
            self.speed_m_s(*velocity)
        };
        Ok(MeasuredTreadSpeeds {
            left_m_s: speed_m_s(&self.left)?,
            right_m_s: speed_m_s(&self.right)?,
        })
    }

    /// Returns tread speeds as velocities of the joints; `angles_rad` are theirs.
    pub fn joint_state(
        &self,
        header: Header,
        treads: MeasuredTreadSpeeds,
        angles_rad: [f64; 2],
    ) -> JointState {
        JointState {
            header,
            name: vec![self.left.clone(), self.right.clone()],
            position: angles_rad.to_vec(),
            velocity: self.velocities_rad_s(treads).to_vec(),
            effort: Vec::new(),
        }
    }

    /// Returns the tread speeds that an array of the left and the right joint's velocity commands.
    ///
    /// # Errors
    /// Fewer than two numbers, or one that is not finite.
    pub fn commanded(
        &self,
        message: &Float64MultiArray,
    ) -> Result<MeasuredTreadSpeeds, MessageFault> {
        let [left, right] = message.data[..] else {
            return Err(MessageFault::Length {
                length: message.data.len(),
                needed: 2,
            });
        };
        Ok(MeasuredTreadSpeeds {
            left_m_s: self.speed_m_s(left)?,
            right_m_s: self.speed_m_s(right)?,
        })
    }

    /// Returns the array that commands tread speeds.
    pub fn command(&self, treads: MeasuredTreadSpeeds) -> Float64MultiArray {
        Float64MultiArray {
            data: self.velocities_rad_s(treads).to_vec(),
            ..Float64MultiArray::default()
        }
    }

    fn velocities_rad_s(&self, treads: MeasuredTreadSpeeds) -> [f64; 2] {
        [treads.left_m_s, treads.right_m_s].map(|speed_m_s| speed_m_s / self.radius_m)
    }

    fn speed_m_s(&self, velocity_rad_s: f64) -> Result<f64, MessageFault> {
        if !velocity_rad_s.is_finite() {
            return Err(MessageFault::NotFinite { field: "velocity" });
        }
        Ok(velocity_rad_s * self.radius_m)
    }
}

#[cfg(test)]
mod tests;
