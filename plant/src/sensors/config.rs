//! Configuration of the sensors; everything left out is perfect.

use crate::bounds::{Bounds, RangeError};
use serde::{Deserialize, Serialize};

/// When each of the three sensors reads and how wrong it is; `{}` is perfect sensors.
///
/// As YAML: `tread_speeds`, `attitude` and `pose`, each with `timing` (`rate_hz`, absent for every
/// step; `delay_s`; `dropout_probability`) and `errors` (standard deviations, biases and steps of
/// quantisation, with units in their keys).
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(try_from = "RawSensors")]
pub struct SensorsConfig {
    /// [Tread speeds](#sensor).
    pub(super) tread_speeds: Sensor<TreadSpeedErrors>,
    /// [Roll and pitch](#sensor).
    pub(super) attitude: Sensor<AttitudeErrors>,
    /// [Yaw rate](#sensor) of a gyroscope. None: the vehicle has no gyroscope.
    pub(super) yaw_rate: Option<Sensor<YawRateErrors>>,
    /// [Position and heading](#sensor).
    pub(super) pose: Sensor<PoseErrors>,
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Sensor<E: Default> {
    /// [When readings are taken and arrive](#timing).
    pub(super) timing: Timing,
    /// Their errors, whose keys differ: [tread speeds](#errors-of-tread-speeds), [attitude](#errors-of-attitude), [yaw
    /// rate](#errors-of-the-yaw-rate), [poses](#errors-of-poses).
    pub(super) errors: E,
}

#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct Timing {
    /// Readings per second. None: one at every step of the simulation.
    pub(super) rate_hz: Option<f64>,
    /// Time from the instant of a reading to its arrival.
    pub(super) delay_s: f64,
    /// Share of readings that never arrive.
    pub(super) dropout_probability: f64,
    /// Length of the gaps in which nothing is read, such as those of a GNSS under trees.
    pub(super) gap_s: f64,
    /// Time from the end of a gap to the end of the next; the first ends after as long.
    pub(super) gap_every_s: f64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            rate_hz: None,
            delay_s: 0.0,
            dropout_probability: 0.0,
            gap_s: 0.0,
            gap_every_s: 20.0,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct TreadSpeedErrors {
    /// Standard deviation of white noise.
    pub(super) noise_std_m_s: f64,
    /// Constant error of the left speed.
    pub(super) bias_left_m_s: f64,
    /// Constant error of the right speed.
    pub(super) bias_right_m_s: f64,
    /// Step of the reading; 0 for none.
    pub(super) quantisation_m_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct AttitudeErrors {
    /// Standard deviation of white noise of roll and pitch.
    pub(super) noise_std_deg: f64,
    /// Constant error of roll.
    pub(super) bias_roll_deg: f64,
    /// Constant error of pitch.
    pub(super) bias_pitch_deg: f64,
    /// Step of the reading; 0 for none.
    pub(super) quantisation_deg: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct YawRateErrors {
    /// Standard deviation of white noise.
    pub(super) noise_std_deg_s: f64,
    /// Constant error.
    pub(super) bias_deg_s: f64,
    /// Share of the yaw rate that is read in addition; -1 reads nothing, -2 the other sign.
    pub(super) scale_error: f64,
    /// Step of the reading; 0 for none.
    pub(super) quantisation_deg_s: f64,
}

#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PoseErrors {
    /// Standard deviation of white noise of each coordinate.
    pub(super) noise_std_m: f64,
    /// Standard deviation of white noise of the heading.
    pub(super) noise_std_yaw_deg: f64,
    /// Constant error of x.
    pub(super) bias_x_m: f64,
    /// Constant error of y.
    pub(super) bias_y_m: f64,
    /// Constant error of z.
    pub(super) bias_z_m: f64,
    /// Constant error of the heading.
    pub(super) bias_yaw_deg: f64,
    /// Step of the coordinates; 0 for none.
    pub(super) quantisation_m: f64,
    /// Step of the heading; 0 for none.
    pub(super) quantisation_yaw_deg: f64,
}

#[derive(Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct RawSensors {
    tread_speeds: Sensor<TreadSpeedErrors>,
    attitude: Sensor<AttitudeErrors>,
    yaw_rate: Option<Sensor<YawRateErrors>>,
    pose: Sensor<PoseErrors>,
}

/// Keys of a sensor's timing, as the errors name them.
struct TimingKeys {
    rate: &'static str,
    delay: &'static str,
    dropout: &'static str,
    gap: &'static str,
    gap_every: &'static str,
}

/// Returns the names of a sensor's keys.
macro_rules! timing_keys {
    ($sensor:literal) => {
        TimingKeys {
            rate: concat!($sensor, ".timing.rate_hz"),
            delay: concat!($sensor, ".timing.delay_s"),
            dropout: concat!($sensor, ".timing.dropout_probability"),
            gap: concat!($sensor, ".timing.gap_s"),
            gap_every: concat!($sensor, ".timing.gap_every_s"),
        }
    };
}

impl Timing {
    /// Returns whether an instant is in a gap.
    pub(super) fn is_gap(&self, time_s: f64) -> bool {
        self.gap_s > 0.0 && time_s % self.gap_every_s >= self.gap_every_s - self.gap_s
    }

