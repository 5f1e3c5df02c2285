use super::vocabulary::DriveCommand;
use sidehill_plant::speeds::EncoderScale;
pub use sidehill_plant::speeds::MeasuredMotorSpeeds;

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
    pub fn reaching(command: &DriveCommand, scale: &EncoderScale) -> Self {
        Self {
            speeds: MeasuredMotorSpeeds::reaching(command.speeds, scale),
            enable: command.enable,
        }
    }
}
