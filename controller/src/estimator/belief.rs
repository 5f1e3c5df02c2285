//! Belief of the filter: mean and covariance of pose and parameters, moved on in time and corrected by poses.

use super::gains::Kept;
use super::gate::PoseSigmas;
use super::learned::{Drift, LearnedModel, Prior};
use super::process_noise::ProcessNoise;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use sidehill_plant::frames::{Attitude, PlanarPose, pose_rate, wrap_angle};
use sidehill_plant::speeds::TreadSpeeds;

/// Mean and covariance of pose and parameters, in blocks, and the inputs in force.
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief<const N: usize> {
    pub(super) mean: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    pub(super) parameters: SVector<f64, N>,
    /// Of the pose with the parameters.
    pub(super) cross: SMatrix<f64, 3, N>,
    pub(super) parameter_covariance: SMatrix<f64, N, N>,
    pub(super) treads: TreadSpeeds,
    pub(super) attitude: Attitude,
    /// The model's body velocity (right, forward, yaw rate) as a vehicle has it that follows it with a lag.
    pub(super) late: Vector3<f64>,
}

impl<const N: usize> Belief<N> {
    /// Returns the belief with which the filter starts at a pose.
    pub(super) fn at(
        pose: &PlanarPose,
        sigmas: &PoseSigmas,
        kept: Kept<N>,
        treads: TreadSpeeds,
        attitude: Attitude,
    ) -> Self {
        Self {
            mean: vector(pose),
            covariance: sigmas.covariance(),
            parameters: kept.mean,
            cross: SMatrix::zeros(),
            parameter_covariance: kept.covariance,
            treads,
            attitude,
            late: Vector3::zeros(),
        }
    }

    /// Returns a pose less the mean.
    pub(super) fn off(&self, pose: &PlanarPose) -> Vector3<f64> {
        let mut difference = vector(pose) - self.mean;
        difference.z = wrap_angle(difference.z);
        difference
    }

    /// Returns the belief `time_s` later: equation (12) by the midpoint rule, and its covariance.
    /// `noise_factor` is a factor on the variance by which `noise` grows in steady motion.
    pub(super) fn propagated<M: LearnedModel<N>>(
        &self,
        model: &M,
        noise: &ProcessNoise,
        noise_factor: f64,
        time_s: f64,
    ) -> Self {
        if time_s <= 0.0 {
            return *self;
        }
        let (velocity, by_parameters) =
            model.velocity(self.attitude, self.treads, &self.parameters);
        let yaw = self.mean.z;
        let start = pose_rate(&velocity, &self.attitude, yaw);
        let half_way = yaw + 0.5 * time_s * start.yaw_rad_s;
        let middle = pose_rate(&velocity, &self.attitude, half_way);
        let mut next = *self;
        next.mean += time_s * Vector3::new(middle.x_m_s, middle.y_m_s, middle.yaw_rad_s);
        let mut by_state = Matrix3::identity();
        by_state[(0, 2)] = -time_s * middle.y_m_s;
        by_state[(1, 2)] = time_s * middle.x_m_s;
        let (sin, cos) = half_way.sin_cos();
        let to_world = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let by_parameters = time_s * (to_world * by_parameters);
        let moving = self.treads.left_m_s != 0.0 || self.treads.right_m_s != 0.0;
        // A vehicle that stands does not slide; a tenth keeps the filter open to poses.
        let share = if moving { 1.0 } else { 0.01 } * noise_factor;
        let now = Vector3::new(
            velocity.right_m_s,
            velocity.forward_m_s,
            velocity.yaw_rate_rad_s,
        );
        let missing = now - self.late;
        next.late = noise.followed(&self.late, &missing, time_s);
        let noise = noise.covariance(time_s, share, &missing, &to_world);
        let through = by_parameters * self.parameter_covariance;
        let crossed = by_state * self.cross * by_parameters.transpose();
        next.covariance = by_state * self.covariance * by_state.transpose()
            + crossed
            + crossed.transpose()
            + through * by_parameters.transpose()
            + noise;
        next.cross = by_state * self.cross + through;
        let drift = model.drift(self.treads, time_s);
        next.drift(&drift, &model.prior());
        next
    }

    /// Updates with a pose: `difference` is pose less mean, `inverse` that of covariance and `noise`.
    ///
    /// With H = (1 0), K = P H' S^-1, the whole of P becomes (1 - K H) P (1 - K H)' + K R K', Joseph's form,
    /// which keeps it symmetric and positive however the numbers are rounded.
    pub(super) fn correct(
        &mut self,
        difference: &Vector3<f64>,
        noise: &Matrix3<f64>,
        inverse: &Matrix3<f64>,
    ) {
        let gain = self.covariance * inverse;
        let learning = self.cross.transpose() * inverse;
        self.mean += gain * difference;
        self.parameters += learning * difference;
        let rest = Matrix3::identity() - gain;
        let told = learning * self.cross;
        let parameters = self.parameter_covariance - told - told.transpose()
            + learning * (self.covariance + noise) * learning.transpose();
        self.parameter_covariance = 0.5 * (parameters + parameters.transpose());
        self.cross = rest * (self.cross - self.covariance * learning.transpose())
            + gain * noise * learning.transpose();
        self.covariance =
            rest * self.covariance * rest.transpose() + gain * noise * gain.transpose();
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

pub(super) fn vector(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}
