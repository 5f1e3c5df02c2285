//! The balance of wheel friction with the physical parameters of a contact vehicle.

use super::EstimatorSettings;
use super::learned::{Drift, LearnedModel, Prior};
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::contact::{ContactPrediction, PARAMETERS, Parameter, ParameterVector};
use sidehill_plant::frames::{Attitude, BodyVelocity};
use sidehill_plant::slip_gains::SlipGains;
use sidehill_plant::speeds::{EncoderScale, MotorSpeeds, TreadSpeeds};
use sidehill_plant::vehicle::Vehicle;

/// How far a contact vehicle may be from what is known of it, and how fast what was learned is given up.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContactLearningSettings {
    /// Growth of the position's uncertainty while moving, m/sqrt(s), besides that of the parameters.
    pub slide_sigma_m_per_sqrt_s: f64,
    /// Growth of the heading's uncertainty while moving, rad/sqrt(s), besides that of the parameters.
    pub yaw_sigma_rad_per_sqrt_s: f64,
    /// Factor on all standard deviations below; 0 switches learning off.
    pub prior_factor: f64,
    /// Standard deviation of the logarithm of friction.
    pub friction_sigma: f64,
    /// Standard deviation of the centre of mass sideways and upwards, over the half width.
    pub centre_right_sigma: f64,
    /// Standard deviation of the centre of mass lengthways, over the half length.
    pub centre_forward_sigma: f64,
    /// Standard deviation of the centre of mass upwards, over the half width.
    pub centre_height_sigma: f64,
    /// Standard deviation of the inner axles' share of the weight.
    pub inner_share_sigma: f64,
    /// Standard deviation of the logarithm of the lateral share of friction.
    pub lateral_share_sigma: f64,
    /// Standard deviation of the logarithm of the slip scale.
    pub slip_scale_sigma: f64,
    /// Standard deviation of the rolling resistance.
    pub rolling_resistance_sigma: f64,
    /// Share of a prior variance that comes back for each metre of steering, 1/m.
    pub forgetting_per_m: f64,
}

impl Default for ContactLearningSettings {
    fn default() -> Self {
        Self {
            slide_sigma_m_per_sqrt_s: 0.005,
            yaw_sigma_rad_per_sqrt_s: 0.005,
            prior_factor: 1.0,
            friction_sigma: 0.3,
            centre_right_sigma: 0.17,
            centre_forward_sigma: 0.14,
            centre_height_sigma: 0.17,
            inner_share_sigma: 0.15,
            lateral_share_sigma: 0.2,
            slip_scale_sigma: 0.5,
            rolling_resistance_sigma: 0.02,
            forgetting_per_m: 0.01,
        }
    }
}

impl ContactLearningSettings {
    /// Returns whether anything is learned.
    pub fn is_on(&self) -> bool {
        self.prior_factor > 0.0
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let noise = Bounds::new(1e-6, 10.0, "");
        noise.check(
            "estimator.contact.slide_sigma_m_per_sqrt_s",
            self.slide_sigma_m_per_sqrt_s,
        )?;
        noise.check(
            "estimator.contact.yaw_sigma_rad_per_sqrt_s",
            self.yaw_sigma_rad_per_sqrt_s,
        )?;
        for (key, value) in [
            ("estimator.contact.prior_factor", self.prior_factor),
            ("estimator.contact.friction_sigma", self.friction_sigma),
            (
                "estimator.contact.centre_right_sigma",
                self.centre_right_sigma,
            ),
            (
                "estimator.contact.centre_forward_sigma",
                self.centre_forward_sigma,
            ),
            (
                "estimator.contact.centre_height_sigma",
                self.centre_height_sigma,
            ),
            (
                "estimator.contact.inner_share_sigma",
                self.inner_share_sigma,
            ),
            (
                "estimator.contact.lateral_share_sigma",
                self.lateral_share_sigma,
            ),
            ("estimator.contact.slip_scale_sigma", self.slip_scale_sigma),
            (
                "estimator.contact.rolling_resistance_sigma",
                self.rolling_resistance_sigma,
            ),
            ("estimator.contact.forgetting_per_m", self.forgetting_per_m),
        ] {
            Bounds::new(0.0, 10.0, "").check(key, value)?;
        }
        Ok(())
    }

    fn sigma(&self, half_width_m: f64, half_length_m: f64) -> ParameterVector {
        self.prior_factor
            * ParameterVector::from_fn(|i, _| match Parameter::ALL[i] {
                Parameter::Friction => self.friction_sigma,
                Parameter::CentreRight => self.centre_right_sigma * half_width_m,
                Parameter::CentreForward => self.centre_forward_sigma * half_length_m,
                Parameter::CentreHeight => self.centre_height_sigma * half_width_m,
                Parameter::InnerShare => self.inner_share_sigma,
                Parameter::LateralShare => self.lateral_share_sigma,
                Parameter::SlipScale => self.slip_scale_sigma,
                Parameter::RollingResistance => self.rolling_resistance_sigma,
            })
    }
}

/// What has been learned of a contact vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContactEstimate {
    /// Its parameters.
    #[serde(with = "crate::serde_form::rows")]
    pub parameters: ParameterVector,
    /// Their standard deviations.
    #[serde(with = "crate::serde_form::rows")]
    pub sigma: ParameterVector,
    /// Their standard deviations before anything was learned: what stays there was not excited.
    #[serde(with = "crate::serde_form::rows")]
    pub prior_sigma: ParameterVector,
}

impl ContactEstimate {
    /// Returns value and 95 % interval of a parameter in its own unit.
    pub fn interval(&self, parameter: Parameter) -> (f64, (f64, f64)) {
        /// Standard deviations on either side.
        const WIDTH: f64 = 1.96;
        let i = parameter.index();
        let at = |entry: f64| parameter.value(entry);
        let half = WIDTH * self.sigma[i];
        (
            at(self.parameters[i]),
            (at(self.parameters[i] - half), at(self.parameters[i] + half)),
        )
    }
}

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
            sigma: settings.sigma(vehicle.base_half_width_m, vehicle.base_half_length_m),
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
        &self,
        attitude: Attitude,
        treads: TreadSpeeds,
        parameters: &ParameterVector,
    ) -> (BodyVelocity, SMatrix<f64, 3, PARAMETERS>) {
        let mut model = self.model.clone();
        model.set_parameters(parameters);
        let predicted = model.predict(attitude, MotorSpeeds::from(treads));
        (predicted.linearised.velocity, predicted.by_parameters)
    }

    fn encoder_scale(&self) -> EncoderScale {
        self.encoder_scale
    }

    fn process_noise(&self, _settings: &EstimatorSettings) -> (f64, f64) {
        (
            self.settings.slide_sigma_m_per_sqrt_s,
            self.settings.yaw_sigma_rad_per_sqrt_s,
        )
    }

    /// Each parameter is a Gauss-Markov process of the metres steered whose spread is its prior's: what
    /// is no longer excited returns to its prior, and no interval grows beyond it.
    fn drift(&self, treads: TreadSpeeds, time_s: f64) -> Drift<PARAMETERS> {
        let steer_m_s = MotorSpeeds::from(treads).steer_m_s;
        let forget = (time_s * steer_m_s.abs() * self.settings.forgetting_per_m).min(0.1);
        Drift {
            keep: SVector::repeat((1.0 - forget).sqrt()),
            variance: forget * self.prior.sigma.component_mul(&self.prior.sigma),
        }
    }

    fn bound(&self, parameters: &mut ParameterVector) {
        *parameters = self.model.within_ranges(parameters);
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
