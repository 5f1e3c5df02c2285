//! ICRIK smoothed for prediction, with analytic Jacobians.
//!
//! With traction tau and steer sigma as inputs, (4)-(10) give for each turning direction s = +1, -1
//! a tread-ICR distance D_s, a mid point m_s and a forward shift y_s, and
//!
//! ```text
//! omega = 2 sigma / D,   v_x = y omega,   v_y = tau - m omega
//! ```
//!
//! The exact model switches between the two directions at sigma = 0, and its gain
//! g = v_y^m - |tau| has a kink at tau = 0. Here both are blended:
//!
//! ```text
//! s = sigma / sqrt(sigma^2 + eps^2),   |tau| ~ sqrt(tau^2 + eps^2) - eps
//! D = ((1 + s) D_+ + (1 - s) D_-) / 2, and so for m and y
//! ```
//!
//! As eps goes to zero this is the exact model at every sigma other than 0, limits included: where a
//! limit holds an ICR, its derivative is that of the limit. The kinks in attitude (|alpha| = |phi|
//! and the limits) stay; there the one-sided derivative of the branch in force is used.

use crate::extension::ExtensionGains;
use crate::frames::{Attitude, BodyVelocity};
pub use crate::linearised::{Linearised, LinearisedRate, LinearisedStep};
use crate::slip_gains::{SlipGains, Terms};
use crate::speeds::MotorSpeeds;
use crate::vehicle::Vehicle;
use nalgebra::Vector3;
pub use plane::{Placed, increment_on_plane, rate_on_plane, step_on_plane};

/// ICRIK made differentiable, with the terms of the vehicle's extension and learned slip gains; with
/// both slide gains zero, ICRHK.
#[derive(Debug, Clone, PartialEq)]
pub struct PredictionModel {
    vehicle: Vehicle,
    smoothing_m_s: f64,
    extension: ExtensionGains,
    slip_gains: SlipGains,
}

/// ICRs of one turning direction and their derivatives.
#[derive(Clone, Copy)]
struct TreadSide {
    distance: ModelTerm,
    middle: ModelTerm,
    forward: ModelTerm,
}

/// A value with its derivatives by roll, pitch and the gain g.
#[derive(Clone, Copy)]
struct ModelTerm {
    value: f64,
    by_roll: f64,
    by_pitch: f64,
    by_gain: f64,
}

impl ModelTerm {
    fn constant(value: f64) -> Self {
        Self {
            value,
            by_roll: 0.0,
            by_pitch: 0.0,
            by_gain: 0.0,
        }
    }

    fn combine(a: f64, one: Self, b: f64, other: Self) -> Self {
        Self {
            value: a * one.value + b * other.value,
            by_roll: a * one.by_roll + b * other.by_roll,
            by_pitch: a * one.by_pitch + b * other.by_pitch,
            by_gain: a * one.by_gain + b * other.by_gain,
        }
    }
}

impl PredictionModel {
    /// Returns the smoothed model of `vehicle`; `smoothing_m_s` is eps, the speed within which |tau|
    /// and the turning direction are rounded off, m/s, positive.
    pub fn new(vehicle: Vehicle, smoothing_m_s: f64) -> Self {
        Self {
            extension: vehicle.extension_gains(),
            vehicle,
            smoothing_m_s: smoothing_m_s.max(1e-9),
            slip_gains: SlipGains::zeros(),
        }
    }

    /// Returns the vehicle whose motion is predicted.
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Replaces the slip gains, as the estimator learns them.
    pub fn set_slip_gains(&mut self, gains: &SlipGains) {
        self.slip_gains = *gains;
    }

    /// Returns body velocity and derivatives at an attitude and motor speeds.
    // Inlined, so that a caller of the velocity alone does not pay for its derivatives.
    #[inline(always)]
    pub fn body_velocity(&self, attitude: Attitude, motors: MotorSpeeds) -> Linearised {
        let (tau, sigma, eps) = (motors.traction_m_s, motors.steer_m_s, self.smoothing_m_s);
        let tau_root = (tau * tau + eps * eps).sqrt();
        let gain = self.vehicle.speed_max_m_s - (tau_root - eps);
        let (g, g_by_tau) = if gain > 0.0 {
            (gain, -tau / tau_root)
        } else {
            (0.0, 0.0)
        };
        let sigma_root = (sigma * sigma + eps * eps).sqrt();
        let s = sigma / sigma_root;
        let s_by_sigma = eps * eps / (sigma_root * sigma_root * sigma_root);

        let plus = self.side(1.0, attitude, g);
        let minus = self.side(-1.0, attitude, g);
        let (w_plus, w_minus) = (0.5 * (1.0 + s), 0.5 * (1.0 - s));
        let distance = ModelTerm::combine(w_plus, plus.distance, w_minus, minus.distance);
        let middle = ModelTerm::combine(w_plus, plus.middle, w_minus, minus.middle);
        let forward = ModelTerm::combine(w_plus, plus.forward, w_minus, minus.forward);
        let half_s = 0.5 * s_by_sigma;
        let distance_by_sigma = half_s * (plus.distance.value - minus.distance.value);
        let middle_by_sigma = half_s * (plus.middle.value - minus.middle.value);
        let forward_by_sigma = half_s * (plus.forward.value - minus.forward.value);

        let omega = 2.0 * sigma / distance.value;
        // Derivative of (v_x, v_y, omega) where distance, middle, forward and tau change.
        let total = |d: f64, m: f64, y: f64| {
            let omega_d = -omega / distance.value * d;
            Vector3::new(
                y * omega + forward.value * omega_d,
                -m * omega - middle.value * omega_d,
                omega_d,
            )
        };
        let by_gain = total(distance.by_gain, middle.by_gain, forward.by_gain);
        let omega_by_sigma = 2.0 / distance.value;
        let by_direction = total(distance_by_sigma, middle_by_sigma, forward_by_sigma);
        let by_turn = Vector3::new(
            forward.value * omega_by_sigma,
            -middle.value * omega_by_sigma,
            omega_by_sigma,
        );
        let icrik = Linearised {
            velocity: BodyVelocity {
                right_m_s: forward.value * omega,
                forward_m_s: tau - middle.value * omega,
                yaw_rate_rad_s: omega,
            },
            by_roll: total(distance.by_roll, middle.by_roll, forward.by_roll),
            by_pitch: total(distance.by_pitch, middle.by_pitch, forward.by_pitch),
            by_traction: by_gain * g_by_tau + Vector3::new(0.0, 1.0, 0.0),
            by_steer: by_direction + by_turn,
        };
        let added = self.extension.added(&icrik, attitude, motors, eps);
        let terms = Terms::at(attitude, sigma, eps);
        let learned = self.slip_gains * terms.value;
        Linearised {
            velocity: BodyVelocity {
                right_m_s: icrik.velocity.right_m_s + learned.x + added.velocity.right_m_s,
                forward_m_s: icrik.velocity.forward_m_s + learned.y + added.velocity.forward_m_s,
                yaw_rate_rad_s: omega + learned.z,
            },
            by_roll: icrik.by_roll + self.slip_gains * terms.by_roll + added.by_roll,
            by_pitch: icrik.by_pitch + self.slip_gains * terms.by_pitch + added.by_pitch,
            by_traction: icrik.by_traction + added.by_traction,
            by_steer: self.slip_gains * terms.by_steer + by_direction + by_turn + added.by_steer,
        }
    }

