//! What several unit tests of this crate share.

use crate::frames::{Attitude, BodyVelocity};
use crate::speeds::{MotorSpeeds, TreadSpeeds};
use nalgebra::Vector3;

pub(crate) fn attitude(roll_rad: f64, pitch_rad: f64) -> Attitude {
    Attitude {
        roll_rad,
        pitch_rad,
    }
}

pub(crate) fn motors(traction_m_s: f64, steer_m_s: f64) -> MotorSpeeds {
    MotorSpeeds {
        traction_m_s,
        steer_m_s,
    }
}

pub(crate) fn treads(left_m_s: f64, right_m_s: f64) -> TreadSpeeds {
    TreadSpeeds {
        left_m_s,
        right_m_s,
    }
}

/// Returns right and forward speed, m/s, and yaw rate, rad/s.
pub(crate) fn vector(velocity: BodyVelocity) -> Vector3<f64> {
    velocity.vector()
}

/// Returns the central difference of `f` at 0.
pub(crate) fn slope(f: impl Fn(f64) -> Vector3<f64>) -> Vector3<f64> {
    let h = 1e-6;
    (f(h) - f(-h)) / (2.0 * h)
}
