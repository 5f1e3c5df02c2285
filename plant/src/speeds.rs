//! Speeds of treads and motors, each its own type so that sides and scales cannot be swapped.
//!
//! *Effective* speeds are those at which a tread moves over the ground in the models: V_l, V_r of
//! the paper, [`TreadSpeeds`] and [`MotorSpeeds`]. *Measured* speeds are what encoders count and
//! drives control: v_l, v_r, [`MeasuredTreadSpeeds`] and [`MeasuredMotorSpeeds`]. Equation (11)
//! converts between them: [`EncoderScale`].

use serde::{Deserialize, Serialize};

/// Effective longitudinal speeds of the treads (V_l, V_r of the paper), after c_l and c_r.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct TreadSpeeds {
    /// Left tread V_l, m/s, forward positive.
    pub left_m_s: f64,
    /// Right tread V_r, m/s, forward positive.
    pub right_m_s: f64,
}

/// Tread speeds as an encoder reports them (v_l, v_r of the paper), before c_l and c_r.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MeasuredTreadSpeeds {
    /// Left tread v_l, m/s, forward positive.
    pub left_m_s: f64,
    /// Right tread v_r, m/s, forward positive.
    pub right_m_s: f64,
}

/// Effective speeds of the traction and the steer motor: half sum and half difference of V_l and V_r.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MotorSpeeds {
    /// Traction tau = (V_r + V_l)/2, m/s.
    pub traction_m_s: f64,
    /// Steer sigma = (V_r - V_l)/2, m/s, positive turns counter-clockwise.
    pub steer_m_s: f64,
}

impl MotorSpeeds {
    /// A vehicle at standstill.
    pub const STOP: Self = Self {
        traction_m_s: 0.0,
        steer_m_s: 0.0,
    };

    /// Returns whether both speeds are finite.
    pub fn is_finite(&self) -> bool {
        self.traction_m_s.is_finite() && self.steer_m_s.is_finite()
    }
}

impl From<MotorSpeeds> for TreadSpeeds {
    fn from(motors: MotorSpeeds) -> Self {
        Self {
            left_m_s: motors.traction_m_s - motors.steer_m_s,
            right_m_s: motors.traction_m_s + motors.steer_m_s,
        }
    }
}

impl From<TreadSpeeds> for MotorSpeeds {
    fn from(treads: TreadSpeeds) -> Self {
        Self {
            traction_m_s: 0.5 * (treads.right_m_s + treads.left_m_s),
            steer_m_s: 0.5 * (treads.right_m_s - treads.left_m_s),
        }
    }
}

/// Speeds of the traction and the steer motor as encoders count them and drives control them: half
/// sum and half difference of v_l and v_r, before c_l and c_r.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
pub struct MeasuredMotorSpeeds {
    /// (v_r + v_l)/2, m/s.
    pub traction_m_s: f64,
    /// (v_r - v_l)/2, m/s.
    pub steer_m_s: f64,
}

impl MeasuredMotorSpeeds {
    /// Both motors stand.
    pub const STOP: Self = Self {
        traction_m_s: 0.0,
        steer_m_s: 0.0,
    };

    /// Returns the drive command that reaches the effective speeds `wanted`: equation (11)
    /// solved for v_l and v_r.
    pub fn reaching(wanted: MotorSpeeds, scale: &EncoderScale) -> Self {
        scale.invert(TreadSpeeds::from(wanted)).into()
    }

    /// Returns the effective speeds by equation (11).
    pub fn effective(self, scale: &EncoderScale) -> MotorSpeeds {
        scale.apply(self.into()).into()
    }
}

impl From<MeasuredTreadSpeeds> for MeasuredMotorSpeeds {
    fn from(treads: MeasuredTreadSpeeds) -> Self {
        Self {
            traction_m_s: 0.5 * (treads.right_m_s + treads.left_m_s),
            steer_m_s: 0.5 * (treads.right_m_s - treads.left_m_s),
        }
    }
}

impl From<MeasuredMotorSpeeds> for MeasuredTreadSpeeds {
    fn from(motors: MeasuredMotorSpeeds) -> Self {
        Self {
            left_m_s: motors.traction_m_s - motors.steer_m_s,
            right_m_s: motors.traction_m_s + motors.steer_m_s,
        }
    }
}

/// Factors of equation (11), from measured to effective tread speeds.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct EncoderScale {
    /// c_l of the left tread.
    pub left: f64,
    /// c_r of the right tread.
    pub right: f64,
}

impl EncoderScale {
    /// Returns the effective speeds V_l = c_l v_l, V_r = c_r v_r: equation (11).
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
