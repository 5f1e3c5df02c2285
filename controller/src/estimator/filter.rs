//! An extended Kalman filter over pose and parameters of a model, generic over the model.
//!
//! Readings are kept in the order of their stamps for a while; a late one is put in its place and all
//! after it replayed.

use super::gains::{Kept, LearnedGains};
use super::gate::{PoseGate, PoseSigmas, RefusedPose};
use super::learned::{Drift, LearnedModel, Prior};
use super::{Estimate, EstimatorSettings, Innovation, Refused};
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};
use sidehill_plant::frames::{Attitude, PlanarPose, pose_rate, wrap_angle};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::TreadSpeeds;
use std::collections::VecDeque;

/// Readings kept: with 20 Hz speeds, 20 Hz attitude and 10 Hz poses, about 1 s.
pub(super) const HISTORY: usize = 50;

/// What an event brings.
#[derive(Debug, Clone, Copy)]
enum Reading {
    Speeds(TreadSpeeds),
    Attitude(Attitude),
    Pose(PlanarPose),
}

/// A reading at its time, and the filter's state after it.
#[derive(Debug, Clone, Copy)]
struct Event<const N: usize> {
    time_s: f64,
    reading: Reading,
    /// Covariance added to the prediction's before a pose that is accepted although it contradicts it.
    inflation: Option<Matrix3<f64>>,
    belief: Belief<N>,
}

/// Mean and covariance of pose and parameters, in blocks, and the inputs in force.
#[derive(Debug, Clone, Copy)]
pub(super) struct Belief<const N: usize> {
    pub(super) mean: Vector3<f64>,
    pub(super) covariance: Matrix3<f64>,
    pub(super) parameters: SVector<f64, N>,
    /// Of the pose with the parameters.
    pub(super) cross: SMatrix<f64, 3, N>,
    pub(super) parameter_covariance: SMatrix<f64, N, N>,
    treads: TreadSpeeds,
    attitude: Attitude,
}

/// The filter and its recent readings.
pub(super) struct Filter<M, const N: usize> {
    settings: EstimatorSettings,
    model: M,
    /// Newest last; never longer than [`HISTORY`].
    events: VecDeque<Event<N>>,
    started: bool,
    /// Newest readings, with which the filter starts.
    newest_attitude: Option<Attitude>,
    newest_treads: TreadSpeeds,
    normal_in_world: Option<(f64, Vector3<f64>)>,
    pose_time_s: f64,
    attitude_time_s: f64,
    speeds_time_s: f64,
    poses_gated: u32,
    gate: PoseGate,
    innovation: Option<Innovation>,
    model_error: ModelError,
    keeps: bool,
    kept: Option<Kept<N>>,
}

/// Mean square of the error of the predicted velocity, as poses show it.
#[derive(Debug, Clone, Copy)]
struct ModelError {
    pose_time_s: f64,
    mean_square_m2_s2: f64,
}

impl ModelError {
    /// Adds an innovation; `noise_m2` is the part of its square that is noise of the pose, not an error
    /// of the model.
    fn absorb(&mut self, innovation: &Innovation, noise_m2: f64, averaging_s: f64) {
        let time_s = innovation.time_s - self.pose_time_s;
        self.pose_time_s = innovation.time_s;
        if time_s > 0.0 && time_s <= averaging_s {
            let square = innovation.difference.xy().norm_squared() - noise_m2;
            let share = time_s / averaging_s;
            let found = (square / (time_s * time_s)).max(0.0);
            self.mean_square_m2_s2 += share * (found - self.mean_square_m2_s2);
        }
    }
}

impl<M: LearnedModel<N>, const N: usize> Filter<M, N> {
    /// Returns a filter without any reading; `model` gives its dead reckoning.
    pub(super) fn new(settings: EstimatorSettings, model: M) -> Self {
        Self {
            settings,
            model,
            events: VecDeque::with_capacity(HISTORY + 1),
            started: false,
            newest_attitude: None,
            newest_treads: TreadSpeeds::default(),
            normal_in_world: None,
            pose_time_s: f64::NEG_INFINITY,
            attitude_time_s: f64::NEG_INFINITY,
            speeds_time_s: f64::NEG_INFINITY,
            poses_gated: 0,
            gate: PoseGate::new(settings.believed_after_s),
            innovation: None,
            model_error: ModelError {
                pose_time_s: f64::NEG_INFINITY,
                mean_square_m2_s2: 0.0,
            },
            keeps: false,
            kept: None,
        }
    }

