//! Settings of the estimator and of what it learns.

use super::ContactLearningSettings;
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// Settings of the estimator.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimatorSettings {
    /// Standard deviation of a pose's position: until poses show theirs, which counts from half to ten times this.
    pub pose_sigma_m: f64,
    /// Standard deviation of a pose's heading; likewise.
    pub pose_sigma_rad: f64,
    /// Growth of the position's uncertainty while moving.
    pub slide_sigma_m_per_sqrt_s: f64,
    /// Growth of the heading's uncertainty while moving.
    pub yaw_sigma_rad_per_sqrt_s: f64,
    /// Growth of the heading's uncertainty while it follows a gyroscope, rad/sqrt(s): noise and errors of its scale.
    #[serde(skip)]
    pub gyro_sigma_rad_per_sqrt_s: f64,
    /// Growth of the heading's uncertainty by the model, against which a gyroscope's readings teach, rad/sqrt(s): larger
    /// than that between poses, because inertia and patches of ground last for several readings.
    #[serde(skip)]
    pub gyro_model_sigma_rad_per_sqrt_s: f64,
    /// Standard deviation of the gyroscope's bias before anything is known, rad/s.
    #[serde(skip)]
    pub gyro_bias_sigma_rad_s: f64,
    /// Largest normalised innovation squared (3 degrees of freedom) of an accepted pose.
    pub gate: f64,
    /// Time after which rejected poses that agree with each other are accepted, s; until then the vehicle
    /// is slowed down.
    #[serde(skip)]
    pub believed_after_s: f64,
    /// Time over which the error of the model's velocity is averaged, s.
    #[serde(skip)]
    pub error_averaging_s: f64,
    /// [Online learning](#adaptation) of slip gains.
    pub adaptation: AdaptationSettings,
    /// [Learning of a contact vehicle](#contact-learning), in place of slip gains.
    pub contact: ContactLearningSettings,
    /// Time constant of the smoothing of the ground's normal in the world frame; 0 for none.
    pub normal_filter_s: f64,
}

impl Default for EstimatorSettings {
    fn default() -> Self {
        Self {
            pose_sigma_m: 0.01,
            pose_sigma_rad: 0.0087,
            slide_sigma_m_per_sqrt_s: 0.02,
            yaw_sigma_rad_per_sqrt_s: 0.02,
            gyro_sigma_rad_per_sqrt_s: 0.001,
            gyro_model_sigma_rad_per_sqrt_s: 0.02,
            gyro_bias_sigma_rad_s: 0.02,
            gate: 100.0,
            believed_after_s: 1.0,
            error_averaging_s: 3.0,
            adaptation: AdaptationSettings::default(),
            contact: ContactLearningSettings::default(),
            normal_filter_s: 0.5,
        }
    }
}

/// How far the correction may be from zero.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AdaptationSettings {
    /// Standard deviation of the gains of the steer speed itself (shift of the ICRs): of v_x and v_y
    /// without unit, of the yaw rate in rad/m. 0 switches them off.
    #[serde(skip)]
    pub shift_sigma: f64,
    /// Prior standard deviation of the gains of slide and load shift, in 1/rad and 1/m. 0 turns them off.
    pub slope_sigma: f64,
    /// Share of these variances that is restored per metre of steering: how fast old values are forgotten.
    pub forgetting_per_m: f64,
    /// Whether icrhk-mpc also learns the ICRs of its model; this does not improve its tracking.
    #[serde(skip)]
    pub of_icrhk: bool,
}

impl Default for AdaptationSettings {
    fn default() -> Self {
        Self {
            shift_sigma: 0.05,
            slope_sigma: 0.4,
            forgetting_per_m: 0.05,
            of_icrhk: false,
        }
    }
}

impl AdaptationSettings {
    /// Returns whether anything is learned.
    pub fn is_on(&self) -> bool {
        self.shift_sigma > 0.0 || self.slope_sigma > 0.0
    }
}

impl EstimatorSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let positive = |key, value| Bounds::new(1e-6, 10.0, "").check(key, value);
        positive("estimator.pose_sigma_m", self.pose_sigma_m)?;
        positive("estimator.pose_sigma_rad", self.pose_sigma_rad)?;
        positive(
            "estimator.slide_sigma_m_per_sqrt_s",
            self.slide_sigma_m_per_sqrt_s,
        )?;
        positive(
            "estimator.yaw_sigma_rad_per_sqrt_s",
            self.yaw_sigma_rad_per_sqrt_s,
        )?;
        Bounds::new(1.0, 1e6, "").check("estimator.gate", self.gate)?;
        let gain = |key, value| Bounds::new(0.0, 10.0, "").check(key, value);
        gain(
            "estimator.adaptation.slope_sigma",
            self.adaptation.slope_sigma,
        )?;
        gain(
            "estimator.adaptation.forgetting_per_m",
            self.adaptation.forgetting_per_m,
        )?;
        self.contact.validate()?;
        Bounds::new(0.0, 60.0, "s").check("estimator.normal_filter_s", self.normal_filter_s)?;
        Ok(())
    }
}
