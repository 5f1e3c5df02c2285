//! An extended Kalman filter over pose and parameters of a model, generic over the model.
//!
//! Readings are kept in the order of their stamps for a while. Those of a cycle are put in their places, then all
//! from the first that changes is replayed.

mod keeping;
mod replaying;

use super::belief::{Belief, vector};
use super::gains::InitialParameters;
use super::gate::{PoseGate, PoseSigmas, RefusedPose};
use super::gyro::{GyroCheck, HOLDS_S};
use super::learned::LearnedModel;
use super::model_error::ModelError;
use super::{Estimate, EstimatorSettings, Innovation, Refused};
use nalgebra::{Matrix3, Vector3};
use sidehill_plant::frames::{Attitude, BodyVelocity, PlanarPose};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::TreadSpeeds;
use std::collections::VecDeque;

/// Readings of a cycle at most.
const NEW: usize = 4;

/// Time for which readings are kept, s: poses that are later have no effect.
pub(crate) const HISTORY_S: f64 = 1.5;
/// Readings kept at most: those of the time at 100 Hz.
pub(super) const HISTORY: usize = 600;

/// What an event brings.
#[derive(Debug, Clone, Copy)]
enum Reading {
    Speeds(TreadSpeeds),
    Attitude(Attitude),
    YawRate(f64),
    Pose(PlanarPose),
}

/// A reading at its time, and the filter's state after it.
#[derive(Debug, Clone, Copy)]
struct Event<const N: usize> {
    time_s: f64,
    reading: Reading,
    /// Whether it is of this cycle.
    new: bool,
    /// Covariance added to the prediction's before a pose that is accepted although it contradicts it.
    inflation: Option<Matrix3<f64>>,
    belief: Belief<N>,
}

/// The filter and its recent readings.
#[derive(Clone)]
pub(super) struct Filter<M, const N: usize> {
    settings: EstimatorSettings,
    model: M,
    /// Newest last; never longer than [`HISTORY`] after a cycle.
    events: VecDeque<Event<N>>,
    /// First event that is to be replayed; their number where none is.
    changed: usize,
    started: bool,
    /// Newest readings, with which the filter starts.
    newest_attitude: Option<Attitude>,
    newest_treads: TreadSpeeds,
    normal_in_world: Option<(f64, Vector3<f64>)>,
    pose_time_s: f64,
    attitude_time_s: f64,
    speeds_time_s: f64,
    poses_gated: u32,
    poses_late: u32,
    gate: PoseGate,
    gyro: GyroCheck,
    innovation: Option<Innovation>,
    growth: Matrix3<f64>,
    model_error: ModelError,
    keeps: bool,
    kept: Option<InitialParameters<N>>,
}

impl<M: LearnedModel<N>, const N: usize> Filter<M, N> {
    /// Returns a filter without any reading; `model` gives its dead reckoning.
    pub(super) fn new(settings: EstimatorSettings, model: M) -> Self {
        Self {
            settings,
            model,
            events: VecDeque::with_capacity(HISTORY + NEW),
            changed: 0,
            started: false,
            newest_attitude: None,
            newest_treads: TreadSpeeds::default(),
            normal_in_world: None,
            pose_time_s: f64::NEG_INFINITY,
            attitude_time_s: f64::NEG_INFINITY,
            speeds_time_s: f64::NEG_INFINITY,
            poses_gated: 0,
            poses_late: 0,
            gate: PoseGate::new(settings.believed_after_s),
            gyro: GyroCheck::new(&settings),
            innovation: None,
            growth: Matrix3::zeros(),
            model_error: ModelError::default(),
            keeps: false,
            kept: None,
        }
    }

    /// Returns how many readings are kept.
    #[cfg(test)]
    pub(super) fn readings_kept(&self) -> usize {
        self.events.len()
    }

    /// Returns the belief after the newest reading.
    #[cfg(test)]
    pub(super) fn newest(&self) -> Option<&Belief<N>> {
        self.events.back().map(|event| &event.belief)
    }

