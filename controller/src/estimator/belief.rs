//! Belief of the filter: mean and covariance of pose and parameters, moved on in time and corrected by poses.

use super::gains::InitialParameters;
use super::gate::PoseSigmas;
use super::gyro::{
    BIAS_WALK_RAD_S_PER_SQRT_S, GyroInterval, HOLDS_S, INTERVAL_MIN_S, TurnReading, YawRate,
};
use super::learned::{Drift, LearnedModel, Moved, Moving, Prior};
use super::pose_noise::PoseNoise;
use super::process_noise::ProcessNoise;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use sidehill_plant::frames::{Attitude, BodyVelocity, PlanarPose, pose_rate, wrap_angle};
use sidehill_plant::speeds::TreadSpeeds;

/// Entries of the first block of a belief: the pose, the gyroscope's bias, the offset of the poses' headings, and the
/// error of the gyroscope's scale.
pub(super) const STATES: usize = 6;
/// Entry of the gyroscope's bias.
const BIAS: usize = 3;
/// Entry of the offset of the poses' headings.
const OFFSET: usize = 4;
/// Entry of the error of the gyroscope's scale.
const SCALE: usize = 5;

/// Standard deviation of the offset of the poses' headings before anything is known, rad.
pub(super) const OFFSET_SIGMA_RAD: f64 = 0.02;
/// Standard deviation of the error of the gyroscope's scale before anything is known.
pub(super) const SCALE_SIGMA: f64 = 0.02;

/// Mean and covariance of pose and parameters, in blocks, and the inputs in force.
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief<const N: usize> {
    /// Pose (x, y, yaw), the bias of the gyroscope, rad/s, by how much the headings of poses are larger than that of
    /// the vehicle, rad, and the share by which the gyroscope reads more than it turns.
    pub(super) mean: SVector<f64, STATES>,
    pub(super) covariance: SMatrix<f64, STATES, STATES>,
    pub(super) parameters: SVector<f64, N>,
    /// Of the first block with the parameters.
    pub(super) cross: SMatrix<f64, STATES, N>,
    pub(super) parameter_covariance: SMatrix<f64, N, N>,
    pub(super) treads: TreadSpeeds,
    pub(super) attitude: Attitude,
    /// Newest reading of the gyroscope.
    pub(super) yaw_rate: Option<YawRate>,
    /// How far the vehicle has turned by the gyroscope with its bias, and by the model where that read nothing, rad.
    pub(super) gyro_turned_rad: f64,
    /// How the body moves by the model, whatever the gyroscope reads.
    pub(super) moving: Moving<N>,
    /// How far inertia and tyres keep the yaw rate from that of steady motion, rad/s, and the derivatives by the parameters.
    pub(super) yaw_rate_behind: (f64, SVector<f64, N>),
    /// The model's body velocity (right, forward, yaw rate) as a vehicle has it that follows it with a lag.
    pub(super) late: Vector3<f64>,
    /// Rate at which the covariance of the pose has grown since the reading before, in 1/s.
    pub(super) growth: Matrix3<f64>,
    /// How noisy poses have been.
    pub(super) pose_noise: PoseNoise,
}