    fn check(&self, keys: &TimingKeys) -> Result<(), RangeError> {
        if let Some(rate_hz) = self.rate_hz {
            Bounds::new(1e-3, 1e5, "Hz").check(keys.rate, rate_hz)?;
        }
        Bounds::new(0.0, 10.0, "s").check(keys.delay, self.delay_s)?;
        Bounds::new(0.0, 1.0, "").check(keys.dropout, self.dropout_probability)?;
        Bounds::new(0.0, 1e4, "s").check(keys.gap, self.gap_s)?;
        Bounds::new(self.gap_s.max(1e-3), 1e6, "s")
            .with_note("at least gap_s")
            .check(keys.gap_every, self.gap_every_s)?;
        Ok(())
    }
}

impl TryFrom<RawSensors> for SensorsConfig {
    type Error = RangeError;

    fn try_from(raw: RawSensors) -> Result<Self, RangeError> {
        raw.tread_speeds
            .timing
            .check(&timing_keys!("tread_speeds"))?;
        raw.attitude.timing.check(&timing_keys!("attitude"))?;
        let yaw_rate = raw.yaw_rate.unwrap_or_default();
        yaw_rate.timing.check(&timing_keys!("yaw_rate"))?;
        raw.pose.timing.check(&timing_keys!("pose"))?;
        let (treads, attitude, yaw_rate, pose) = (
            raw.tread_speeds.errors,
            raw.attitude.errors,
            yaw_rate.errors,
            raw.pose.errors,
        );
        for (key, value) in [
            ("tread_speeds.errors.noise_std_m_s", treads.noise_std_m_s),
            (
                "tread_speeds.errors.quantisation_m_s",
                treads.quantisation_m_s,
            ),
            ("attitude.errors.noise_std_deg", attitude.noise_std_deg),
            (
                "attitude.errors.quantisation_deg",
                attitude.quantisation_deg,
            ),
            ("yaw_rate.errors.noise_std_deg_s", yaw_rate.noise_std_deg_s),
            (
                "yaw_rate.errors.quantisation_deg_s",
                yaw_rate.quantisation_deg_s,
            ),
            ("pose.errors.noise_std_m", pose.noise_std_m),
            ("pose.errors.noise_std_yaw_deg", pose.noise_std_yaw_deg),
            ("pose.errors.quantisation_m", pose.quantisation_m),
            (
                "pose.errors.quantisation_yaw_deg",
                pose.quantisation_yaw_deg,
            ),
        ] {
            Bounds::new(0.0, 100.0, "").check(key, value)?;
        }
        for (key, value) in [
            ("tread_speeds.errors.bias_left_m_s", treads.bias_left_m_s),
            ("tread_speeds.errors.bias_right_m_s", treads.bias_right_m_s),
            ("attitude.errors.bias_roll_deg", attitude.bias_roll_deg),
            ("attitude.errors.bias_pitch_deg", attitude.bias_pitch_deg),
            ("yaw_rate.errors.bias_deg_s", yaw_rate.bias_deg_s),
            ("yaw_rate.errors.scale_error", yaw_rate.scale_error),
            ("pose.errors.bias_x_m", pose.bias_x_m),
            ("pose.errors.bias_y_m", pose.bias_y_m),
            ("pose.errors.bias_z_m", pose.bias_z_m),
            ("pose.errors.bias_yaw_deg", pose.bias_yaw_deg),
        ] {
            Bounds::new(-100.0, 100.0, "").check(key, value)?;
        }
        Ok(Self {
            tread_speeds: raw.tread_speeds,
            attitude: raw.attitude,
            yaw_rate: raw.yaw_rate,
            pose: raw.pose,
        })
    }
}