    /// Returns the innovation of the newest pose of the last update, accepted or not.
    pub(super) fn innovation(&self) -> Option<Innovation> {
        self.innovation
    }

    /// Returns the rate at which the covariance of (x, y, yaw) grows at the time of the last update, poses aside.
    pub(super) fn growth(&self) -> &Matrix3<f64> {
        &self.growth
    }

    /// Takes a cycle's readings and returns the state at the cycle's time, or `None` until a first
    /// attitude and a first pose have arrived. Readings that are not finite are left out and named; one stamped
    /// ahead of the cycle counts as read in it, so that it ages like any other.
    pub(super) fn update(&mut self, sample: &Sample) -> (Option<Estimate>, Refused) {
        self.innovation = None;
        let mut refused = Refused::default();
        let read_s = |stamp_s: f64| {
            let is_ahead = stamp_s.is_finite() && stamp_s > sample.time_s;
            if is_ahead { sample.time_s } else { stamp_s }
        };
        if let Some(mut speeds) = sample.tread_speeds {
            speeds.time_s = read_s(speeds.time_s);
            if speeds.time_s.is_finite()
                && speeds.value.left_m_s.is_finite()
                && speeds.value.right_m_s.is_finite()
            {
                self.speeds_time_s = self.speeds_time_s.max(speeds.time_s);
                let treads = self.model.encoder_scale().apply(speeds.value);
                self.newest_treads = treads;
                self.insert(speeds.time_s, Reading::Speeds(treads));
            } else {
                refused.tread_speeds = true;
            }
        }
        if let Some(mut attitude) = sample.attitude {
            attitude.time_s = read_s(attitude.time_s);
            if attitude.time_s.is_finite() && attitude.value.is_finite() {
                self.attitude_time_s = self.attitude_time_s.max(attitude.time_s);
                self.newest_attitude = Some(attitude.value);
                self.insert(attitude.time_s, Reading::Attitude(attitude.value));
            } else {
                refused.attitude = true;
            }
        }
        if let Some(mut yaw_rate) = sample.yaw_rate {
            yaw_rate.time_s = read_s(yaw_rate.time_s);
            if yaw_rate.time_s.is_finite() && yaw_rate.value.is_finite() {
                self.insert(yaw_rate.time_s, Reading::YawRate(yaw_rate.value));
            } else {
                refused.yaw_rate = true;
            }
        }
        if let Some(pose) = sample.pose {
            let planar = pose.value.planar();
            if pose.time_s.is_finite()
                && planar.x_m.is_finite()
                && planar.y_m.is_finite()
                && planar.yaw_rad.is_finite()
            {
                self.take_pose(Stamped {
                    time_s: read_s(pose.time_s),
                    value: planar,
                });
            } else {
                refused.pose = true;
            }
        }
        self.replay();
        (self.estimate(sample.time_s), refused)
    }

    /// Returns what is known of the parameters before the first reading.
    fn begins_with(&self) -> InitialParameters<N> {
        let prior = self.model.prior();
        self.kept.unwrap_or(InitialParameters {
            mean: prior.mean,
            covariance: prior.covariance(),
        })
    }

    fn take_pose(&mut self, pose: Stamped<PlanarPose>) {
        if self.started {
            if !self.insert(pose.time_s, Reading::Pose(pose.value)) {
                self.poses_late += 1;
            }
        } else if let Some(attitude) = self.newest_attitude {
            let sigmas = PoseSigmas::of(&self.settings);
            let kept = self.begins_with();
            let settled = self
                .model
                .velocity(attitude, self.newest_treads, &kept.mean);
            self.started = true;
            self.pose_time_s = pose.time_s;
            self.events.clear();
            self.changed = 1;
            self.events.push_back(Event {
                time_s: pose.time_s,
                reading: Reading::Attitude(attitude),
                new: false,
                inflation: None,
                belief: Belief::at(
                    &pose.value,
                    &sigmas,
                    self.settings.gyro_bias_sigma_rad_s,
                    kept,
                    self.newest_treads,
                    attitude,
                    settled.into(),
                ),
            });
        }
    }

