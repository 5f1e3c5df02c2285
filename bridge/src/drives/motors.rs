use super::vocabulary::DriveCommand;
use sidehill_plant::speeds::{MeasuredTreadSpeeds, MotorSpeeds, TreadSpeeds};
use sidehill_plant::vehicle::SpeedCorrection;

/// Motor speeds as the motors' own sensors measure them: half sum and half difference of v_l and
/// v_r, before c_l and c_r.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
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

    /// Returns what the motors must do for the effective speeds `effective`: equation (11) solved for
    /// v_l and v_r.
    pub fn reaching(effective: MotorSpeeds, correction: &SpeedCorrection) -> Self {
        correction.invert(TreadSpeeds::from(effective)).into()
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

/// A [`DriveCommand`] in the speeds that the motors' own controllers take.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MotorCommand {
    /// Speeds, before c_l and c_r.
    pub speeds: MeasuredMotorSpeeds,
    /// Whether the drives are to be enabled.
    pub enable: bool,
}

impl MotorCommand {
    /// Returns what the motors are to do for `command`.
    pub fn reaching(command: &DriveCommand, correction: &SpeedCorrection) -> Self {
        Self {
            speeds: MeasuredMotorSpeeds::reaching(command.speeds, correction),
            enable: command.enable,
        }
    }
}
