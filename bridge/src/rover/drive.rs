use super::virtual_rover::{DriveStep, RoverDrives};
use crate::drives::{DriveMode, MeasuredMotorSpeeds, MotorCommand};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::sample::Stamped;
use sidehill_plant::simulation::SimulationError;
use sidehill_plant::vehicle::RangeError;

/// Settings of virtual drives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriveConfig {
    /// Age of a command at which the drives stop and switch off.
    pub command_timeout_s: f64,
}

impl Default for DriveConfig {
    fn default() -> Self {
        Self {
            command_timeout_s: 0.2,
        }
    }
}

/// Both drives together: disabled until they are commanded zero speed, first disabled and then
/// enabled.
#[derive(Debug, Clone)]
pub struct VirtualDrive {
    config: DriveConfig,
    command: Option<Stamped<MotorCommand>>,
    mode: DriveMode,
    /// Whether zero speed, disabled, has been commanded since the drives were disabled.
    ready: bool,
}

impl VirtualDrive {
    /// Returns drives that are disabled.
    ///
    /// # Errors
    /// [`RangeError`] for a time-out out of range.
    pub fn new(config: DriveConfig) -> Result<Self, RangeError> {
        Bounds::new(0.01, 5.0, "s").check("drive.command_timeout_s", config.command_timeout_s)?;
        Ok(Self {
            config,
            command: None,
            mode: DriveMode::Disabled,
            ready: false,
        })
    }

    /// Sets the newest command, with the instant at which it arrived.
    pub fn set_command(&mut self, command: Option<Stamped<MotorCommand>>) {
        self.command = command;
    }

    /// Returns the state.
    pub fn mode(&self) -> DriveMode {
        self.mode
    }

    /// Advances and returns the speeds that the motors head for.
    pub fn step(&mut self, time_s: f64, emergency_stop: bool) -> MeasuredMotorSpeeds {
        let command = self
            .command
            .filter(|command| time_s - command.time_s <= self.config.command_timeout_s)
            .map(|command| command.value);
        if emergency_stop {
            self.mode = DriveMode::EmergencyStop;
            self.ready = false;
            return MeasuredMotorSpeeds::STOP;
        }
        match (self.mode, command) {
            (DriveMode::Enabled, Some(command)) if command.enable => return command.speeds,
            (DriveMode::Enabled, _) | (_, None) => {
                self.mode = DriveMode::Disabled;
                self.ready = false;
            }
            (_, Some(command)) => {
                self.mode = DriveMode::Disabled;
                if command.speeds != MeasuredMotorSpeeds::STOP {
                    self.ready = false;
                } else if !command.enable {
                    self.ready = true;
                } else if self.ready {
                    self.mode = DriveMode::Enabled;
                }
            }
        }
        MeasuredMotorSpeeds::STOP
    }
}

impl RoverDrives for VirtualDrive {
    type Error = SimulationError;

    fn step(&mut self, step: &DriveStep) -> Result<MeasuredMotorSpeeds, SimulationError> {
        Ok(self.step(step.time_s, step.emergency_stop))
    }

    fn mode(&self) -> DriveMode {
        self.mode
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    impl VirtualDrive {
        /// Commands and steps at the same instant; returns the traction headed for.
        fn command(&mut self, time_s: f64, speed: f64, enable: bool) -> f64 {
            self.set_command(Some(Stamped {
                time_s,
                value: MotorCommand {
                    speeds: MeasuredMotorSpeeds {
                        traction_m_s: speed,
                        steer_m_s: 0.0,
                    },
                    enable,
                },
            }));
            self.step(time_s, false).traction_m_s
        }
    }

    #[test]
    fn drives_are_enabled_only_after_zero_speed_disabled() {
        let mut drive = VirtualDrive::new(DriveConfig::default()).unwrap();
        for (speed, enable) in [(0.0, true), (0.5, true), (0.5, false), (0.5, true)] {
            assert_eq!(drive.command(0.0, speed, enable), 0.0);
            assert_eq!(drive.mode(), DriveMode::Disabled);
        }
        drive.command(0.1, 0.0, false);
        drive.command(0.2, 0.0, true);
        assert_eq!(drive.mode(), DriveMode::Enabled);
        assert_eq!(drive.command(0.3, 0.5, true), 0.5);
    }

    #[test]
    fn a_silent_controller_and_an_emergency_stop_disable_for_good() {
        for emergency_stop in [false, true] {
            let mut drive = VirtualDrive::new(DriveConfig::default()).unwrap();
            drive.command(0.0, 0.0, false);
            drive.command(0.05, 0.0, true);
            assert_eq!(drive.command(0.1, 0.5, true), 0.5);
            let time_s = if emergency_stop { 0.1 } else { 0.31 };
            assert_eq!(drive.step(time_s, emergency_stop).traction_m_s, 0.0);
            assert_ne!(drive.mode(), DriveMode::Enabled);
            for step in 0..20 {
                let time_s = 0.4 + 0.05 * f64::from(step);
                assert_eq!(drive.command(time_s, 0.5, true), 0.0);
            }
        }
    }
}
