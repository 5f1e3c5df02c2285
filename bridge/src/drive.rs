//! The drives' own side of the handshake, for virtual vehicles.

use crate::can::layout::DriveMode;
use crate::motors::MeasuredMotorSpeeds;
use serde::{Deserialize, Serialize};
use sidehill_plant::vehicle::RangeError;

/// Settings of virtual drives.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct DriveConfig {
    /// Largest age of a command before the drives stop and switch off, s.
    pub command_timeout_s: f64,
}

impl Default for DriveConfig {
    fn default() -> Self {
        Self {
            command_timeout_s: 0.2,
        }
    }
}

/// What the drives are told now.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveInput {
    /// Instant, s.
    pub time_s: f64,
    /// Newest command: its instant, speeds, and whether the drives shall be on.
    pub told: Option<(f64, MeasuredMotorSpeeds, bool)>,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: bool,
}

/// Both drives together: off until they are told zeros, off, and then on.
#[derive(Debug, Clone)]
pub struct VirtualDrive {
    config: DriveConfig,
    mode: DriveMode,
    /// Whether zeros, off, have been told since the drives went off.
    ready: bool,
}

impl VirtualDrive {
    /// Returns drives that are off.
    ///
    /// # Errors
    /// [`RangeError`] for a time-out out of range.
    pub fn new(config: DriveConfig) -> Result<Self, RangeError> {
        RangeError::check(
            "drive.command_timeout_s",
            config.command_timeout_s,
            0.01,
            5.0,
            "from 0.01 to 5 s",
        )?;
        Ok(Self {
            config,
            mode: DriveMode::Disabled,
            ready: false,
        })
    }

    /// Returns the state.
    pub fn mode(&self) -> DriveMode {
        self.mode
    }

    /// Moves on and returns the speeds that the motors head for.
    pub fn step(&mut self, input: &DriveInput) -> MeasuredMotorSpeeds {
        const ZERO: MeasuredMotorSpeeds = MeasuredMotorSpeeds {
            traction_m_s: 0.0,
            steer_m_s: 0.0,
        };
        let told = input
            .told
            .filter(|(told_s, ..)| input.time_s - told_s <= self.config.command_timeout_s);
        if input.emergency_stop {
            self.mode = DriveMode::EmergencyStop;
            self.ready = false;
            return ZERO;
        }
        match (self.mode, told) {
            (DriveMode::Enabled, Some((_, speeds, true))) => speeds,
            (DriveMode::Enabled, _) => {
                self.mode = DriveMode::Disabled;
                self.ready = false;
                ZERO
            }
            (_, None) => {
                self.mode = DriveMode::Disabled;
                self.ready = false;
                ZERO
            }
            (_, Some((_, speeds, on))) => {
                self.mode = DriveMode::Disabled;
                if speeds != ZERO {
                    self.ready = false;
                } else if !on {
                    self.ready = true;
                } else if self.ready {
                    self.mode = DriveMode::Enabled;
                }
                ZERO
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn told(time_s: f64, speed: f64, on: bool) -> DriveInput {
        DriveInput {
            time_s,
            told: Some((
                time_s,
                MeasuredMotorSpeeds {
                    traction_m_s: speed,
                    steer_m_s: 0.0,
                },
                on,
            )),
            emergency_stop: false,
        }
    }

    #[test]
    fn drives_switch_on_only_after_zeros_and_off() {
        let mut drive = VirtualDrive::new(DriveConfig::default()).unwrap();
        for (speed, on) in [(0.0, true), (0.5, true), (0.5, false), (0.5, true)] {
            assert_eq!(drive.step(&told(0.0, speed, on)).traction_m_s, 0.0);
            assert_eq!(drive.mode(), DriveMode::Disabled);
        }
        drive.step(&told(0.1, 0.0, false));
        drive.step(&told(0.2, 0.0, true));
        assert_eq!(drive.mode(), DriveMode::Enabled);
        assert_eq!(drive.step(&told(0.3, 0.5, true)).traction_m_s, 0.5);
    }

    #[test]
    fn a_silent_controller_and_an_emergency_stop_switch_off_for_good() {
        for emergency_stop in [false, true] {
            let mut drive = VirtualDrive::new(DriveConfig::default()).unwrap();
            drive.step(&told(0.0, 0.0, false));
            drive.step(&told(0.05, 0.0, true));
            let mut input = told(0.1, 0.5, true);
            assert_eq!(drive.step(&input).traction_m_s, 0.5);
            input.time_s = if emergency_stop { 0.1 } else { 0.31 };
            input.emergency_stop = emergency_stop;
            assert_eq!(drive.step(&input).traction_m_s, 0.0);
            assert_ne!(drive.mode(), DriveMode::Enabled);
            for step in 0..20 {
                let time_s = 0.4 + 0.05 * f64::from(step);
                assert_eq!(drive.step(&told(time_s, 0.5, true)).traction_m_s, 0.0);
            }
        }
    }
}
