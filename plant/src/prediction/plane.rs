//! Motion on a plane by a model of the body velocity: equation (12) with its derivatives.

use super::{Linearised, LinearisedRate, LinearisedStep};
use crate::frames::{Attitude, BodyVelocity, Tilt};
use nalgebra::{Matrix3, Vector3};

/// A body on a plane at a heading.
pub struct Placed {
    /// Sine and cosine of the heading.
    psi: (f64, f64),
    tilt: Tilt,
    /// Upward normal along the body's horizontal axes: to the right and forward.
    right: f64,
    forward: f64,
    /// From body velocity to the rate of (x, y, yaw): equation (12).
    axes: Matrix3<f64>,
    /// Upward normal along the world's.
    up: f64,
}

impl Placed {
    /// Returns the attitude.
    pub fn attitude(&self) -> Attitude {
        Attitude {
            roll_rad: self.right.atan2(self.up),
            pitch_rad: self.tilt.s_phi.atan2(self.tilt.c_phi),
        }
    }

    /// Returns the attitude's sines and cosines, which cost less than its angles.
    pub fn tilt(&self) -> Tilt {
        self.tilt
    }

    fn at(normal_in_world: &Vector3<f64>, yaw_rad: f64) -> Self {
        let (s_psi, c_psi) = yaw_rad.sin_cos();
        let n = normal_in_world;
        let right = c_psi * n.x + s_psi * n.y;
        let forward = -s_psi * n.x + c_psi * n.y;
        let c_phi = (1.0 - forward * forward).max(1e-12).sqrt();
        let (s_phi, s_alpha, c_alpha) = (-forward, right / c_phi, n.z / c_phi);
        Self {
            psi: (s_psi, c_psi),
            tilt: Tilt {
                s_alpha,
                c_alpha,
                s_phi,
                c_phi,
            },
            right,
            forward,
            axes: Matrix3::new(
                c_psi * c_alpha,
                c_psi * s_phi * s_alpha - c_phi * s_psi,
                0.0,
                s_psi * c_alpha,
                c_psi * c_phi + s_phi * s_psi * s_alpha,
                0.0,
                0.0,
                0.0,
                c_phi / c_alpha,
            ),
            up: n.z,
        }
    }

    fn rate(&self, velocity: &BodyVelocity) -> Vector3<f64> {
        self.axes * velocity.vector()
    }
}

/// Returns the rate of (x, y, yaw) at heading `yaw_rad` on a plane with upward unit normal
/// `normal_in_world`: `body_velocity` in equation (12), with the attitude that this heading has there, see [`Placed`].
// Inlined, so that a caller of some derivatives does not pay for all.
#[inline(always)]
pub fn rate_on_plane(
    normal_in_world: &Vector3<f64>,
    yaw_rad: f64,
    body_velocity: impl FnOnce(&Placed) -> Linearised,
) -> LinearisedRate {
    let placed = Placed::at(normal_in_world, yaw_rad);
    let (s_psi, c_psi) = placed.psi;
    let Tilt {
        s_alpha,
        c_alpha,
        s_phi,
        c_phi,
    } = placed.tilt;
    // n' turns with the heading: d right = forward d psi, d forward = -right d psi.
    let roll_by_yaw = normal_in_world.z * placed.forward / (c_phi * c_phi);
    let pitch_by_yaw = placed.right / c_phi;

    let body = body_velocity(&placed);
    let (axes, yaw_factor) = (placed.axes, c_phi / c_alpha);
    let (v_x, v_y, omega) = (
        body.velocity.right_m_s,
        body.velocity.forward_m_s,
        body.velocity.yaw_rate_rad_s,
    );
    let by_heading = Vector3::new(
        -s_psi * c_alpha * v_x - (s_psi * s_phi * s_alpha + c_phi * c_psi) * v_y,
        c_psi * c_alpha * v_x + (c_psi * s_phi * s_alpha - s_psi * c_phi) * v_y,
        0.0,
    );
    let by_alpha = Vector3::new(
        -c_psi * s_alpha * v_x + c_psi * s_phi * c_alpha * v_y,
        -s_psi * s_alpha * v_x + s_psi * s_phi * c_alpha * v_y,
        yaw_factor * s_alpha / c_alpha * omega,
    );
    let by_phi = Vector3::new(
        (c_psi * c_phi * s_alpha + s_phi * s_psi) * v_y,
        (s_psi * c_phi * s_alpha - s_phi * c_psi) * v_y,
        -s_phi / c_alpha * omega,
    );
    LinearisedRate {
        rate: placed.rate(&body.velocity),
        by_yaw: by_heading
            + roll_by_yaw * (by_alpha + axes * body.by_roll)
            + pitch_by_yaw * (by_phi + axes * body.by_pitch),
        by_traction: axes * body.by_traction,
        by_steer: axes * body.by_steer,
    }
}

/// Returns one step of `step_s` with constant motor speeds by the midpoint rule; `body_velocity` is
/// the model's at these speeds.
///
/// Local error O(step^3): below 0.02 mm for 0.15 s at 0.5 rad/s and 0.5 m/s.
pub fn step_on_plane(
    normal_in_world: &Vector3<f64>,
    yaw_rad: f64,
    step_s: f64,
    mut body_velocity: impl FnMut(&Placed) -> Linearised,
) -> LinearisedStep {
    let start = rate_on_plane(normal_in_world, yaw_rad, &mut body_velocity);
    let yaw_rad = yaw_rad + 0.5 * step_s * start.rate.z;
    let middle = rate_on_plane(normal_in_world, yaw_rad, &mut body_velocity);
    midpoint_step(&start, &middle, step_s)
}

/// Returns a step of `step_s` by the rates at its start and in its middle.
#[inline(always)]
pub fn midpoint_step(
    start: &LinearisedRate,
    middle: &LinearisedRate,
    step_s: f64,
) -> LinearisedStep {
    let half = 0.5 * step_s;
    let middle_by_yaw = 1.0 + half * start.by_yaw.z;
    LinearisedStep {
        increment: step_s * middle.rate,
        by_yaw: step_s * middle_by_yaw * middle.by_yaw,
        by_traction: step_s * (middle.by_traction + half * start.by_traction.z * middle.by_yaw),
        by_steer: step_s * (middle.by_steer + half * start.by_steer.z * middle.by_yaw),
    }
}

/// Returns the increment of (x, y, yaw) of [`step_on_plane`] alone.
pub fn increment_on_plane(
    normal_in_world: &Vector3<f64>,
    yaw_rad: f64,
    step_s: f64,
    mut body_velocity: impl FnMut(&Placed) -> BodyVelocity,
) -> Vector3<f64> {
    let start = Placed::at(normal_in_world, yaw_rad);
    let yaw_rate_rad_s = start.rate(&body_velocity(&start)).z;
    let middle = Placed::at(normal_in_world, yaw_rad + 0.5 * step_s * yaw_rate_rad_s);
    step_s * middle.rate(&body_velocity(&middle))
}
