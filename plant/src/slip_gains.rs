//! A correction of ICRIK that is linear in its gains, to be learned while driving.
//!
//! Friction in proportion to load (Coulomb) makes the velocity a vehicle gains on a slope proportional
//! to the turn and, to first order, linear in the in-plane part of gravity, that is in roll alpha and
//! pitch phi. With sigma the steer speed there are three such terms in each of v_x, v_y and omega:
//!
//! ```text
//! dv = c sigma  +  S (alpha, phi) |sigma|  +  L (alpha, phi) sigma
//! ```
//!
//! c shifts the ICRs (x, y and distance), S slides downhill, L shifts the ICRs with the load that a
//! slope moves from wheel to wheel. ICRIK holds a part of S (lambda_1, lambda_2) and nothing of L.

use crate::frames::Attitude;
use nalgebra::{SMatrix, SVector};

/// Terms of each velocity: sigma, |sigma| alpha, |sigma| phi, sigma alpha, sigma phi.
pub const TERMS: usize = 5;

/// Gains of the terms (columns) in v_x, v_y and omega_z (rows); SI units with rad.
pub type SlipGains = SMatrix<f64, 3, TERMS>;

/// The terms at an attitude and steer speed, and their derivatives.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// The terms.
    pub value: SVector<f64, TERMS>,
    /// By steer.
    pub by_steer: SVector<f64, TERMS>,
    /// By roll.
    pub by_roll: SVector<f64, TERMS>,
    /// By pitch.
    pub by_pitch: SVector<f64, TERMS>,
}

impl Terms {
    /// Returns the terms with |sigma| rounded off within `smoothing_m_s` (positive):
    /// |sigma| ~ sigma^2 / sqrt(sigma^2 + eps^2).
    pub fn at(attitude: Attitude, steer_m_s: f64, smoothing_m_s: f64) -> Self {
        let (alpha, phi, sigma) = (attitude.roll_rad, attitude.pitch_rad, steer_m_s);
        let root = (sigma * sigma + smoothing_m_s * smoothing_m_s).sqrt();
        let magnitude = sigma * sigma / root;
        let magnitude_by_sigma = sigma / root * (2.0 - (sigma / root).powi(2));
        Self {
            value: SVector::from([
                sigma,
                magnitude * alpha,
                magnitude * phi,
                sigma * alpha,
                sigma * phi,
            ]),
            by_steer: SVector::from([
                1.0,
                magnitude_by_sigma * alpha,
                magnitude_by_sigma * phi,
                alpha,
                phi,
            ]),
            by_roll: SVector::from([0.0, magnitude, 0.0, sigma, 0.0]),
            by_pitch: SVector::from([0.0, 0.0, magnitude, 0.0, sigma]),
        }
    }
}
