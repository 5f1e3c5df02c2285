//! Between the treads as the models know them and the two motors as their controllers count.

use sidehill_plant::speeds::{MeasuredTreadSpeeds, MotorSpeeds, TreadSpeeds};
use sidehill_plant::vehicle::SpeedCorrection;

/// Motor speeds as the motors' own sensors see them: half sum and half difference of v_l and v_r,
/// before c_l and c_r.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MeasuredMotorSpeeds {
    /// (v_r + v_l)/2, m/s.
    pub traction_m_s: f64,
    /// (v_r - v_l)/2, m/s.
    pub steer_m_s: f64,
}

impl MeasuredMotorSpeeds {
    /// Returns what the motors must do for the effective speeds `wanted`: equation (11) solved for
    /// v_l and v_r.
    pub fn reaching(wanted: MotorSpeeds, correction: &SpeedCorrection) -> Self {
        correction.invert(TreadSpeeds::from(wanted)).into()
    }

    /// Returns the effective speeds by equation (11).
    pub fn effective(self, correction: &SpeedCorrection) -> MotorSpeeds {
        correction.apply(self.into()).into()
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
