//! Parameters of a vehicle, validated once when they are read.

use crate::extension::{Extension, RawExtension};
use crate::speeds::{MeasuredTreadSpeeds, TreadSpeeds};
use serde::{Deserialize, Serialize};

/// A parameter that is outside its range.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{key}: {value} is out of range, must be {range}")]
pub struct RangeError {
    /// Key as the configuration file spells it.
    pub key: &'static str,
    /// The value found.
    pub value: f64,
    /// The values allowed, in words.
    pub range: &'static str,
}

impl RangeError {
    /// Checks that `value` is finite and within `[low, high]`.
    ///
    /// # Errors
    /// Returns the key, the value and `range` where it is not.
    pub fn check(
        key: &'static str,
        value: f64,
        low: f64,
        high: f64,
        range: &'static str,
    ) -> Result<f64, Self> {
        if value.is_finite() && (low..=high).contains(&value) {
            Ok(value)
        } else {
            Err(Self { key, value, range })
        }
    }
}

/// Positions of the tread ICRs on level ground (ICRHK), in the body frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HorizontalIcrs {
    /// Left tread's ICR to the right of the origin, m; negative.
    pub left_m: f64,
    /// Right tread's ICR to the right of the origin, m; positive.
    pub right_m: f64,
    /// Both treads' ICR ahead of the origin, m.
    pub forward_m: f64,
}

/// Parameters of ICRIK: how far the tread ICRs move on a slope.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlideGains {
    /// lambda_1, s/rad: shift of all ICRs with roll and pitch.
    pub shift_s_per_rad: f64,
    /// lambda_2, s/rad: extra shift of one tread when pointing mostly up or down.
    pub aggravated_s_per_rad: f64,
}

/// A skid-steer vehicle as the ICR models know it.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawVehicle", into = "RawVehicle")]
pub struct Vehicle {
    /// Name for tables and plots.
    pub name: String,
    /// ICRs on level ground.
    pub icrs: HorizontalIcrs,
    /// Slide gains; both zero makes ICRIK equal ICRHK.
    pub slide: SlideGains,
    /// v_y^m, m/s: largest longitudinal speed for which the model was identified.
    pub speed_max_m_s: f64,
    /// x_m, m: half width of the base rectangle.
    pub base_half_width_m: f64,
    /// y_m, m: half length of the base rectangle.
    pub base_half_length_m: f64,
    /// c_l and c_r of equation (11).
    pub correction: SpeedCorrection,
    /// Terms beyond ICRIK and the parameters identified with them; none is ICRIK alone.
    pub extension: Option<Extension>,
}

impl Vehicle {
    /// Returns the same vehicle without slide and without an extension: ICRIK then equals ICRHK.
    pub fn on_level_ground(&self) -> Self {
        Self {
            extension: None,
            slide: SlideGains {
                shift_s_per_rad: 0.0,
                aggravated_s_per_rad: 0.0,
            },
            ..self.clone()
        }
    }

    /// Returns an ideal differential drive with its wheels on the base rectangle's sides.
    pub fn as_differential_drive(&self) -> Self {
        Self {
            icrs: HorizontalIcrs {
                left_m: -self.base_half_width_m,
                right_m: self.base_half_width_m,
                forward_m: 0.0,
            },
            ..self.on_level_ground()
        }
    }
}

impl Vehicle {
    /// Returns the vehicle if all its parameters are in range.
    ///
    /// # Errors
    /// Names the key, its value and its range.
    pub fn validated(self) -> Result<Self, RangeError> {
        Self::try_from(RawVehicle::from(self))
    }
}

/// Correction factors of equation (11), from measured to effective tread speeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpeedCorrection {
    /// c_l of the left tread.
    pub left: f64,
    /// c_r of the right tread.
    pub right: f64,
}

impl SpeedCorrection {
    /// Returns V_l = c_l v_l, V_r = c_r v_r: equation (11).
    pub fn apply(&self, measured: MeasuredTreadSpeeds) -> TreadSpeeds {
        TreadSpeeds {
            left_m_s: self.left * measured.left_m_s,
            right_m_s: self.right * measured.right_m_s,
        }
    }