impl<const N: usize> Belief<N> {
    /// Returns the belief with which the filter starts at a pose.
    pub(super) fn at(
        pose: &PlanarPose,
        sigmas: &PoseSigmas,
        bias_sigma_rad_s: f64,
        kept: InitialParameters<N>,
        treads: TreadSpeeds,
        attitude: Attitude,
        moving: Moving<N>,
    ) -> Self {
        let mut covariance = SMatrix::<f64, STATES, STATES>::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&sigmas.covariance());
        covariance[(BIAS, BIAS)] = bias_sigma_rad_s.powi(2);
        // The heading is that of the pose less the offset.
        let offset = OFFSET_SIGMA_RAD.powi(2);
        covariance[(2, 2)] += offset;
        covariance[(OFFSET, OFFSET)] = offset;
        covariance[(2, OFFSET)] = -offset;
        covariance[(OFFSET, 2)] = -offset;
        covariance[(SCALE, SCALE)] = SCALE_SIGMA.powi(2);
        Self {
            mean: vector(pose).push(0.0).push(0.0).push(0.0),
            covariance,
            parameters: kept.mean,
            cross: SMatrix::zeros(),
            parameter_covariance: kept.covariance,
            treads,
            attitude,
            yaw_rate: None,
            gyro_turned_rad: 0.0,
            moving,
            yaw_rate_behind: (0.0, SVector::zeros()),
            late: Vector3::zeros(),
            growth: Matrix3::zeros(),
            pose_noise: PoseNoise::new(sigmas),
        }
    }

    /// Returns the mean of the pose.
    pub(super) fn pose(&self) -> Vector3<f64> {
        self.mean.xyz()
    }

    /// Returns the covariance of the pose.
    pub(super) fn pose_covariance(&self) -> Matrix3<f64> {
        self.covariance.fixed_view::<3, 3>(0, 0).into_owned()
    }

    /// Returns the bias of the gyroscope, rad/s.
    pub(super) fn gyro_bias_rad_s(&self) -> f64 {
        self.mean[BIAS]
    }

    /// Returns the covariance of a pose as it would be read, less its noise.
    pub(super) fn read_covariance(&self) -> Matrix3<f64> {
        let of_read = self.with_read();
        let mut covariance = of_read.fixed_rows::<3>(0).into_owned();
        let offset = of_read.row(OFFSET).into_owned();
        let mut heading = covariance.row_mut(2);
        heading += offset;
        covariance
    }

    /// Returns the covariance of the first block with a pose as it would be read, P H' with H = (1 0 0 e_3).
    fn with_read(&self) -> SMatrix<f64, STATES, 3> {
        let mut with = self.covariance.fixed_columns::<3>(0).into_owned();
        let offset = self.covariance.column(OFFSET).into_owned();
        let mut heading = with.column_mut(2);
        heading += offset;
        with
    }

    /// Returns how far the vehicle has turned by a pose and by the gyroscope.
    pub(super) fn turn(&self, time_s: f64, pose: &PlanarPose) -> TurnReading {
        TurnReading {
            time_s,
            heading_rad: pose.yaw_rad,
            gyro_rad: self.gyro_turned_rad,
        }
    }

    /// Forgets the gyroscope's bias and scale and, with them, what was learned since `kept`.
    pub(super) fn forget_gyro(&mut self, bias_sigma_rad_s: f64, kept: InitialParameters<N>) {
        for (entry, sigma) in [(BIAS, bias_sigma_rad_s), (SCALE, SCALE_SIGMA)] {
            self.mean[entry] = 0.0;
            self.covariance.row_mut(entry).fill(0.0);
            self.covariance.column_mut(entry).fill(0.0);
            self.covariance[(entry, entry)] = sigma.powi(2);
        }
        self.cross.fill(0.0);
        self.parameters = kept.mean;
        self.parameter_covariance = kept.covariance;
    }

    /// Returns a pose that was read less the mean.
    pub(super) fn off(&self, pose: &PlanarPose) -> Vector3<f64> {
        let mut difference = vector(pose) - self.pose();
        difference.z = wrap_angle(difference.z - self.mean[OFFSET]);
        difference
    }

    /// Returns the belief `time_s` later: equation (12) by the midpoint rule, and its covariance.
    /// `noise_factor` is a factor on the variance by which `noise` grows in steady motion. The heading follows
    /// the gyroscope while that is confirmed, otherwise the model.
    pub(super) fn propagated<M: LearnedModel<N>>(
        &self,
        model: &mut M,
        noise: &ProcessNoise,
        noise_factor: f64,
        time_s: f64,
        gyro: Option<GyroInterval>,
    ) -> Self {
        if time_s <= 0.0 {
            return *self;
        }
        let mut moved = model.moved(
            self.attitude,
            self.treads,
            &self.parameters,
            &self.moving,
            time_s,
        );
        let now = moved.mean.value;
        let yaw_rate_behind = yaw_rate_behind(&moved);
        let confirmed = gyro.filter(|gyro| gyro.confirmed);
        let follows_gyro = confirmed.is_some();
        if let Some(gyro) = confirmed {
            moved.mean.value.z = (gyro.rad_s - self.mean[BIAS]) / (1.0 + self.mean[SCALE]);
            moved.mean.by_parameters.row_mut(2).fill(0.0);
        }
        let velocity = BodyVelocity::from_vector(&moved.mean.value);
        let yaw = self.mean.z;
        let start = pose_rate(&velocity, &self.attitude, yaw);
        let half_way = yaw + 0.5 * time_s * start.yaw_rad_s;
        let middle = pose_rate(&velocity, &self.attitude, half_way);
        let mut next = *self;
        next.gyro_turned_rad += time_s * gyro.map_or(now.z, |gyro| gyro.rad_s);
        let mut pose = next.mean.fixed_rows_mut::<3>(0);
        pose += time_s * Vector3::new(middle.x_m_s, middle.y_m_s, middle.yaw_rad_s);
        let mut by_state = SMatrix::<f64, STATES, STATES>::identity();
        by_state[(0, 2)] = -time_s * middle.y_m_s;
        by_state[(1, 2)] = time_s * middle.x_m_s;
        if follows_gyro {
            let share = 1.0 / (1.0 + self.mean[SCALE]);
            by_state[(2, BIAS)] = -time_s * share;
            by_state[(2, SCALE)] = -time_s * share * moved.mean.value.z;
        }
        let (sin, cos) = half_way.sin_cos();
        let to_world = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let mut by_parameters = SMatrix::<f64, STATES, N>::zeros();
        by_parameters
            .fixed_rows_mut::<3>(0)
            .copy_from(&(time_s * (to_world * moved.mean.by_parameters)));
        let share = self.noise_share() * noise_factor;
        next.moving = moved.end;
        next.yaw_rate_behind = yaw_rate_behind;
        let missing = now - self.late;
        next.late = noise.followed(&self.late, &missing, time_s);
        let mut growth = SMatrix::<f64, STATES, STATES>::zeros();
        growth
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&noise.covariance(time_s, share, &missing, &to_world));
        if follows_gyro {
            growth[(2, 2)] = time_s * noise.gyro.powi(2);
        }
        growth[(BIAS, BIAS)] = time_s * BIAS_WALK_RAD_S_PER_SQRT_S.powi(2);
        let noise = growth;
        let through = by_parameters * self.parameter_covariance;
        let crossed = by_state * self.cross * by_parameters.transpose();
        next.covariance = by_state * self.covariance * by_state.transpose()
            + crossed
            + crossed.transpose()
            + through * by_parameters.transpose()
            + noise;
        next.growth = (next.pose_covariance() - self.pose_covariance()) / time_s;
        next.cross = by_state * self.cross + through;
        let drift = model.drift(self.treads, time_s);
        next.drift(&drift, &model.prior());
        next
    }

    /// Updates with a pose: `difference` is pose less mean, `inverse` that of S, the covariance of what is read and `noise`.
    ///
    /// With K = P H' S^-1 the whole of P becomes (1 - K H) P (1 - K H)' + K R K', Joseph's form, which keeps it
    /// symmetric and positive however the numbers are rounded.
    pub(super) fn correct(
        &mut self,
        difference: &Vector3<f64>,
        noise: &Matrix3<f64>,
        inverse: &Matrix3<f64>,
    ) {
        let with_read = self.with_read();
        let mut read_cross = self.cross.fixed_rows::<3>(0).into_owned();
        let offset = self.cross.row(OFFSET).into_owned();
        let mut heading = read_cross.row_mut(2);
        heading += offset;
        let gain = with_read * inverse;
        let learning = read_cross.transpose() * inverse;
        self.mean += gain * difference;
        self.learn(learning * difference);
        let mut rest = SMatrix::<f64, STATES, STATES>::identity();
        let mut of_pose = rest.fixed_columns_mut::<3>(0);
        of_pose -= gain;
        let mut of_offset = rest.column_mut(OFFSET);
        of_offset -= gain.column(2);
        let told = learning * read_cross;
        let parameters = self.parameter_covariance - told - told.transpose()
            + learning * (self.read_covariance() + noise) * learning.transpose();
        self.parameter_covariance = 0.5 * (parameters + parameters.transpose());
        self.cross = rest * (self.cross - with_read * learning.transpose())
            + gain * noise * learning.transpose();
        self.covariance =
            rest * self.covariance * rest.transpose() + gain * noise * gain.transpose();
    }

    /// Updates with a reading of the gyroscope: the yaw rate w of the model, scaled and with the bias, and with the model's
    /// error since the reading before. One that is off by more than `gate` (normalised, squared) teaches nothing.
    ///
    /// With H = (0 0 0 1 0 w (1 + scale) dw/dp) and S = H P H' + R the whole of P becomes P - (P H') (P H')' / S.
    pub(super) fn correct_yaw_rate<M: LearnedModel<N>>(
        &mut self,
        model: &mut M,
        noise: &ProcessNoise,
        noise_factor: f64,
        read: YawRate,
        gate: f64,
    ) {
        let since_s = self
            .yaw_rate
            .map_or(HOLDS_S, |before| read.time_s - before.time_s);
        let (settled, by_settled) = model.velocity(self.attitude, self.treads, &self.parameters);
        let (behind_rad_s, by_behind) = self.yaw_rate_behind;
        let yaw_rate_rad_s = settled.yaw_rate_rad_s + behind_rad_s;
        let scale = 1.0 + self.mean[SCALE];
        let by = scale * (by_settled.row(2).transpose() + by_behind);
        let missing_rad_s = yaw_rate_rad_s - self.late.z;
        let noise_rad_s = noise.yaw_rate(
            since_s.clamp(INTERVAL_MIN_S, HOLDS_S),
            self.noise_share() * noise_factor,
            missing_rad_s,
        );
        let mut by_state = SVector::<f64, STATES>::zeros();
        (by_state[BIAS], by_state[SCALE]) = (1.0, yaw_rate_rad_s);
        let of_pose = self.covariance * by_state + self.cross * by;
        let of_parameters = self.cross.transpose() * by_state + self.parameter_covariance * by;
        let total = by_state.dot(&of_pose) + by.dot(&of_parameters) + noise_rad_s;
        let difference = read.rad_s - self.mean[BIAS] - scale * yaw_rate_rad_s;
        if difference.powi(2) > gate * total {
            return;
        }
        self.mean += of_pose * (difference / total);
        self.learn(of_parameters * (difference / total));
        self.covariance -= of_pose * of_pose.transpose() / total;
        self.cross -= of_pose * of_parameters.transpose() / total;
        self.parameter_covariance -= of_parameters * of_parameters.transpose() / total;
    }

    /// Changes the parameters, and how the body moves with them.
    fn learn(&mut self, change: SVector<f64, N>) {
        self.parameters += change;
        let Moving {
            state,
            by_parameters,
        } = &mut self.moving;
        state.velocity += by_parameters.velocity * change;
        state.force += by_parameters.force * change;
    }

    /// Returns the share of the growth of uncertainty: a vehicle that stands does not slide; a tenth of the
    /// standard deviation keeps the filter open to poses.
    fn noise_share(&self) -> f64 {
        if self.treads.left_m_s != 0.0 || self.treads.right_m_s != 0.0 {
            1.0
        } else {
            0.01
        }
    }

    /// Lets the parameters drift towards their prior and in their own right.
    fn drift(&mut self, drift: &Drift<N>, prior: &Prior<N>) {
        for i in 0..N {
            let keep = drift.keep[i];
            if keep != 1.0 {
                self.parameters[i] = prior.mean[i] + keep * (self.parameters[i] - prior.mean[i]);
                self.cross.column_mut(i).scale_mut(keep);
                self.parameter_covariance.column_mut(i).scale_mut(keep);
                self.parameter_covariance.row_mut(i).scale_mut(keep);
            }
            self.parameter_covariance[(i, i)] += drift.variance[i];
        }
    }
}

/// Returns how far the yaw rate at the end of a motion is from that of steady motion, rad/s, and the derivatives by the
/// parameters.
fn yaw_rate_behind<const N: usize>(moved: &Moved<N>) -> (f64, SVector<f64, N>) {
    let (end, settled) = (&moved.end, &moved.settled);
    let by_parameters = end.by_parameters.velocity.row(2) - settled.by_parameters.row(2);
    (
        end.state.velocity.z - settled.value.z,
        by_parameters.transpose(),
    )
}

pub(super) fn vector(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}
