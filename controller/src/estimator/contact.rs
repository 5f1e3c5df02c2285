//! The balance of wheel friction with the physical parameters of a contact vehicle.

use super::contact_settings::ContactLearningSettings;
use super::estimate::ContactEstimate;
use super::learned::{Drift, LearnedModel, Moved, Moving, Prior};
use super::process_noise::ProcessNoise;
use super::settings::EstimatorSettings;
use nalgebra::{Matrix3, SMatrix, Vector3};
use sidehill_plant::contact::{ContactPrediction, PARAMETERS, Parameter, ParameterVector};
use sidehill_plant::frames::{Attitude, BodyVelocity};
use sidehill_plant::slip_gains::SlipGains;
use sidehill_plant::speeds::{EncoderScale, MotorSpeeds, TreadSpeeds};
use sidehill_plant::vehicle::Vehicle;

/// A contact vehicle and how far its parameters may be from what is known.
#[derive(Debug, Clone)]
pub(super) struct LearnedContact {
    model: ContactPrediction,
    encoder_scale: EncoderScale,
    settings: ContactLearningSettings,
    prior: Prior<PARAMETERS>,
}

impl LearnedContact {
    pub(super) fn new(
        vehicle: &Vehicle,
        model: ContactPrediction,
        settings: ContactLearningSettings,
    ) -> Self {
        let prior = Prior {
            mean: *model.parameters(),
            sigma: settings.sigma(vehicle, model.parameters()),
        };
        Self {
            model,
            encoder_scale: vehicle.encoder_scale,
            settings,
            prior,
        }
    }
}

impl LearnedModel<PARAMETERS> for LearnedContact {
    fn prior(&self) -> Prior<PARAMETERS> {
        self.prior
    }

    fn velocity(
        &mut self,
        attitude: Attitude,
        treads: TreadSpeeds,
        parameters: &ParameterVector,
    ) -> (BodyVelocity, SMatrix<f64, 3, PARAMETERS>) {
        self.model.set_parameters(parameters);
        let predicted = self.model.predict(attitude, MotorSpeeds::from(treads));
        (predicted.linearised.velocity, predicted.by_parameters)
    }

    fn moved(
        &mut self,
        attitude: Attitude,
        treads: TreadSpeeds,
        parameters: &ParameterVector,
        before: &Moving<PARAMETERS>,
        time_s: f64,
    ) -> Moved<PARAMETERS> {
        self.model.set_parameters(parameters);
        let predicted = self.model.predict(attitude, MotorSpeeds::from(treads));
        let settled = predicted.linearised.velocity.vector();
        let following = predicted.lag.over(time_s);
        let followed = following.from(&before.velocity, &settled);
        let by_inertia = following.by_inertia(&before.velocity, &settled);
        let (of_mean, of_end) = following.by_before();
        let moving = |velocity, left: Matrix3<f64>, by_inertia: &Vector3<f64>| {
            let by_settled = predicted.by_parameters;
            let mut by_parameters = by_settled + left * (before.by_parameters - by_settled);
            let mut column = by_parameters.column_mut(Parameter::Inertia.index());
            column += by_inertia;
            Moving {
                velocity,
                by_parameters,
            }
        };
        Moved {
            settled: Moving {
                velocity: settled,
                by_parameters: predicted.by_parameters,
            },
            mean: moving(followed.mean, of_mean, &by_inertia.mean),
            end: moving(followed.end, of_end, &by_inertia.end),
        }
    }

    fn encoder_scale(&self) -> EncoderScale {
        self.encoder_scale
    }

    fn process_noise(&self, settings: &EstimatorSettings) -> ProcessNoise {
        ProcessNoise {
            slide: self.settings.slide_sigma_m_per_sqrt_s,
            turn: self.settings.yaw_sigma_rad_per_sqrt_s,
            gyro: settings.gyro_sigma_rad_per_sqrt_s,
            shown: settings.gyro_model_sigma_rad_per_sqrt_s,
            lag_s: self.settings.lag_s,
        }
    }

    /// Each parameter is a Gauss-Markov process of the metres steered, a tread's factor of the metres driven, friction of
    /// both, whose spread is its prior's: a parameter that is no longer excited returns to its prior, and no
    /// interval grows beyond that.
    fn drift(&self, treads: TreadSpeeds, time_s: f64) -> Drift<PARAMETERS> {
        let steer_m_s = MotorSpeeds::from(treads).steer_m_s;
        let steered_m = time_s * steer_m_s.abs();
        let driven_m = time_s * treads.left_m_s.abs().max(treads.right_m_s.abs());
        let forget = ParameterVector::from_fn(|i, _| {
            let share = match Parameter::ALL[i] {
                Parameter::LeftTread | Parameter::RightTread => {
                    driven_m * self.settings.tread_forgetting_per_m
                }
                Parameter::Friction => {
                    steered_m * self.settings.forgetting_per_m
                        + driven_m * self.settings.friction_forgetting_per_m
                }
                _ => steered_m * self.settings.forgetting_per_m,
            };
            share.min(0.1)
        });
        let prior_variance = self.prior.sigma.component_mul(&self.prior.sigma);
        Drift {
            keep: forget.map(|share| (1.0 - share).sqrt()),
            variance: forget.component_mul(&prior_variance),
        }
    }

    fn bound(&self, parameters: &mut ParameterVector, attitude: &Attitude) {
        *parameters = self.model.holding(parameters, attitude);
    }

    fn slip_gains(&self, _parameters: &ParameterVector) -> SlipGains {
        SlipGains::zeros()
    }

    fn contact(
        &self,
        parameters: &ParameterVector,
        covariance: &SMatrix<f64, PARAMETERS, PARAMETERS>,
    ) -> Option<ContactEstimate> {
        Some(ContactEstimate {
            parameters: *parameters,
            sigma: covariance.diagonal().map(f64::sqrt),
            prior_sigma: self.prior.sigma,
        })
    }
}
