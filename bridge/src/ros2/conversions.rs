//! Between messages and `nalgebra`: stamps, vectors, rotations, poses and transforms.

use super::message::{self, Time};
use nalgebra::{Isometry3, Quaternion, UnitQuaternion, Vector3};

/// Why a message cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MessageError {
    /// A number is infinite or NaN.
    #[error("{field} is not finite")]
    NotFinite {
        /// The field.
        field: &'static str,
    },
    /// A quaternion that is not a rotation.
    #[error("the norm of the orientation is {norm}, not 1")]
    Orientation {
        /// Its norm.
        norm: f64,
    },
    /// A stamp with a second or more of nanoseconds.
    #[error("a stamp has {nanosec} ns, must be below 1e9")]
    Stamp {
        /// The nanoseconds.
        nanosec: u32,
    },
    /// A joint that is missing or has no velocity.
    #[error("there is no velocity of joint {joint}")]
    Joint {
        /// Its name.
        joint: String,
    },
    /// An array of the wrong length.
    #[error("an array has {length} values, must have {needed}")]
    Length {
        /// How many there are.
        length: usize,
        /// How many there must be.
        needed: usize,
    },
}

const NANOS: i64 = 1_000_000_000;

/// Returns a stamp in ns since the zero of its clock.
///
/// # Errors
/// [`MessageError::Stamp`].
pub fn nanoseconds(time: Time) -> Result<i64, MessageError> {
    if i64::from(time.nanosec) >= NANOS {
        return Err(MessageError::Stamp {
            nanosec: time.nanosec,
        });
    }
    Ok(i64::from(time.sec) * NANOS + i64::from(time.nanosec))
}

/// Returns the stamp of a time in ns, clamped to the seconds that a stamp can carry.
pub fn stamp(time_ns: i64) -> Time {
    let sec = time_ns
        .div_euclid(NANOS)
        .clamp(i64::from(i32::MIN), i64::from(i32::MAX));
    Time {
        sec: sec as i32,
        nanosec: time_ns.rem_euclid(NANOS) as u32,
    }
}

/// Returns a message's pose.
///
/// # Errors
/// A number that is not finite, or an orientation that is not a rotation.
pub fn from_pose(pose: &message::Pose) -> Result<Isometry3<f64>, MessageError> {
    let at = &pose.position;
    isometry([at.x, at.y, at.z], &pose.orientation)
}

/// Returns a pose as a message's.
pub fn to_pose(pose: &Isometry3<f64>) -> message::Pose {
    let at = &pose.translation;
    message::Pose {
        position: message::Point {
            x: at.x,
            y: at.y,
            z: at.z,
        },
        orientation: to_quaternion(&pose.rotation),
    }
}

/// Returns a message's transform.
///
/// # Errors
/// A number that is not finite, or a quaternion that is not a rotation.
pub fn from_transform(transform: &message::Transform) -> Result<Isometry3<f64>, MessageError> {
    let at = &transform.translation;
    isometry([at.x, at.y, at.z], &transform.rotation)
}

/// Returns a transform as a message's.
pub fn to_transform(transform: &Isometry3<f64>) -> message::Transform {
    message::Transform {
        translation: to_vector(&transform.translation.vector),
        rotation: to_quaternion(&transform.rotation),
    }
}

fn isometry(at: [f64; 3], rotation: &message::Quaternion) -> Result<Isometry3<f64>, MessageError> {
    let at = Vector3::from(at);
    if !at.iter().all(|value| value.is_finite()) {
        return Err(MessageError::NotFinite { field: "position" });
    }
    Ok(Isometry3::from_parts(at.into(), from_quaternion(rotation)?))
}

/// Returns a rotation. A norm within 1 % of 1 is rounding, as of single precision, and is divided out.
///
/// # Errors
/// A number that is not finite, or another norm.
pub fn from_quaternion(
    quaternion: &message::Quaternion,
) -> Result<UnitQuaternion<f64>, MessageError> {
    let q = Quaternion::new(quaternion.w, quaternion.x, quaternion.y, quaternion.z);
    if !q.coords.iter().all(|value| value.is_finite()) {
        return Err(MessageError::NotFinite {
            field: "orientation",
        });
    }
    let norm = q.norm();
    if (norm - 1.0).abs() > 0.01 {
        return Err(MessageError::Orientation { norm });
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

/// Returns a vector; `field` names it in an error.
///
/// # Errors
/// A number that is not finite.
pub fn from_vector(
    vector: &message::Vector3,
    field: &'static str,
) -> Result<Vector3<f64>, MessageError> {
    let vector = Vector3::new(vector.x, vector.y, vector.z);
    if vector.iter().all(|value| value.is_finite()) {
        Ok(vector)
    } else {
        Err(MessageError::NotFinite { field })
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

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Translation3;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_transform_survives_the_message(x in -1e3..1e3f64, y in -1e3..1e3f64, z in -50.0..50.0f64,
                                            roll in -3.1..3.1f64, pitch in -1.5..1.5f64, yaw in -3.1..3.1f64) {
            let isometry = Isometry3::from_parts(
                Translation3::new(x, y, z), UnitQuaternion::from_euler_angles(roll, pitch, yaw));
            for back in [from_transform(&to_transform(&isometry)), from_pose(&to_pose(&isometry))] {
                prop_assert!((back.unwrap().to_homogeneous() - isometry.to_homogeneous()).norm() < 1e-9);
            }
        }

        #[test]
        fn stamps_survive(time_ns in (i64::from(i32::MIN) * NANOS)..(i64::from(i32::MAX) * NANOS)) {
            prop_assert_eq!(nanoseconds(stamp(time_ns)).unwrap(), time_ns);
        }
    }

    #[test]
    fn damaged_messages_are_refused() {
        let mut pose = message::Pose::default();
        pose.position.y = f64::NAN;
        let error = from_pose(&pose).unwrap_err();
        assert_eq!(error, MessageError::NotFinite { field: "position" });
        let mut pose = message::Pose::default();
        pose.orientation.w = 0.0;
        let error = from_pose(&pose).unwrap_err();
        assert_eq!(error, MessageError::Orientation { norm: 0.0 });
        let late = Time {
            sec: 0,
            nanosec: 1_000_000_000,
        };
        assert!(nanoseconds(late).is_err());
    }
}
