//! Speeds of treads and motors, each its own type so that sides and stages cannot be swapped.

/// Longitudinal speeds of the treads after correction (V_l, V_r of the paper).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct TreadSpeeds {
    /// Left tread V_l, m/s, forward positive.
    pub left_m_s: f64,
    /// Right tread V_r, m/s, forward positive.
    pub right_m_s: f64,
}

/// Tread speeds as an encoder reports them (v_l, v_r of the paper), before c_l and c_r.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasuredTreadSpeeds {
    /// Left tread v_l, m/s, forward positive.
    pub left_m_s: f64,
    /// Right tread v_r, m/s, forward positive.
    pub right_m_s: f64,
}

/// Speeds of the J8's two motors, as their share of the tread speeds.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotorSpeeds {
    /// Traction tau = (V_r + V_l)/2, m/s.
    pub traction_m_s: f64,
    /// Steer sigma = (V_r - V_l)/2, m/s, positive turns counter-clockwise.
    pub steer_m_s: f64,
}

impl MotorSpeeds {
    /// A vehicle that stands.
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
