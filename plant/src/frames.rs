//! Frames, poses and attitudes: the one file that knows how angles turn into axes.
//!
//! Body frame of the paper: X right, Y forward, Z up. World frame: X_g and Y_g horizontal, Z_g up.
//! Yaw psi is the heading of the vehicle counted counter-clockwise from Y_g, roll alpha turns about
//! Y (right side down is positive), pitch phi about X (nose up is positive), and
//! `R = Rz(psi) Ry(alpha) Rx(phi)` (equation 12).
//!
//! [`RosAttitude`] follows REP-103 (x forward, y left, `R = Rz Ry Rx`). The two triples
//! differ by more than signs once both angles are non-zero, so every conversion goes through a
//! rotation.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Roll and pitch of the body against the horizontal, in the paper's order `Ry(roll) Rx(pitch)`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Attitude {
    /// Roll alpha about the body's forward axis, rad, right side down positive.
    pub roll_rad: f64,
    /// Pitch phi about the body's right axis, rad, nose up positive.
    pub pitch_rad: f64,
}

impl Attitude {
    /// A vehicle that stands level.
    pub const LEVEL: Self = Self {
        roll_rad: 0.0,
        pitch_rad: 0.0,
    };

    /// Returns the exact attitude at heading `yaw_rad` on a plane with upward unit normal
    /// `normal_in_world`: n' = Rz(-psi) n, phi = -asin(n'_y), alpha = atan2(n'_x, n'_z).
    ///
    /// Valid for any plane that is not vertical.
    pub fn on_plane(normal_in_world: &Vector3<f64>, yaw_rad: f64) -> Self {
        let (sin, cos) = yaw_rad.sin_cos();
        let right = cos * normal_in_world.x + sin * normal_in_world.y;
        let forward = -sin * normal_in_world.x + cos * normal_in_world.y;
        Self {
            roll_rad: right.atan2(normal_in_world.z),
            pitch_rad: -forward.clamp(-1.0, 1.0).asin(),
        }
    }

    /// Returns the small-angle attitude of equation (1), alpha = -beta sin(gamma),
    /// phi = beta cos(gamma), with beta the slope and gamma the heading counted from uphill, rad.
    pub fn from_slope(slope_rad: f64, heading_from_uphill_rad: f64) -> Self {
        let (sin, cos) = heading_from_uphill_rad.sin_cos();
        Self {
            roll_rad: -slope_rad * sin,
            pitch_rad: slope_rad * cos,
        }
    }

    /// Returns the rotation `world_from_body` = Rz(psi) Ry(alpha) Rx(phi) of equation (12).
    pub fn world_from_body(&self, yaw_rad: f64) -> Rotation3<f64> {
        Rotation3::from_axis_angle(&Vector3::z_axis(), yaw_rad)
            * Rotation3::from_axis_angle(&Vector3::y_axis(), self.roll_rad)
            * Rotation3::from_axis_angle(&Vector3::x_axis(), self.pitch_rad)
    }

    /// Returns the upward unit normal, in the world frame, of the plane on which a vehicle of this
    /// attitude stands at heading `yaw_rad`; the inverse of [`Attitude::on_plane`].
    pub fn plane_normal(&self, yaw_rad: f64) -> Vector3<f64> {
        self.world_from_body(yaw_rad) * Vector3::z()
    }

    /// Returns whether both angles are finite.
    pub fn is_finite(&self) -> bool {
        self.roll_rad.is_finite() && self.pitch_rad.is_finite()
    }
}

/// Velocity of the body's origin and its yaw rate, in body axes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct BodyVelocity {
    /// Lateral velocity v_x, m/s, to the right.
    pub right_m_s: f64,
    /// Longitudinal velocity v_y, m/s, forward.
    pub forward_m_s: f64,
    /// Angular velocity omega_z about the body's up axis, rad/s, counter-clockwise.
    pub yaw_rate_rad_s: f64,
}

impl BodyVelocity {
    /// Returns (v_x, v_y, omega_z).
    pub fn vector(&self) -> Vector3<f64> {
        Vector3::new(self.right_m_s, self.forward_m_s, self.yaw_rate_rad_s)
    }

    /// Returns the velocity of (v_x, v_y, omega_z).
    pub fn from_vector(vector: &Vector3<f64>) -> Self {
        Self {
            right_m_s: vector.x,
            forward_m_s: vector.y,
            yaw_rate_rad_s: vector.z,
        }
    }
}

/// Position of the body's origin and heading in the horizontal plane of the world.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct PlanarPose {
    /// X_g, m.
    pub x_m: f64,
    /// Y_g, m.
    pub y_m: f64,
    /// Heading psi, rad, counter-clockwise from Y_g; not wrapped.
    pub yaw_rad: f64,
}

/// Position of the body's origin in the world, and heading.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct Pose {
    /// X_g, m.
    pub x_m: f64,
    /// Y_g, m.
    pub y_m: f64,
    /// Z_g, m, up.
    pub z_m: f64,
    /// Heading psi, rad, counter-clockwise from Y_g; not wrapped.
    pub yaw_rad: f64,
}

impl Pose {
    /// Returns the pose without its height.
    pub fn planar(&self) -> PlanarPose {
        PlanarPose {
            x_m: self.x_m,
            y_m: self.y_m,
            yaw_rad: self.yaw_rad,
        }
    }
}

impl From<PlanarPose> for Pose {
    /// At height 0.
    fn from(planar: PlanarPose) -> Self {
        Self {
            x_m: planar.x_m,
            y_m: planar.y_m,
            z_m: 0.0,
            yaw_rad: planar.yaw_rad,
        }
    }
}

