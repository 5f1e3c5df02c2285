//! Where the vehicle is now: an extended Kalman filter over ICRIK dead reckoning and late poses.
//!
//! The state is (x, y, yaw) in the world. Tread speeds and attitude drive it by equation (12) with
//! the vehicle's own model; a pose corrects it *at the time it was taken*: readings are kept in the
//! order of their stamps for a while, and a late one is put in its place and all after it replayed.

use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use sidehill_plant::frames::{Attitude, PlanarPose, pose_rate, wrap_angle};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::TreadSpeeds;
use sidehill_plant::vehicle::{RangeError, Vehicle};

/// Readings kept: with 20 Hz speeds, 20 Hz attitude and 10 Hz poses, about 2.5 s.
const HISTORY: usize = 128;

/// Settings of the estimator.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EstimatorSettings {
    /// Standard deviation of a pose's position, m.
    pub pose_sigma_m: f64,
    /// Standard deviation of a pose's heading, rad.
    pub pose_sigma_rad: f64,
    /// Growth of the position's uncertainty while moving, m/sqrt(s).
    pub slide_sigma_m_per_sqrt_s: f64,
    /// Growth of the heading's uncertainty while moving, rad/sqrt(s).
    pub yaw_sigma_rad_per_sqrt_s: f64,
    /// Largest normalised innovation squared (3 degrees of freedom) of a pose that is believed.
    pub gate: f64,
    /// Time constant of the smoothing of the ground's normal in the world frame, s; 0 for none.
    pub normal_filter_s: f64,
}

impl Default for EstimatorSettings {
    fn default() -> Self {
        Self {
            pose_sigma_m: 0.01,
            pose_sigma_rad: 0.0087,
            slide_sigma_m_per_sqrt_s: 0.02,
            yaw_sigma_rad_per_sqrt_s: 0.02,
            gate: 30.0,
            normal_filter_s: 0.0,
        }
    }
}

impl EstimatorSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let positive = |key, value| RangeError::check(key, value, 1e-6, 10.0, "from 1e-6 to 10");
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
        RangeError::check("estimator.gate", self.gate, 1.0, 1e6, "from 1 to 1e6")?;
        RangeError::check(
            "estimator.normal_filter_s",
            self.normal_filter_s,
            0.0,
            60.0,
            "from 0 to 60 s",
        )?;
        Ok(())
    }
}

/// Which readings of a sample were not finite and so were not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Refused {
    /// The tread speeds.
    pub tread_speeds: bool,
    /// Roll or pitch.
    pub attitude: bool,
    /// The pose.
    pub pose: bool,
}

impl Refused {
    /// Returns whether any reading was refused.
    pub fn any(&self) -> bool {
        self.tread_speeds || self.attitude || self.pose
    }
}

/// State of the vehicle at the time of a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Instant it holds for, s.
    pub time_s: f64,
    /// Position and heading.
    pub pose: PlanarPose,
    /// Covariance of (x, y, yaw), m^2, m rad and rad^2.
    pub covariance: Matrix3<f64>,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Upward unit normal of the ground under the vehicle, world frame.
    pub normal_in_world: Vector3<f64>,
    /// Effective tread speeds, after (11).
    pub treads: TreadSpeeds,
    /// Age of the newest believed pose, s.
    pub pose_age_s: f64,
    /// Age of the newest attitude, s.
    pub attitude_age_s: f64,
    /// Age of the newest tread speeds, s.
    pub speeds_age_s: f64,
    /// Poses refused by the gate since the last that was believed.
    pub poses_gated: u32,
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

/// What an event brings.
#[derive(Debug, Clone, Copy)]
enum Reading {
    Speeds(TreadSpeeds),
    Attitude(Attitude),
    Pose(PlanarPose),
}

/// A reading at its time, and the filter's state after it.
#[derive(Debug, Clone, Copy)]
struct Event {
    time_s: f64,
    reading: Reading,
    belief: Belief,
}

#[derive(Debug, Clone, Copy)]
struct Belief {
    mean: Vector3<f64>,
    covariance: Matrix3<f64>,
    treads: TreadSpeeds,
    attitude: Attitude,
}

/// The filter and its recent readings.
pub struct Estimator {
    settings: EstimatorSettings,
    vehicle: Vehicle,
    /// Newest last; never longer than [`HISTORY`].
    events: Vec<Event>,
    started: bool,
    first_attitude: Option<Attitude>,
    normal_in_world: Option<(f64, Vector3<f64>)>,
    pose_time_s: f64,
    attitude_time_s: f64,
    speeds_time_s: f64,
    poses_gated: u32,
    innovation: Option<Innovation>,
}

impl Estimator {
    /// Returns an estimator that knows nothing yet; `vehicle` gives its dead reckoning.
    pub fn new(settings: EstimatorSettings, vehicle: Vehicle) -> Self {
        Self {
            settings,
            vehicle,
            events: Vec::with_capacity(HISTORY + 1),
            started: false,
            first_attitude: None,
            normal_in_world: None,
            pose_time_s: f64::NEG_INFINITY,
            attitude_time_s: f64::NEG_INFINITY,
            speeds_time_s: f64::NEG_INFINITY,
            poses_gated: 0,
            innovation: None,
        }
    }

    /// Replaces the vehicle's parameters, as online adaptation does.
    pub fn set_vehicle(&mut self, vehicle: &Vehicle) {
        self.vehicle.clone_from(vehicle);
    }