    /// Compares the turn at a new pose, which has been judged, with that of the gyroscope.
    fn confirm_gyro(&mut self, predicted: &mut Belief<N>, time_s: f64, pose: &PlanarPose) {
        let reads = predicted
            .yaw_rate
            .is_some_and(|read| time_s - read.time_s <= HOLDS_S);
        if !reads {
            self.gyro.interrupt();
        } else if self
            .gyro
            .observe(predicted.turn(time_s, pose), self.gate.doubted().is_none())
        {
            let sigma_rad_s = self.settings.gyro_bias_sigma_rad_s;
            predicted.forget_gyro(sigma_rad_s, self.begins_with());
        }
    }

    /// Returns the covariance with which a new pose passes that is accepted against the prediction.
    fn judge(
        &mut self,
        predicted: &Belief<N>,
        time_s: f64,
        pose: &PlanarPose,
    ) -> Option<Matrix3<f64>> {
        let (sigmas, gate) = (PoseSigmas::of(&self.settings), self.settings.gate);
        let difference = predicted.off(pose);
        let inverse = (predicted.read_covariance() + sigmas.covariance()).try_inverse()?;
        let normalised = (difference.transpose() * inverse * difference).x;
        if normalised <= gate {
            self.gate.passed(time_s, normalised / gate);
            return None;
        }
        let prior = self.model.prior().mean;
        let (unlearned, _) = self
            .model
            .velocity(predicted.attitude, predicted.treads, &prior);
        let refused = RefusedPose {
            time_s,
            pose: vector(pose),
            predicted: predicted.pose(),
            unlearned,
        };
        self.gate.refused(refused, &sigmas)
    }

    fn estimate(&mut self, time_s: f64) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let last = *self.events.back()?;
        let gyro = self.gyro_between(&last.belief, last.time_s, self.events.len());
        let belief = self.propagate(&last.belief, time_s - last.time_s, gyro);
        self.growth = belief.growth;
        let yaw_rad = belief.mean.z;
        let measured = belief.attitude.plane_normal(yaw_rad);
        let normal_in_world = match self.normal_in_world {
            Some((before_s, before)) if self.settings.normal_filter_s > 0.0 => {
                let share =
                    1.0 - (-(time_s - before_s).max(0.0) / self.settings.normal_filter_s).exp();
                (before + share * (measured - before)).normalize()
            }
            _ => measured,
        };
        self.normal_in_world = Some((time_s, normal_in_world));
        Some(Estimate {
            time_s,
            pose: PlanarPose {
                x_m: belief.mean.x,
                y_m: belief.mean.y,
                yaw_rad,
            },
            covariance: belief.pose_covariance(),
            attitude: belief.attitude,
            normal_in_world,
            velocity: BodyVelocity::from_vector(&belief.moving.state.velocity),
            tyre_force: belief.moving.state.force,
            treads: belief.treads,
            slip_gains: self.model.slip_gains(&belief.parameters),
            contact: self
                .model
                .contact(&belief.parameters, &belief.parameter_covariance),
            model_error_m_s: self.model_error.root_mean_square_m_s(),
            gyro_bias_rad_s: gyro
                .filter(|gyro| gyro.confirmed)
                .map(|_| belief.gyro_bias_rad_s()),
            pose_noise_m: belief.pose_noise.position_m(),
            pose_age_s: time_s - self.pose_time_s,
            attitude_age_s: time_s - self.attitude_time_s,
            speeds_age_s: time_s - self.speeds_time_s,
            poses_gated: self.poses_gated,
            poses_late: self.poses_late,
            poses_doubted_s: self
                .gate
                .doubted()
                .map(|(doubted_s, newest_s)| (doubted_s, time_s - newest_s)),
        })
    }
}
