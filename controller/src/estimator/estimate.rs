//! Output of the estimator: the state, the gains that control uses, and what was wrong with the readings.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use sidehill_plant::contact::{Parameter, ParameterVector};
use sidehill_plant::frames::{Attitude, BodyVelocity, PlanarPose};
use sidehill_plant::slip_gains::SlipGains;
use sidehill_plant::speeds::TreadSpeeds;

/// Which readings of a sample were not finite and so were not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Refused {
    /// The tread speeds.
    pub tread_speeds: bool,
    /// Roll or pitch.
    pub attitude: bool,
    /// The yaw rate.
    pub yaw_rate: bool,
    /// The pose.
    pub pose: bool,
}

impl Refused {
    /// Returns whether any reading was refused.
    pub fn any(&self) -> bool {
        self.tread_speeds || self.attitude || self.yaw_rate || self.pose
    }
}

/// State of the vehicle at the time of a cycle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Estimate {
    /// Instant it holds for, s.
    pub time_s: f64,
    /// Position and heading.
    pub pose: PlanarPose,
    /// Covariance of (x, y, yaw), m^2, m rad and rad^2.
    #[serde(with = "crate::serde_form::rows")]
    pub covariance: Matrix3<f64>,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Upward unit normal of the ground under the vehicle, world frame.
    #[serde(with = "crate::serde_form::entries")]
    pub normal_in_world: Vector3<f64>,
    /// Effective tread speeds, after (11).
    pub treads: TreadSpeeds,
    /// Body velocity by the model, whatever a gyroscope reads: that corrects what is learned.
    #[serde(default)]
    pub velocity: BodyVelocity,
    /// Forces of the tyres out of balance, see [`BodyState`](sidehill_plant::contact::BodyState); zero where the model has no
    /// inertia.
    #[serde(default, with = "crate::serde_form::entries")]
    pub tyre_force: Vector3<f64>,
    /// Learned slip gains, see [`sidehill_plant::slip_gains`]; rows v_x, v_y, omega_z. Zero where they
    /// are not what is learned.
    #[serde(with = "crate::serde_form::rows")]
    pub slip_gains: SlipGains,
    /// Learned contact vehicle, where that is what is learned.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contact: Option<ContactEstimate>,
    /// Bias of the gyroscope, rad/s; none where there is no reading or poses contradict it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gyro_bias_rad_s: Option<f64>,
    /// Root mean square of the error of the predicted velocity over the last seconds, m/s.
    pub model_error_m_s: f64,
    /// Standard deviation of the noise of positions as they show it, at first that of the settings, m.
    #[serde(default)]
    pub pose_noise_m: f64,
    /// Age of the newest accepted pose, s.
    #[serde(with = "crate::serde_form::age")]
    pub pose_age_s: f64,
    /// Age of the newest attitude, s.
    #[serde(with = "crate::serde_form::age")]
    pub attitude_age_s: f64,
    /// Age of the newest tread speeds, s.
    #[serde(with = "crate::serde_form::age")]
    pub speeds_age_s: f64,
    /// Poses rejected by the gate since the last accepted one.
    pub poses_gated: u32,
    /// Poses that came too late to have an effect, more than 1.5 s, since the last accepted one.
    #[serde(default)]
    pub poses_late: u32,
    /// For how long poses that agree with each other have been rejected, and the age of the newest of
    /// them, s; none if the newest pose was accepted.
    pub poses_doubted_s: Option<(f64, f64)>,
}

/// Largest share of the model's own yaw rate that a learned correction may take or add: a vehicle
/// whose treads spin turns less than it will with grip again, but never against its treads.
const YAW_CORRECTION_MAX: f64 = 0.6;

/// Distances from the path, m, beyond which the learned slide is reduced, and at which it is zero. The
/// turn back to the path is unlike those that the slide was learned from, and a slide overestimated for
/// that turn would keep the vehicle off the path.
const SLIDE_DOUBTED_M: (f64, f64) = (0.1, 0.5);

impl Estimate {
    /// Returns the estimate of a vehicle that stands on level ground and is certain of its pose, by readings of that
    /// instant.
    pub fn standing(time_s: f64, pose: PlanarPose) -> Self {
        Self {
            time_s,
            pose,
            covariance: Matrix3::zeros(),
            attitude: Attitude::LEVEL,
            normal_in_world: Vector3::z(),
            treads: TreadSpeeds::default(),
            velocity: BodyVelocity::default(),
            tyre_force: Vector3::zeros(),
            slip_gains: SlipGains::zeros(),
            contact: None,
            gyro_bias_rad_s: None,
            model_error_m_s: 0.0,
            pose_noise_m: 0.0,
            pose_age_s: 0.0,
            attitude_age_s: 0.0,
            speeds_age_s: 0.0,
            poses_gated: 0,
            poses_late: 0,
            poses_doubted_s: None,
        }
    }

    /// Returns the bound that the position across a heading keeps with a probability of 95 %, m.
    pub fn bound_across_m(&self, heading_rad: f64) -> f64 {
        let (sin, cos) = heading_rad.sin_cos();
        let covariance = &self.covariance;
        let variance = cos * cos * covariance[(0, 0)]
            + 2.0 * sin * cos * covariance[(0, 1)]
            + sin * sin * covariance[(1, 1)];
        bound_of_m(variance)
    }

    /// Returns the learned gains as control uses them, `off_path_m` from the path: those of the yaw
    /// rate made smaller, all by one factor, where on this slope they could change the yaw rate of a
    /// vehicle of half effective track `half_track_m` by more than 60 % at some heading; those of the
    /// slide as they are up to 0.1 m from the path, and less beyond, to nothing at 0.5 m.
    pub fn bounded_gains(&self, half_track_m: f64, off_path_m: f64) -> SlipGains {
        let normal = &self.normal_in_world;
        let slope_rad = normal.x.hypot(normal.y).atan2(normal.z);
        let mut gains = self.slip_gains;
        let mut yaw = gains.row_mut(2);
        let largest_per_m =
            yaw[0].abs() + slope_rad * (yaw[1].hypot(yaw[2]) + yaw[3].hypot(yaw[4]));
        yaw *= (YAW_CORRECTION_MAX / (half_track_m * largest_per_m)).min(1.0);
        let mut slide = gains.fixed_rows_mut::<2>(0);
        slide *= slide_share(off_path_m);
        gains
    }
}

/// Returns the bound that a position of this variance, m^2, keeps with a probability of 95 %, m.
pub(crate) fn bound_of_m(variance_m2: f64) -> f64 {
    /// Standard deviations on either side.
    const SIGMAS: f64 = 1.96;
    SIGMAS * variance_m2.max(0.0).sqrt()
}

/// Returns the share with which a learned slide counts for a vehicle `off_path_m` from the path.
pub(crate) fn slide_share(off_path_m: f64) -> f64 {
    let (near_m, far_m) = SLIDE_DOUBTED_M;
    ((far_m - off_path_m.abs()) / (far_m - near_m)).clamp(0.0, 1.0)
}

/// A difference between a pose and the prediction at its time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Innovation {
    /// Instant of the pose, s.
    pub time_s: f64,
    /// Pose less prediction, (x, y, yaw) in the world, m and rad.
    pub difference: Vector3<f64>,
    /// Normalised innovation squared.
    pub normalised: f64,
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
    /// Returns whether poses have informed a parameter: its interval is narrower than its prior's
    /// by at least a tenth. What the drive has not excited is not observed, and stays near its prior.
    pub fn observed(&self, parameter: Parameter) -> bool {
        let i = parameter.index();
        self.sigma[i] < 0.9 * self.prior_sigma[i]
    }

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