    /// Resets the filter, except for what was learned where that is kept: the next attitude and pose are
    /// accepted as the first ones were.
    pub(super) fn restart(&mut self) {
        let (keeps, kept) = (self.keeps, self.kept());
        *self = Self {
            keeps,
            kept: kept.filter(|_| keeps),
            ..Self::new(self.settings, self.model.clone())
        };
    }

    pub(super) fn keep_learned(&mut self, keep: bool) {
        self.keeps = keep;
    }

    pub(super) fn learned(&self) -> Option<LearnedGains> {
        let kept = self.kept()?;
        Some(LearnedGains::of(&kept, &self.model.prior()))
    }

    pub(super) fn recall(&mut self, learned: &LearnedGains) -> Result<(), &'static str> {
        let mut kept = learned.kept(&self.model.prior())?;
        self.model.bound(&mut kept.mean, &Attitude::LEVEL);
        self.kept = Some(kept);
        Ok(())
    }

    /// Returns what is known of the parameters to begin with after a break.
    fn kept(&self) -> Option<Kept<N>> {
        let learned = self.events.back().map(|event| {
            let belief = &event.belief;
            let kept = Kept {
                mean: belief.parameters,
                covariance: belief.parameter_covariance,
            };
            kept.over_a_break(&self.model.prior())
        });
        learned.or(self.kept)
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

    /// Takes a cycle's readings and returns the state at the cycle's time, or `None` until a first
    /// attitude and a first pose have arrived. Readings that are not finite are left out and named.
    pub(super) fn update(&mut self, sample: &Sample) -> (Option<Estimate>, Refused) {
        self.innovation = None;
        let mut refused = Refused::default();
        if let Some(speeds) = sample.tread_speeds {
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
        if let Some(attitude) = sample.attitude {
            if attitude.time_s.is_finite() && attitude.value.is_finite() {
                self.attitude_time_s = self.attitude_time_s.max(attitude.time_s);
                self.newest_attitude = Some(attitude.value);
                self.insert(attitude.time_s, Reading::Attitude(attitude.value));
            } else {
                refused.attitude = true;
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
                    time_s: pose.time_s,
                    value: planar,
                });
            } else {
                refused.pose = true;
            }
        }
        (self.estimate(sample.time_s), refused)
    }

    fn take_pose(&mut self, pose: Stamped<PlanarPose>) {
        if self.started {
            self.insert(pose.time_s, Reading::Pose(pose.value));
        } else if let Some(attitude) = self.newest_attitude {
            let (position, heading) = (self.settings.pose_sigma_m, self.settings.pose_sigma_rad);
            let prior = self.model.prior();
            let kept = self.kept.unwrap_or(Kept {
                mean: prior.mean,
                covariance: prior.covariance(),
            });
            self.started = true;
            self.pose_time_s = pose.time_s;
            self.events.clear();
            self.events.push_back(Event {
                time_s: pose.time_s,
                reading: Reading::Attitude(attitude),
                inflation: None,
                belief: Belief {
                    mean: vector(&pose.value),
                    covariance: Matrix3::from_diagonal(&Vector3::new(
                        position * position,
                        position * position,
                        heading * heading,
                    )),
                    parameters: kept.mean,
                    cross: SMatrix::zeros(),
                    parameter_covariance: kept.covariance,
                    treads: self.newest_treads,
                    attitude,
                },
            });
        }
    }

    /// Puts a reading in its place in time and replays what comes after it. A reading older than all
    /// that is kept has no effect.
    fn insert(&mut self, time_s: f64, reading: Reading) {
        let after = self.events.partition_point(|event| event.time_s <= time_s);
        if after == 0 {
            return;
        }
        let belief = self.events[after - 1].belief;
        self.events.insert(
            after,
            Event {
                time_s,
                reading,
                inflation: None,
                belief,
            },
        );
        // New speeds also hold for the intervals since the speeds before them.
        let first = match reading {
            Reading::Speeds(_) => self
                .events
                .iter()
                .take(after)
                .rposition(|event| matches!(event.reading, Reading::Speeds(_)))
                .map_or(1, |speeds| speeds + 1),
            _ => after,
        };
        for i in first..self.events.len() {
            let mut before = self.events[i - 1].belief;
            let event = self.events[i];
            // Between two readings of the speeds the later one holds: it shows what the command of the
            // interval has made of them.
            if let Some(treads) = self.next_treads(i) {
                before.treads = treads;
            }
            let mut belief = self.propagate(&before, event.time_s - self.events[i - 1].time_s);
            if i == after
                && let Reading::Pose(pose) = event.reading
            {
                self.events[i].inflation = self.judge(&belief, event.time_s, &pose);
            }
            if let Some(inflation) = &self.events[i].inflation {
                belief.covariance += inflation;
            }
            self.events[i].belief = self.absorb(belief, &event, i == after);
        }
        if self.events.len() > HISTORY {
            self.events.pop_front();
        }
    }

    /// Returns the first tread speeds read at event `from` or later.
    fn next_treads(&self, from: usize) -> Option<TreadSpeeds> {
        self.events.iter().skip(from).find_map(|e| match e.reading {
            Reading::Speeds(treads) => Some(treads),
            _ => None,
        })
    }

    /// Returns the covariance with which a new pose passes that is accepted against the prediction.
    fn judge(
        &mut self,
        predicted: &Belief<N>,
        time_s: f64,
        pose: &PlanarPose,
    ) -> Option<Matrix3<f64>> {
        let s = &self.settings;
        let (position, heading) = (s.pose_sigma_m.powi(2), s.pose_sigma_rad.powi(2));
        let noise = Matrix3::from_diagonal(&Vector3::new(position, position, heading));
        let mut difference = vector(pose) - predicted.mean;
        difference.z = wrap_angle(difference.z);
        let inverse = (predicted.covariance + noise).try_inverse()?;
        let normalised = (difference.transpose() * inverse * difference).x;
        if normalised <= s.gate {
            self.gate.passed(time_s, normalised / s.gate);
            return None;
        }
        let prior = self.model.prior().mean;
        let (unlearned, _) = self
            .model
            .velocity(predicted.attitude, predicted.treads, &prior);
        let refused = RefusedPose {
            time_s,
            pose: vector(pose),
            predicted: predicted.mean,
            unlearned,
        };
        let sigmas = PoseSigmas {
            position_m: s.pose_sigma_m,
            heading_rad: s.pose_sigma_rad,
        };
        self.gate.refused(refused, &sigmas)
    }

    /// Returns the belief after a reading; `new` is false for a replayed one.
    fn absorb(&mut self, mut belief: Belief<N>, event: &Event<N>, new: bool) -> Belief<N> {
        match event.reading {
            Reading::Speeds(treads) => belief.treads = treads,
            Reading::Attitude(attitude) => belief.attitude = attitude,
            Reading::Pose(pose) => {
                let s = &self.settings;
                let noise = Matrix3::from_diagonal(&Vector3::new(
                    s.pose_sigma_m.powi(2),
                    s.pose_sigma_m.powi(2),
                    s.pose_sigma_rad.powi(2),
                ));
                let mut difference = vector(&pose) - belief.mean;
                difference.z = wrap_angle(difference.z);
                let Some(inverse) = (belief.covariance + noise).try_inverse() else {
                    return belief;
                };
                let normalised = (difference.transpose() * inverse * difference).x;
                let believed = normalised <= s.gate;
                if new {
                    self.innovation = Some(Innovation {
                        time_s: event.time_s,
                        difference,
                        normalised,
                    });
                    if let Some(innovation) = &self.innovation {
                        let noise_m2 = 2.0 * s.pose_sigma_m * s.pose_sigma_m;
                        self.model_error
                            .absorb(innovation, noise_m2, s.error_averaging_s);
                    }
                    if believed {
                        self.pose_time_s = self.pose_time_s.max(event.time_s);
                        self.poses_gated = 0;
                    } else {
                        self.poses_gated += 1;
                    }
                }
                if believed {
                    belief.correct(&difference, &noise, &inverse);
                    let attitude = belief.attitude;
                    self.model.bound(&mut belief.parameters, &attitude);
                }
            }
        }
        belief
    }

    /// Returns the belief `time_s` later: equation (12) by the midpoint rule, and its covariance.
    fn propagate(&self, belief: &Belief<N>, time_s: f64) -> Belief<N> {
        if time_s <= 0.0 {
            return *belief;
        }
        let (velocity, by_parameters) =
            self.model
                .velocity(belief.attitude, belief.treads, &belief.parameters);
        let yaw = belief.mean.z;
        let start = pose_rate(&velocity, &belief.attitude, yaw);
        let half_way = yaw + 0.5 * time_s * start.yaw_rad_s;
        let middle = pose_rate(&velocity, &belief.attitude, half_way);
        let mut next = *belief;
        next.mean += time_s * Vector3::new(middle.x_m_s, middle.y_m_s, middle.yaw_rad_s);
        let mut by_state = Matrix3::identity();
        by_state[(0, 2)] = -time_s * middle.y_m_s;
        by_state[(1, 2)] = time_s * middle.x_m_s;
        let (sin, cos) = half_way.sin_cos();
        let to_world = Matrix3::new(cos, -sin, 0.0, sin, cos, 0.0, 0.0, 0.0, 1.0);
        let by_parameters = time_s * (to_world * by_parameters);
        let (slide, turn) = self.model.process_noise(&self.settings);
        let moving = belief.treads.left_m_s != 0.0 || belief.treads.right_m_s != 0.0;
        // A vehicle that stands does not slide; a tenth keeps the filter open to poses.
        let share = if moving { 1.0 } else { 0.01 } * self.gate.noise_factor();
        let noise = Matrix3::from_diagonal(&Vector3::new(
            share * time_s * slide.powi(2),
            share * time_s * slide.powi(2),
            share * time_s * turn.powi(2),
        ));
        let through = by_parameters * belief.parameter_covariance;
        let crossed = by_state * belief.cross * by_parameters.transpose();
        next.covariance = by_state * belief.covariance * by_state.transpose()
            + crossed
            + crossed.transpose()
            + through * by_parameters.transpose()
            + noise;
        next.cross = by_state * belief.cross + through;
        let drift = self.model.drift(belief.treads, time_s);
        next.drift(&drift, &self.model.prior());
        next
    }

    fn estimate(&mut self, time_s: f64) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let last = self.events.back()?;
        let belief = self.propagate(&last.belief, time_s - last.time_s);
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
            covariance: belief.covariance,
            attitude: belief.attitude,
            normal_in_world,
            treads: belief.treads,
            slip_gains: self.model.slip_gains(&belief.parameters),
            contact: self
                .model
                .contact(&belief.parameters, &belief.parameter_covariance),
            model_error_m_s: self.model_error.mean_square_m2_s2.sqrt(),
            pose_age_s: time_s - self.pose_time_s,
            attitude_age_s: time_s - self.attitude_time_s,
            speeds_age_s: time_s - self.speeds_time_s,
            poses_gated: self.poses_gated,
            poses_doubted_s: self
                .gate
                .doubted()
                .map(|(doubted_s, newest_s)| (doubted_s, time_s - newest_s)),
        })
    }
}

impl<const N: usize> Belief<N> {
    /// Updates with a pose: `difference` is pose less mean, `inverse` that of covariance and `noise`.
    ///
    /// With H = (1 0), K = P H' S^-1, the whole of P becomes (1 - K H) P (1 - K H)' + K R K', Joseph's form,
    /// which keeps it symmetric and positive however the numbers are rounded.
    fn correct(&mut self, difference: &Vector3<f64>, noise: &Matrix3<f64>, inverse: &Matrix3<f64>) {
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

fn vector(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}
