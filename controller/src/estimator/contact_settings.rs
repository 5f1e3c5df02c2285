//! How far a contact vehicle may differ from its configuration.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::contact::{Parameter, ParameterVector};
use sidehill_plant::vehicle::Vehicle;

/// How far a contact vehicle may differ from its configuration, and how fast what was learned is forgotten.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ContactLearningSettings {
    /// Growth of the position's uncertainty while moving, m/sqrt(s), besides that of the parameters.
    #[serde(skip)]
    pub slide_sigma_m_per_sqrt_s: f64,
    /// Growth of the heading's uncertainty while moving, rad/sqrt(s), besides that of the parameters.
    #[serde(skip)]
    pub yaw_sigma_rad_per_sqrt_s: f64,
    /// Lag with which the vehicle may follow a change of the model's velocity in addition to its inertia, s: tyres build up
    /// their force. Until it has passed poses count for more, and teach less.
    #[serde(skip)]
    pub lag_s: f64,
    /// Factor on all standard deviations below; 0 switches learning off.
    #[serde(skip)]
    pub prior_factor: f64,
    /// Standard deviation of the logarithm of friction.
    #[serde(skip)]
    pub friction_sigma: f64,
    /// Standard deviation of the centre of mass sideways and upwards, over the half width.
    #[serde(skip)]
    pub centre_right_sigma: f64,
    /// Standard deviation of the centre of mass lengthways, over the half length.
    #[serde(skip)]
    pub centre_forward_sigma: f64,
    /// Standard deviation of the centre of mass upwards, over the half width.
    #[serde(skip)]
    pub centre_height_sigma: f64,
    /// Standard deviation of the inner axles' share of the weight.
    #[serde(skip)]
    pub inner_share_sigma: f64,
    /// Standard deviation of the logarithm of an inner axle's stiffness over that of an outer one.
    #[serde(skip)]
    pub inner_stiffness_sigma: f64,
    /// Standard deviation of the logarithm of the lateral share of friction.
    #[serde(skip)]
    pub lateral_share_sigma: f64,
    /// Standard deviation of the logarithm of the slip scale.
    #[serde(skip)]
    pub slip_scale_sigma: f64,
    /// Standard deviation of the rolling resistance.
    #[serde(skip)]
    pub rolling_resistance_sigma: f64,
    /// Standard deviation of the square of a contact patch's radius of gyration, over that of the half width.
    #[serde(skip)]
    pub patch_squared_sigma: f64,
    /// Standard deviation of the inertia, over itself; a vehicle that is known to have none has none.
    #[serde(skip)]
    pub inertia_sigma: f64,
    /// Standard deviation of the logarithm of the tyres' relaxation length; a vehicle that is known to have no inertia has
    /// none.
    #[serde(skip)]
    pub relaxation_length_sigma: f64,
    /// Standard deviation of the logarithm of each tread's factor.
    #[serde(skip)]
    pub tread_sigma: f64,
    /// Share of a prior variance that comes back for each metre of steering, 1/m.
    #[serde(skip)]
    pub forgetting_per_m: f64,
    /// Share of the way back to the configured friction, per metre driven: friction changes from place to place.
    pub friction_forgetting_per_m: f64,
    /// The same of the treads' factors for each metre driven, 1/m.
    #[serde(skip)]
    pub tread_forgetting_per_m: f64,
}

impl Default for ContactLearningSettings {
    fn default() -> Self {
        Self {
            slide_sigma_m_per_sqrt_s: 0.0005,
            yaw_sigma_rad_per_sqrt_s: 0.005,
            lag_s: 0.1,
            prior_factor: 1.0,
            friction_sigma: 0.3,
            centre_right_sigma: 0.17,
            centre_forward_sigma: 0.14,
            centre_height_sigma: 0.17,
            inner_share_sigma: 0.15,
            inner_stiffness_sigma: 0.7,
            lateral_share_sigma: 0.2,
            slip_scale_sigma: 0.7,
            rolling_resistance_sigma: 0.02,
            patch_squared_sigma: 0.02,
            inertia_sigma: 0.3,
            relaxation_length_sigma: 1.0,
            tread_sigma: 0.07,
            forgetting_per_m: 0.01,
            friction_forgetting_per_m: 0.2,
            tread_forgetting_per_m: 0.002,
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
        Bounds::new(0.0, 10.0, "").check(
            "estimator.contact.friction_forgetting_per_m",
            self.friction_forgetting_per_m,
        )?;
        Ok(())
    }

    /// Returns the standard deviations of the entries of a vehicle's parameters.
    pub(super) fn sigma(&self, vehicle: &Vehicle, parameters: &ParameterVector) -> ParameterVector {
        let (half_width_m, half_length_m) = (vehicle.base_half_width_m, vehicle.base_half_length_m);
        self.prior_factor
            * ParameterVector::from_fn(|i, _| match Parameter::ALL[i] {
                Parameter::Friction => self.friction_sigma,
                Parameter::CentreRight => self.centre_right_sigma * half_width_m,
                Parameter::CentreForward => self.centre_forward_sigma * half_length_m,
                Parameter::CentreHeight => self.centre_height_sigma * half_width_m,
                Parameter::InnerShare => self.inner_share_sigma,
                Parameter::InnerStiffness => self.inner_stiffness_sigma,
                Parameter::LateralShare => self.lateral_share_sigma,
                Parameter::SlipScale => self.slip_scale_sigma,
                Parameter::RollingResistance => self.rolling_resistance_sigma,
                Parameter::PatchRadius => self.patch_squared_sigma * half_width_m * half_width_m,
                Parameter::Inertia => self.inertia_sigma * parameters[i],
                Parameter::RelaxationLength if parameters[Parameter::Inertia.index()] == 0.0 => 0.0,
                Parameter::RelaxationLength => self.relaxation_length_sigma,
                Parameter::LeftTread | Parameter::RightTread => self.tread_sigma,
            })
    }
}
