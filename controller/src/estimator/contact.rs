//! The balance of wheel friction with the physical parameters of a contact vehicle.

use super::contact_settings::ContactLearningSettings;
use super::estimate::ContactEstimate;
use super::learned::{Drift, LearnedModel, ModelVelocity, Moved, Moving, Prior};
use super::process_noise::ProcessNoise;
use super::settings::EstimatorSettings;
use nalgebra::SMatrix;
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

    fn forget_found(&mut self) {
        self.model.forget_found();
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
        let settled = ModelVelocity::from((predicted.linearised.velocity, predicted.by_parameters));
        let following = predicted.lag.over(time_s);
        let followed = following.from(&before.state, &settled.value);
        let mut by = following.along(&before.by_parameters, &settled.by_parameters);
        let lag_parameters = [Parameter::Inertia, Parameter::RelaxationLength];
        let by_lag = following.by_lag(&before.state, &settled.value, &followed.end);
        for (parameter, by_parameter) in lag_parameters.into_iter().zip(by_lag) {
            for (matrix, column) in [
                (&mut by.mean, by_parameter.mean),
                (&mut by.end.velocity, by_parameter.end.velocity),
                (&mut by.end.force, by_parameter.end.force),
            ] {
                let mut of_parameter = matrix.column_mut(parameter.index());
                of_parameter += column;
            }
        }
        Moved {
            settled,
            mean: ModelVelocity {
                value: followed.mean,
                by_parameters: by.mean,
            },
            end: Moving {
                state: followed.end,
                by_parameters: by.end,
            },
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