/// Rate of change of a [`Pose`], as equation (12) gives it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PoseRate {
    /// dX_g/dt, m/s.
    pub x_m_s: f64,
    /// dY_g/dt, m/s.
    pub y_m_s: f64,
    /// dZ_g/dt, m/s.
    pub z_m_s: f64,
    /// d psi/dt, rad/s.
    pub yaw_rad_s: f64,
}

/// Returns the rate of the pose for a body velocity at an attitude and heading: equation (12).
///
/// Singular where |alpha| = pi/2, which no vehicle that drives reaches.
pub fn pose_rate(velocity: &BodyVelocity, attitude: &Attitude, yaw_rad: f64) -> PoseRate {
    Tilt::of(attitude).pose_rate(velocity, yaw_rad)
}

/// Sines and cosines of an attitude, to be used more than once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tilt {
    pub(crate) s_alpha: f64,
    pub(crate) c_alpha: f64,
    pub(crate) s_phi: f64,
    pub(crate) c_phi: f64,
}

impl From<Attitude> for Tilt {
    fn from(attitude: Attitude) -> Self {
        Self::of(&attitude)
    }
}

impl Tilt {
    /// Returns those of an attitude.
    pub fn of(attitude: &Attitude) -> Self {
        let (s_alpha, c_alpha) = attitude.roll_rad.sin_cos();
        let (s_phi, c_phi) = attitude.pitch_rad.sin_cos();
        Self {
            s_alpha,
            c_alpha,
            s_phi,
            c_phi,
        }
    }

    /// Returns the sines of the differences of roll and pitch from those of `other`.
    pub(crate) fn less(&self, other: &Self) -> (f64, f64) {
        (
            self.s_alpha * other.c_alpha - self.c_alpha * other.s_alpha,
            self.s_phi * other.c_phi - self.c_phi * other.s_phi,
        )
    }

    /// Returns the rate of the pose, as [`pose_rate`] does.
    pub fn pose_rate(&self, velocity: &BodyVelocity, yaw_rad: f64) -> PoseRate {
        let Self {
            s_alpha,
            c_alpha,
            s_phi,
            c_phi,
        } = *self;
        let (s_psi, c_psi) = yaw_rad.sin_cos();
        let (v_x, v_y) = (velocity.right_m_s, velocity.forward_m_s);
        PoseRate {
            x_m_s: c_psi * c_alpha * v_x + (c_psi * s_phi * s_alpha - c_phi * s_psi) * v_y,
            y_m_s: s_psi * c_alpha * v_x + (c_psi * c_phi + s_phi * s_psi * s_alpha) * v_y,
            z_m_s: -s_alpha * v_x + s_phi * c_alpha * v_y,
            yaw_rad_s: c_phi / c_alpha * velocity.yaw_rate_rad_s,
        }
    }
}

/// Returns the angle wrapped into (-pi, pi], rad.
pub fn wrap_angle(angle_rad: f64) -> f64 {
    let wrapped = angle_rad.rem_euclid(TAU);
    if wrapped > PI { wrapped - TAU } else { wrapped }
}

/// Roll, pitch and yaw of REP-103: x forward, y left, z up, `R = Rz(yaw) Ry(pitch) Rx(roll)`,
/// yaw counted counter-clockwise from world x.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RosAttitude {
    /// Rotation about x (forward), rad, right side down positive.
    pub roll_rad: f64,
    /// Rotation about y (left), rad, nose down positive.
    pub pitch_rad: f64,
    /// Rotation about z (up), rad, 0 when x_ros points along world x.
    pub yaw_rad: f64,
}

impl RosAttitude {
    /// Returns the REP-103 triple of the orientation with the paper's attitude and heading.
    pub fn from_paper(attitude: &Attitude, yaw_rad: f64) -> Self {
        let (roll_rad, pitch_rad, yaw_rad) = ros_quaternion(attitude, yaw_rad).euler_angles();
        Self {
            roll_rad,
            pitch_rad,
            yaw_rad,
        }
    }

    /// Returns the paper's attitude and heading of this orientation.
    pub fn to_paper(self) -> (Attitude, f64) {
        paper_attitude(&UnitQuaternion::from_euler_angles(
            self.roll_rad,
            self.pitch_rad,
            self.yaw_rad,
        ))
    }
}

/// Returns the REP-103 quaternion `world_from_base_link` of the paper's attitude and heading.
///
/// The worlds share their axes (X_g = x, Y_g = y), the bodies do not: x_ros is the paper's Y.
pub fn ros_quaternion(attitude: &Attitude, yaw_rad: f64) -> UnitQuaternion<f64> {
    UnitQuaternion::from_rotation_matrix(&(attitude.world_from_body(yaw_rad) * body_from_ros()))
}

/// Returns the paper's attitude and heading of a REP-103 quaternion `world_from_base_link`.
pub fn paper_attitude(world_from_base_link: &UnitQuaternion<f64>) -> (Attitude, f64) {
    let r = (world_from_base_link.to_rotation_matrix() * body_from_ros().inverse()).into_inner();
    // R = Rz(psi) Ry(alpha) Rx(phi): the bottom row is (-s_alpha, s_phi c_alpha, c_phi c_alpha).
    let attitude = Attitude {
        roll_rad: (-r[(2, 0)]).clamp(-1.0, 1.0).asin(),
        pitch_rad: r[(2, 1)].atan2(r[(2, 2)]),
    };
    (attitude, r[(1, 0)].atan2(r[(0, 0)]))
}

/// Returns the rotation that expresses REP-103 body axes in the paper's body axes:
/// x_ros = Y, y_ros = -X.
fn body_from_ros() -> Rotation3<f64> {
    Rotation3::from_matrix_unchecked(Matrix3::new(
        0.0, -1.0, 0.0, //
        1.0, 0.0, 0.0, //
        0.0, 0.0, 1.0,
    ))
}

#[cfg(test)]
mod tests;