    /// Returns the ICRs of one turning direction: (5)-(7), (9), (10) and the limits.
    #[inline(always)]
    fn side(&self, sign: f64, attitude: Attitude, g: f64) -> TreadSide {
        let (alpha, phi) = (attitude.roll_rad, attitude.pitch_rad);
        let v = &self.vehicle;
        let (lambda_1, lambda_2) = (v.slide.shift_s_per_rad, v.slide.aggravated_s_per_rad);
        let k1 = sign * lambda_1;
        let mut left = ModelTerm {
            value: v.icrs.left_m + k1 * g * phi,
            by_roll: 0.0,
            by_pitch: k1 * g,
            by_gain: k1 * phi,
        };
        let mut right = ModelTerm {
            value: v.icrs.right_m + k1 * g * phi,
            ..left
        };
        let mut forward = ModelTerm {
            value: v.icrs.forward_m + k1 * g * alpha,
            by_roll: k1 * g,
            by_pitch: 0.0,
            by_gain: k1 * alpha,
        };
        let excess = phi.abs() - alpha.abs();
        if excess > 0.0 && lambda_2 != 0.0 {
            // (1 - |alpha/phi|) phi = sign(phi) (|phi| - |alpha|): no division.
            let outward = if sign * phi < 0.0 { -1.0 } else { 1.0 };
            let k2 = outward * lambda_2;
            let aggravated = if outward < 0.0 { &mut left } else { &mut right };
            aggravated.value += k2 * g * excess;
            aggravated.by_roll -= k2 * g * alpha.signum();
            aggravated.by_pitch += k2 * g * phi.signum();
            aggravated.by_gain += k2 * excess;
        }
        if left.value > -v.base_half_width_m {
            left = ModelTerm::constant(-v.base_half_width_m);
        }
        if right.value < v.base_half_width_m {
            right = ModelTerm::constant(v.base_half_width_m);
        }
        if forward.value.abs() > v.base_half_length_m {
            forward = ModelTerm::constant(forward.value.signum() * v.base_half_length_m);
        }
        TreadSide {
            distance: ModelTerm::combine(1.0, right, -1.0, left),
            middle: ModelTerm::combine(0.5, right, 0.5, left),
            forward,
        }
    }

    /// Returns the rate of (x, y, yaw) at heading `yaw_rad` on a plane with upward unit normal
    /// `normal_in_world`, see [`rate_on_plane`].
    pub fn rate_on_plane(
        &self,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
    ) -> LinearisedRate {
        rate_on_plane(normal_in_world, yaw_rad, |placed| {
            self.body_velocity(placed.attitude(), motors)
        })
    }

    /// Returns one step of `step_s` with constant motor speeds, see [`step_on_plane`].
    pub fn step_on_plane(
        &self,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
        step_s: f64,
    ) -> LinearisedStep {
        // Two calls with a closure each, so that both are inlined and the first only finds how the heading turns.
        let start = rate_on_plane(normal_in_world, yaw_rad, |placed| {
            self.body_velocity(placed.attitude(), motors)
        });
        let yaw_rad = yaw_rad + 0.5 * step_s * start.rate.z;
        let middle = rate_on_plane(normal_in_world, yaw_rad, |placed| {
            self.body_velocity(placed.attitude(), motors)
        });
        plane::midpoint_step(&start, &middle, step_s)
    }

    /// Returns the increment of such a step alone, see [`increment_on_plane`].
    pub fn increment_on_plane(
        &self,
        normal_in_world: &Vector3<f64>,
        yaw_rad: f64,
        motors: MotorSpeeds,
        step_s: f64,
    ) -> Vector3<f64> {
        increment_on_plane(normal_in_world, yaw_rad, step_s, |placed| {
            self.body_velocity(placed.attitude(), motors).velocity
        })
    }
}

mod plane;
#[cfg(test)]
mod tests;
