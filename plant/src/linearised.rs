//! Values of a model with their derivatives.

use crate::frames::BodyVelocity;
use nalgebra::Vector3;

/// Body velocity of the smoothed model with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Linearised {
    /// The velocity itself.
    pub velocity: BodyVelocity,
    /// Derivative of (v_x, v_y, omega_z) by roll, per rad.
    pub by_roll: Vector3<f64>,
    /// Derivative of (v_x, v_y, omega_z) by pitch, per rad.
    pub by_pitch: Vector3<f64>,
    /// Derivative of (v_x, v_y, omega_z) by traction, per m/s.
    pub by_traction: Vector3<f64>,
    /// Derivative of (v_x, v_y, omega_z) by steer, per m/s.
    pub by_steer: Vector3<f64>,
}

/// Rate of (x, y, yaw) in the world on a local plane, with its derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearisedRate {
    /// (dx/dt, dy/dt, dyaw/dt) in the world frame, m/s and rad/s.
    pub rate: Vector3<f64>,
    /// Its derivative by yaw: through the direction of travel and through the attitude.
    pub by_yaw: Vector3<f64>,
    /// Its derivative by traction.
    pub by_traction: Vector3<f64>,
    /// Its derivative by steer.
    pub by_steer: Vector3<f64>,
}

/// One step of (x, y, yaw) with its sensitivities: x+ = x + a, A = d x+/d x, B = d x+/d (tau, sigma).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearisedStep {
    /// Increment of (x, y, yaw), m and rad.
    pub increment: Vector3<f64>,
    /// Third column of A without its identity; the first two columns of A are those of the identity.
    pub by_yaw: Vector3<f64>,
    /// First column of B.
    pub by_traction: Vector3<f64>,
    /// Second column of B.
    pub by_steer: Vector3<f64>,
}