    /// Returns what an encoder reads when the treads move at `treads`: equation (11) solved for v.
    pub fn invert(&self, treads: TreadSpeeds) -> MeasuredTreadSpeeds {
        MeasuredTreadSpeeds {
            left_m_s: treads.left_m_s / self.left,
            right_m_s: treads.right_m_s / self.right,
        }
    }
}

#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RawVehicle {
    name: String,
    x_icr_left_m: f64,
    x_icr_right_m: f64,
    y_icr_m: f64,
    lambda_1_s_per_rad: f64,
    lambda_2_s_per_rad: f64,
    speed_max_m_s: f64,
    base_half_width_m: f64,
    base_half_length_m: f64,
    correction_left: f64,
    correction_right: f64,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    extension: Option<RawExtension>,
}

impl TryFrom<RawVehicle> for Vehicle {
    type Error = RangeError;

    fn try_from(raw: RawVehicle) -> Result<Self, RangeError> {
        let check = RangeError::check;
        let half_width = check(
            "base_half_width_m",
            raw.base_half_width_m,
            0.01,
            20.0,
            "from 0.01 to 20 m",
        )?;
        let half_length = check(
            "base_half_length_m",
            raw.base_half_length_m,
            0.01,
            20.0,
            "from 0.01 to 20 m",
        )?;
        let mut vehicle = Self {
            name: raw.name,
            icrs: HorizontalIcrs {
                left_m: check(
                    "x_icr_left_m",
                    raw.x_icr_left_m,
                    -50.0,
                    -half_width,
                    "at most -base_half_width_m, and at least -50 m",
                )?,
                right_m: check(
                    "x_icr_right_m",
                    raw.x_icr_right_m,
                    half_width,
                    50.0,
                    "at least base_half_width_m, and at most 50 m",
                )?,
                forward_m: check(
                    "y_icr_m",
                    raw.y_icr_m,
                    -half_length,
                    half_length,
                    "within +-base_half_length_m",
                )?,
            },
            slide: SlideGains {
                shift_s_per_rad: check(
                    "lambda_1_s_per_rad",
                    raw.lambda_1_s_per_rad,
                    0.0,
                    100.0,
                    "from 0 to 100 s/rad",
                )?,
                aggravated_s_per_rad: check(
                    "lambda_2_s_per_rad",
                    raw.lambda_2_s_per_rad,
                    0.0,
                    100.0,
                    "from 0 to 100 s/rad",
                )?,
            },
            speed_max_m_s: check(
                "speed_max_m_s",
                raw.speed_max_m_s,
                0.01,
                20.0,
                "from 0.01 to 20 m/s",
            )?,
            base_half_width_m: half_width,
            base_half_length_m: half_length,
            correction: SpeedCorrection {
                left: check(
                    "correction_left",
                    raw.correction_left,
                    0.5,
                    2.0,
                    "from 0.5 to 2",
                )?,
                right: check(
                    "correction_right",
                    raw.correction_right,
                    0.5,
                    2.0,
                    "from 0.5 to 2",
                )?,
            },
            extension: None,
        };
        let extension = raw.extension.map(|raw| raw.checked(&vehicle)).transpose()?;
        vehicle.extension = extension;
        Ok(vehicle)
    }
}

impl From<Vehicle> for RawVehicle {
    fn from(v: Vehicle) -> Self {
        Self {
            name: v.name,
            x_icr_left_m: v.icrs.left_m,
            x_icr_right_m: v.icrs.right_m,
            y_icr_m: v.icrs.forward_m,
            lambda_1_s_per_rad: v.slide.shift_s_per_rad,
            lambda_2_s_per_rad: v.slide.aggravated_s_per_rad,
            speed_max_m_s: v.speed_max_m_s,
            base_half_width_m: v.base_half_width_m,
            base_half_length_m: v.base_half_length_m,
            correction_left: v.correction.left,
            correction_right: v.correction.right,
            extension: v.extension.map(RawExtension::from),
        }
    }
}

/// Returns the J8 of the paper.
#[cfg(test)]
pub(crate) fn j8() -> Vehicle {
    serde_yaml::from_str(include_str!("../../config/vehicles/j8.yaml")).unwrap()
}
