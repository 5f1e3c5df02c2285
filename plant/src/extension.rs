//! Terms beyond ICRIK, each with a gain that is 0 unless a vehicle's file has it.
//!
//! With ICRIK's velocity (v_x, v_y, omega) of equations (4)-(10), traction tau, steer sigma, roll alpha
//! and pitch phi, the extended velocity is
//!
//! ```text
//! u_y   = v_y / (1 + b |omega|)                        forward speed that turning takes
//! v_x' = v_x + kappa omega u_y + (c |tau| + d m) alpha  slip outward in turns, creep downhill
//! v_y' = u_y                   - (c |tau| + d m) phi
//! ```
//!
//! where m is 1 for moving treads and 0 at standstill. The angular velocity is ICRIK's.
//!
//! - kappa, `outward_slip_s`: a vehicle that turns at speed is pushed outward by its inertia, and
//!   its wheels, which slip sideways anyway, give way. The same term is a y_ICR that moves ahead with
//!   speed.
//! - b, `turn_loss_s_per_rad`: a wheel whose friction is used up sideways transmits less thrust,
//!   so rolling resistance takes more of the speed. Without it c_l and c_r carry the loss of the
//!   mean turn, and are wrong straight ahead.
//! - c, `creep_per_rad`: a rolling tyre that carries a side force drifts by an angle, and slips
//!   lengthwise under a longitudinal one.
//! - d, `creep_m_s_per_rad`: creep of friction that gives way by a speed at any load, as regularised
//!   friction does: slip scale over coefficient of friction.
//!
//! None of this is in the paper. What supports each term in logs of real vehicles is in
//! docs/identification.md. Attitude enters linearly, as in equations (5)-(7): slopes to about 20 deg.

use crate::bounds::{Bounds, RangeError};
use crate::frames::{Attitude, BodyVelocity};
use crate::icr_parameters::{HorizontalIcrs, SlideGains};
use crate::linearised::Linearised;
use crate::speeds::{EncoderScale, MotorSpeeds, TreadSpeeds};
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};

/// Gains of the terms beyond ICRIK; all zero is ICRIK.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ExtensionGains {
    /// kappa, s: slip outward for each m/s of forward speed and rad/s of turn.
    pub outward_slip_s: f64,
    /// b, s/rad: loss of forward speed in turns.
    pub turn_loss_s_per_rad: f64,
    /// c, 1/rad: creep downhill as a share of the tread speed, for each rad of slope.
    pub creep_per_rad: f64,
    /// d, m/s/rad: creep downhill at any tread speed, for each rad of slope.
    pub creep_m_s_per_rad: f64,
}

/// The extended model of a vehicle: its gains, and the parameters that were identified with them.
///
/// Parameters of ICRHK and ICRIK carry on average what they have no term for. So the extended model has
/// its own, and those of the vehicle stay what they are in the paper's models.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Extension {
    /// Gains of the terms.
    pub gains: ExtensionGains,
    /// ICRs on level ground in the extended model.
    pub icrs: HorizontalIcrs,
    /// Slide gains in the extended model.
    pub slide: SlideGains,
    /// c_l and c_r in the extended model.
    pub encoder_scale: EncoderScale,
}

impl ExtensionGains {
    /// Returns the extended velocity for ICRIK's at the same attitude and tread speeds.
    pub fn extend(
        &self,
        icrik: BodyVelocity,
        attitude: Attitude,
        treads: TreadSpeeds,
    ) -> BodyVelocity {
        let motors = MotorSpeeds::from(treads);
        let moving = treads.left_m_s != 0.0 || treads.right_m_s != 0.0;
        let omega = icrik.yaw_rate_rad_s;
        let forward = icrik.forward_m_s / (1.0 + self.turn_loss_s_per_rad * omega.abs());
        let creep = self.creep_per_rad * motors.traction_m_s.abs()
            + if moving { self.creep_m_s_per_rad } else { 0.0 };
        BodyVelocity {
            right_m_s: icrik.right_m_s
                + self.outward_slip_s * omega * forward
                + creep * attitude.roll_rad,
            forward_m_s: forward - creep * attitude.pitch_rad,
            yaw_rate_rad_s: omega,
        }
    }

