//! ICRIK with the gains of its correction.

use super::learned::{Drift, LearnedModel, Prior};
use super::process_noise::ProcessNoise;
use super::{AdaptationSettings, ContactEstimate, EstimatorSettings};
use nalgebra::{SMatrix, SVector};
use sidehill_plant::frames::{Attitude, BodyVelocity};
use sidehill_plant::slip_gains::{SlipGains, TERMS, Terms};
use sidehill_plant::speeds::{EncoderScale, MotorSpeeds, TreadSpeeds};
use sidehill_plant::vehicle::Vehicle;

/// Gains of the correction, row by row of [`SlipGains`].
pub(super) const GAINS: usize = 3 * TERMS;

/// Speed within which |steer| is rounded off in the terms, m/s.
pub(crate) const SLIP_SMOOTHING_M_S: f64 = 0.02;

/// ICRIK of a vehicle, and how far its correction may be from nothing.
#[derive(Debug, Clone)]
pub(super) struct SlipModel {
    vehicle: Vehicle,
    forgetting_per_m: f64,
    prior: Prior<GAINS>,
}

impl SlipModel {
    pub(super) fn new(vehicle: Vehicle, settings: AdaptationSettings) -> Self {
        let sigma = SVector::from_fn(|i, _| {
            if i % TERMS == 0 {
                settings.shift_sigma
            } else {
                settings.slope_sigma
            }
        });
        Self {
            vehicle,
            forgetting_per_m: settings.forgetting_per_m,
            prior: Prior {
                mean: SVector::zeros(),
                sigma,
            },
        }
    }
}

impl LearnedModel<GAINS> for SlipModel {
    fn prior(&self) -> Prior<GAINS> {
        self.prior
    }

    fn velocity(
        &mut self,
        attitude: Attitude,
        treads: TreadSpeeds,
        parameters: &SVector<f64, GAINS>,
    ) -> (BodyVelocity, SMatrix<f64, 3, GAINS>) {
        let motors = MotorSpeeds::from(treads);
        let terms = Terms::at(attitude, motors.steer_m_s, SLIP_SMOOTHING_M_S).value;
        let learned = self.slip_gains(parameters) * terms;
        let mut velocity = self.vehicle.extended_velocity(attitude, treads);
        velocity.right_m_s += learned.x;
        velocity.forward_m_s += learned.y;
        velocity.yaw_rate_rad_s += learned.z;
        let mut by_gains = SMatrix::zeros();
        for (k, term) in terms.iter().enumerate() {
            for row in 0..3 {
                by_gains[(row, row * TERMS + k)] = *term;
            }
        }
        (velocity, by_gains)
    }

    fn encoder_scale(&self) -> EncoderScale {
        self.vehicle.encoder_scale
    }

    fn process_noise(&self, settings: &EstimatorSettings) -> ProcessNoise {
        ProcessNoise {
            slide: settings.slide_sigma_m_per_sqrt_s,
            turn: settings.yaw_sigma_rad_per_sqrt_s,
            gyro: settings.gyro_sigma_rad_per_sqrt_s,
            shown: settings.gyro_model_sigma_rad_per_sqrt_s,
            lag_s: 0.0,
        }
    }

    /// Uncertainty grows with each metre of steering; the gains themselves stay.
    fn drift(&self, treads: TreadSpeeds, time_s: f64) -> Drift<GAINS> {
        let steer_m_s = MotorSpeeds::from(treads).steer_m_s;
        let forget = (time_s * steer_m_s.abs() * self.forgetting_per_m).min(0.1);
        Drift {
            keep: SVector::repeat(1.0),
            variance: forget * self.prior.sigma.component_mul(&self.prior.sigma),
        }
    }

    fn bound(&self, _parameters: &mut SVector<f64, GAINS>, _attitude: &Attitude) {}

    fn slip_gains(&self, parameters: &SVector<f64, GAINS>) -> SlipGains {
        SlipGains::from_row_slice(parameters.as_slice())
    }

    fn contact(
        &self,
        _parameters: &SVector<f64, GAINS>,
        _covariance: &SMatrix<f64, GAINS, GAINS>,
    ) -> Option<ContactEstimate> {
        None
    }
}