    /// Forgets everything: the next attitude and pose are believed as the first ones were.
    pub fn restart(&mut self) {
        *self = Self::new(self.settings, self.vehicle.clone());
    }

    /// Returns the innovation of the newest pose of the last update, believed or not.
    pub fn innovation(&self) -> Option<Innovation> {
        self.innovation
    }

    /// Takes a cycle's readings and returns the state at the cycle's time, or `None` until a first
    /// attitude and a first pose have come. Readings that are not finite are left out and named.
    pub fn update(&mut self, sample: &Sample) -> (Option<Estimate>, Refused) {
        self.innovation = None;
        let mut refused = Refused::default();
        if let Some(speeds) = sample.tread_speeds {
            if speeds.time_s.is_finite()
                && speeds.value.left_m_s.is_finite()
                && speeds.value.right_m_s.is_finite()
            {
                self.speeds_time_s = self.speeds_time_s.max(speeds.time_s);
                let treads = self.vehicle.correction.apply(speeds.value);
                self.insert(speeds.time_s, Reading::Speeds(treads));
            } else {
                refused.tread_speeds = true;
            }
        }
        if let Some(attitude) = sample.attitude {
            if attitude.time_s.is_finite() && attitude.value.is_finite() {
                self.attitude_time_s = self.attitude_time_s.max(attitude.time_s);
                self.first_attitude.get_or_insert(attitude.value);
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
        } else if let Some(attitude) = self.first_attitude {
            let (position, heading) = (self.settings.pose_sigma_m, self.settings.pose_sigma_rad);
            self.started = true;
            self.pose_time_s = pose.time_s;
            self.events.clear();
            self.events.push(Event {
                time_s: pose.time_s,
                reading: Reading::Attitude(attitude),
                belief: Belief {
                    mean: vector(&pose.value),
                    covariance: Matrix3::from_diagonal(&Vector3::new(
                        position * position,
                        position * position,
                        heading * heading,
                    )),
                    treads: TreadSpeeds::default(),
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
                belief,
            },
        );
        for i in after..self.events.len() {
            let previous = self.events[i - 1];
            let event = self.events[i];
            let belief = self.propagate(&previous.belief, event.time_s - previous.time_s);
            self.events[i].belief = self.absorb(belief, &event, i == after);
        }
        if self.events.len() > HISTORY {
            self.events.remove(0);
        }
    }

    /// Returns the belief after a reading; `new` tells a reading from a replayed one.
    fn absorb(&mut self, mut belief: Belief, event: &Event, new: bool) -> Belief {
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
                    if believed {
                        self.pose_time_s = self.pose_time_s.max(event.time_s);
                        self.poses_gated = 0;
                    } else {
                        self.poses_gated += 1;
                    }
                }
                if believed {
                    let gain = belief.covariance * inverse;
                    belief.mean += gain * difference;
                    // Joseph's form keeps the covariance symmetric and positive.
                    let rest = Matrix3::identity() - gain;
                    belief.covariance = rest * belief.covariance * rest.transpose()
                        + gain * noise * gain.transpose();
                }
            }
        }
        belief
    }

    /// Returns the belief `time_s` later: equation (12) by the midpoint rule, and its covariance.
    fn propagate(&self, belief: &Belief, time_s: f64) -> Belief {
        if time_s <= 0.0 {
            return *belief;
        }
        let velocity = self.vehicle.body_velocity(belief.attitude, belief.treads);
        let yaw = belief.mean.z;
        let start = pose_rate(&velocity, &belief.attitude, yaw);
        let middle = pose_rate(
            &velocity,
            &belief.attitude,
            yaw + 0.5 * time_s * start.yaw_rad_s,
        );
        let mut next = *belief;
        next.mean += time_s * Vector3::new(middle.x_m_s, middle.y_m_s, middle.yaw_rad_s);
        let mut by_state = Matrix3::identity();
        by_state[(0, 2)] = -time_s * middle.y_m_s;
        by_state[(1, 2)] = time_s * middle.x_m_s;
        let s = &self.settings;
        let moving = belief.treads.left_m_s != 0.0 || belief.treads.right_m_s != 0.0;
        // A vehicle that stands does not slide; a tenth keeps the filter open to poses.
        let share = if moving { 1.0 } else { 0.01 };
        let noise = Matrix3::from_diagonal(&Vector3::new(
            share * time_s * s.slide_sigma_m_per_sqrt_s.powi(2),
            share * time_s * s.slide_sigma_m_per_sqrt_s.powi(2),
            share * time_s * s.yaw_sigma_rad_per_sqrt_s.powi(2),
        ));
        next.covariance = by_state * belief.covariance * by_state.transpose() + noise;
        next
    }

    fn estimate(&mut self, time_s: f64) -> Option<Estimate> {
        if !self.started {
            return None;
        }
        let last = self.events.last()?;
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
            pose_age_s: time_s - self.pose_time_s,
            attitude_age_s: time_s - self.attitude_time_s,
            speeds_age_s: time_s - self.speeds_time_s,
            poses_gated: self.poses_gated,
        })
    }
}

fn vector(pose: &PlanarPose) -> Vector3<f64> {
    Vector3::new(pose.x_m, pose.y_m, pose.yaw_rad)
}

#[cfg(test)]
mod tests;