    /// Returns what the terms add to ICRIK's smoothed velocity, with derivatives; zeros without gains.
    ///
    /// |omega|, |tau| and m are rounded off within `smoothing_m_s` (eps): with s = sigma / sqrt(sigma^2 +
    /// eps^2), |omega| ~ s omega, |tau| ~ sqrt(tau^2 + eps^2) - eps and m ~ (tau^2 + sigma^2) / (tau^2 +
    /// sigma^2 + eps^2).
    // Inlined, so that a caller of the velocity alone does not pay for its derivatives.
    #[inline(always)]
    pub(crate) fn added(
        &self,
        icrik: &Linearised,
        attitude: Attitude,
        motors: MotorSpeeds,
        smoothing_m_s: f64,
    ) -> Linearised {
        let (tau, sigma, eps) = (motors.traction_m_s, motors.steer_m_s, smoothing_m_s);
        let (alpha, phi) = (attitude.roll_rad, attitude.pitch_rad);
        let (kappa, b) = (self.outward_slip_s, self.turn_loss_s_per_rad);
        let (v_y, omega) = (icrik.velocity.forward_m_s, icrik.velocity.yaw_rate_rad_s);
        let sigma_root = (sigma * sigma + eps * eps).sqrt();
        let (s, s_by_sigma) = (sigma / sigma_root, eps * eps / sigma_root.powi(3));
        let kept = 1.0 / (1.0 + b * s * omega);
        let u_y = v_y * kept;

        let tau_root = (tau * tau + eps * eps).sqrt();
        let square = tau * tau + sigma * sigma;
        let moving = square / (square + eps * eps);
        let moving_by_square = eps * eps / (square + eps * eps).powi(2);
        let creep = self.creep_per_rad * (tau_root - eps) + self.creep_m_s_per_rad * moving;
        let creep_by_tau = self.creep_per_rad * tau / tau_root
            + self.creep_m_s_per_rad * moving_by_square * 2.0 * tau;
        let creep_by_sigma = self.creep_m_s_per_rad * moving_by_square * 2.0 * sigma;

        // Derivative along a direction in which ICRIK's velocity, s, creep, roll and pitch change so.
        let along = |by: &Vector3<f64>, s_by, creep_by, alpha_by, phi_by| {
            let kept_by = -b * kept * kept * (s_by * omega + s * by.z);
            let u_y_by = by.y * kept + v_y * kept_by;
            Vector3::new(
                kappa * (by.z * u_y + omega * u_y_by) + creep_by * alpha + creep * alpha_by,
                u_y_by - by.y - creep_by * phi - creep * phi_by,
                0.0,
            )
        };
        Linearised {
            velocity: BodyVelocity {
                right_m_s: kappa * omega * u_y + creep * alpha,
                forward_m_s: u_y - v_y - creep * phi,
                yaw_rate_rad_s: 0.0,
            },
            by_roll: along(&icrik.by_roll, 0.0, 0.0, 1.0, 0.0),
            by_pitch: along(&icrik.by_pitch, 0.0, 0.0, 0.0, 1.0),
            by_traction: along(&icrik.by_traction, 0.0, creep_by_tau, 0.0, 0.0),
            by_steer: along(&icrik.by_steer, s_by_sigma, creep_by_sigma, 0.0, 0.0),
        }
    }
}

/// Key `extension` of a vehicle's YAML.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct RawExtension {
    /// Outward slip in turns, kappa.
    #[serde(default)]
    outward_slip_s: f64,
    /// Forward speed lost in turns, b.
    #[serde(default)]
    turn_loss_s_per_rad: f64,
    /// Downhill creep in proportion to speed, c.
    #[serde(default)]
    creep_per_rad: f64,
    /// Downhill creep at any speed, d.
    #[serde(default)]
    creep_m_s_per_rad: f64,
    /// Left tread ICR of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    x_icr_left_m: Option<f64>,
    /// Right tread ICR of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    x_icr_right_m: Option<f64>,
    /// Forward tread ICR of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    y_icr_m: Option<f64>,
    /// Slide gain of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lambda_1_s_per_rad: Option<f64>,
    /// Additional slide gain of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    lambda_2_s_per_rad: Option<f64>,
    /// Factor c_l of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    correction_left: Option<f64>,
    /// Factor c_r of the extended model.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    correction_right: Option<f64>,
}

