//! Sensors of the simulated vehicle: rate, noise, bias, quantisation, delay and dropout, seeded.

mod channel;
mod config;

pub use config::SensorsConfig;

use crate::frames::{Attitude, Pose};
use crate::sample::Sample;
use crate::speeds::MeasuredTreadSpeeds;
use channel::{Channel, Errors, StepClock};
use config::{AttitudeErrors, PoseErrors, TreadSpeedErrors, YawRateErrors};

/// What is true at an instant, as ideal sensors would read it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Truth {
    /// Tread speeds as the encoders see them, before c_l and c_r.
    pub tread_speeds: MeasuredTreadSpeeds,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Yaw rate about the body's upward axis, rad/s.
    pub yaw_rate_rad_s: f64,
    /// Pose in the world.
    pub pose: Pose,
}

/// The sensors, observing the truth at every step and delivering readings on demand.
///
/// Each draws from its own random stream, and equally many numbers for every reading whatever its
/// configuration, so that a change to one sensor leaves the others' readings as they were.
#[derive(Debug, Clone)]
pub struct Sensors {
    dt_s: f64,
    tread_speeds: Channel<TreadSpeedErrors>,
    attitude: Channel<AttitudeErrors>,
    yaw_rate: Option<Channel<YawRateErrors>>,
    pose: Channel<PoseErrors>,
}

impl Sensors {
    /// Returns sensors that observe every `dt_s`, s, which must be positive.
    pub fn new(config: &SensorsConfig, seed: u64, dt_s: f64) -> Self {
        Self {
            dt_s,
            tread_speeds: Channel::new(
                config.tread_speeds.timing,
                config.tread_speeds.errors,
                seed,
                1,
            ),
            attitude: Channel::new(config.attitude.timing, config.attitude.errors, seed, 2),
            yaw_rate: config
                .yaw_rate
                .map(|sensor| Channel::new(sensor.timing, sensor.errors, seed, 4)),
            pose: Channel::new(config.pose.timing, config.pose.errors, seed, 3),
        }
    }

    /// Returns sensors that read the truth at every step, at once.
    pub fn perfect(dt_s: f64) -> Self {
        Self::new(&SensorsConfig::default(), 0, dt_s)
    }

    /// Takes the readings that are due at step `step_index`, whose instant is
    /// `step_index * dt_s`; steps must be observed in ascending order.
    ///
    /// A reading of rate f is due at k/f, counted and not accumulated, and taken at the first step
    /// from then on; above the rate of the steps there is one reading a step.
    pub fn observe(&mut self, step_index: u64, truth: &Truth) {
        let clock = StepClock {
            step_index,
            dt_s: self.dt_s,
        };
        self.tread_speeds.observe(clock, &truth.tread_speeds);
        self.attitude.observe(clock, &truth.attitude);
        if let Some(yaw_rate) = &mut self.yaw_rate {
            yaw_rate.observe(clock, &truth.yaw_rate_rad_s);
        }
        self.pose.observe(clock, &truth.pose);
    }

    /// Returns the newest readings that have arrived by `time_s`, s, since the last call, each with
    /// the instant at which it was taken.
    pub fn sample(&mut self, time_s: f64) -> Sample {
        Sample {
            time_s,
            tread_speeds: self.tread_speeds.newest(time_s),
            attitude: self.attitude.newest(time_s),
            yaw_rate: self.yaw_rate.as_mut().and_then(|s| s.newest(time_s)),
            pose: self.pose.newest(time_s),
        }
    }
}

impl Errors for TreadSpeedErrors {
    type Reading = MeasuredTreadSpeeds;

    fn disturb(&self, truth: &MeasuredTreadSpeeds, gaussians: [f64; 4]) -> MeasuredTreadSpeeds {
        let read = |value: f64, bias: f64, gaussian: f64| {
            let disturbed = value + bias + self.noise_std_m_s * gaussian;
            quantise(disturbed, self.quantisation_m_s)
        };
        MeasuredTreadSpeeds {
            left_m_s: read(truth.left_m_s, self.bias_left_m_s, gaussians[0]),
            right_m_s: read(truth.right_m_s, self.bias_right_m_s, gaussians[1]),
        }
    }
}

impl Errors for AttitudeErrors {
    type Reading = Attitude;

    fn disturb(&self, truth: &Attitude, gaussians: [f64; 4]) -> Attitude {
        let read = |value_rad: f64, bias_deg: f64, gaussian: f64| {
            let error_deg = bias_deg + self.noise_std_deg * gaussian;
            quantise(
                value_rad + error_deg.to_radians(),
                self.quantisation_deg.to_radians(),
            )
        };
        Attitude {
            roll_rad: read(truth.roll_rad, self.bias_roll_deg, gaussians[0]),
            pitch_rad: read(truth.pitch_rad, self.bias_pitch_deg, gaussians[1]),
        }
    }
}

impl Errors for YawRateErrors {
    type Reading = f64;

    fn disturb(&self, truth_rad_s: &f64, gaussians: [f64; 4]) -> f64 {
        let error_deg_s = self.bias_deg_s + self.noise_std_deg_s * gaussians[0];
        quantise(
            (1.0 + self.scale_error) * truth_rad_s + error_deg_s.to_radians(),
            self.quantisation_deg_s.to_radians(),
        )
    }
}

impl Errors for PoseErrors {
    type Reading = Pose;

    fn disturb(&self, truth: &Pose, gaussians: [f64; 4]) -> Pose {
        let place = |value_m: f64, bias_m: f64, gaussian: f64| {
            let disturbed_m = value_m + bias_m + self.noise_std_m * gaussian;
            quantise(disturbed_m, self.quantisation_m)
        };
        let yaw_error_deg = self.bias_yaw_deg + self.noise_std_yaw_deg * gaussians[3];
        Pose {
            x_m: place(truth.x_m, self.bias_x_m, gaussians[0]),
            y_m: place(truth.y_m, self.bias_y_m, gaussians[1]),
            z_m: place(truth.z_m, self.bias_z_m, gaussians[2]),
            yaw_rad: quantise(
                truth.yaw_rad + yaw_error_deg.to_radians(),
                self.quantisation_yaw_deg.to_radians(),
            ),
        }
    }
}

/// Returns the multiple of `quantum` nearest to a value; the value itself where `quantum` is 0.
fn quantise(value: f64, quantum: f64) -> f64 {
    if quantum > 0.0 {
        (value / quantum).round() * quantum
    } else {
        value
    }
}

#[cfg(test)]
mod tests;