impl RawExtension {
    /// Returns the extension of a vehicle with `own` parameters, which are in range, and a base of half
    /// width and half length `half_base_m`.
    pub(crate) fn checked(
        &self,
        own: &Extension,
        half_base_m: (f64, f64),
    ) -> Result<Extension, RangeError> {
        let icrs = &own.icrs;
        let (half_width, half_length) = half_base_m;
        let slide = Bounds::new(0.0, 100.0, "s/rad");
        let scale = Bounds::new(0.5, 2.0, "");
        Ok(Extension {
            gains: ExtensionGains {
                outward_slip_s: Bounds::new(0.0, 5.0, "s")
                    .check("extension.outward_slip_s", self.outward_slip_s)?,
                turn_loss_s_per_rad: Bounds::new(0.0, 10.0, "s/rad")
                    .check("extension.turn_loss_s_per_rad", self.turn_loss_s_per_rad)?,
                creep_per_rad: Bounds::new(0.0, 5.0, "1/rad")
                    .check("extension.creep_per_rad", self.creep_per_rad)?,
                creep_m_s_per_rad: Bounds::new(0.0, 5.0, "m/s/rad")
                    .check("extension.creep_m_s_per_rad", self.creep_m_s_per_rad)?,
            },
            icrs: HorizontalIcrs {
                left_m: Bounds::new(-50.0, -half_width, "m")
                    .with_note("at most -base_half_width_m")
                    .check(
                        "extension.x_icr_left_m",
                        self.x_icr_left_m.unwrap_or(icrs.left_m),
                    )?,
                right_m: Bounds::new(half_width, 50.0, "m")
                    .with_note("at least base_half_width_m")
                    .check(
                        "extension.x_icr_right_m",
                        self.x_icr_right_m.unwrap_or(icrs.right_m),
                    )?,
                forward_m: Bounds::new(-half_length, half_length, "m")
                    .with_note("within base_half_length_m")
                    .check("extension.y_icr_m", self.y_icr_m.unwrap_or(icrs.forward_m))?,
            },
            slide: SlideGains {
                shift_s_per_rad: slide.check(
                    "extension.lambda_1_s_per_rad",
                    self.lambda_1_s_per_rad.unwrap_or(own.slide.shift_s_per_rad),
                )?,
                aggravated_s_per_rad: slide.check(
                    "extension.lambda_2_s_per_rad",
                    self.lambda_2_s_per_rad
                        .unwrap_or(own.slide.aggravated_s_per_rad),
                )?,
            },
            encoder_scale: EncoderScale {
                left: scale.check(
                    "extension.correction_left",
                    self.correction_left.unwrap_or(own.encoder_scale.left),
                )?,
                right: scale.check(
                    "extension.correction_right",
                    self.correction_right.unwrap_or(own.encoder_scale.right),
                )?,
            },
        })
    }
}

impl From<Extension> for RawExtension {
    fn from(extension: Extension) -> Self {
        let Extension {
            gains,
            icrs,
            slide,
            encoder_scale,
        } = extension;
        Self {
            outward_slip_s: gains.outward_slip_s,
            turn_loss_s_per_rad: gains.turn_loss_s_per_rad,
            creep_per_rad: gains.creep_per_rad,
            creep_m_s_per_rad: gains.creep_m_s_per_rad,
            x_icr_left_m: Some(icrs.left_m),
            x_icr_right_m: Some(icrs.right_m),
            y_icr_m: Some(icrs.forward_m),
            lambda_1_s_per_rad: Some(slide.shift_s_per_rad),
            lambda_2_s_per_rad: Some(slide.aggravated_s_per_rad),
            correction_left: Some(encoder_scale.left),
            correction_right: Some(encoder_scale.right),
        }
    }
}

#[cfg(test)]
mod tests;
