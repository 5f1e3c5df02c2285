use serde::Serialize;
use sidehill_bridge::drives::DriveMode;
use std::fmt;

/// State of a drive by its statusword: the state machine of CiA 402.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PowerState {
    /// It starts.
    NotReadyToSwitchOn,
    /// Off, until it is commanded to shut down (get ready).
    SwitchOnDisabled,
    /// Off, and ready.
    ReadyToSwitchOn,
    /// On, without torque.
    SwitchedOn,
    /// It follows its target.
    OperationEnabled,
    /// It stops quickly, or holds after that.
    QuickStopActive,
    /// It reacts to a fault.
    FaultReactionActive,
    /// Off by a fault.
    Fault,
}

impl PowerState {
    /// Returns the state of a statusword; none for a word that CiA 402 does not define.
    pub fn of(statusword: u16) -> Option<Self> {
        // Bit 5, quick stop, is significant in some of the states only.
        match (statusword & 0x4F, statusword & 0x6F) {
            (0x00, _) => Some(Self::NotReadyToSwitchOn),
            (0x40, _) => Some(Self::SwitchOnDisabled),
            (0x0F, _) => Some(Self::FaultReactionActive),
            (0x08, _) => Some(Self::Fault),
            (_, 0x21) => Some(Self::ReadyToSwitchOn),
            (_, 0x23) => Some(Self::SwitchedOn),
            (_, 0x27) => Some(Self::OperationEnabled),
            (_, 0x07) => Some(Self::QuickStopActive),
            _ => None,
        }
    }

    /// Returns the statusword of a drive that is in the state and not at its own controls.
    pub fn statusword(self) -> u16 {
        const REMOTE: u16 = 1 << 9;
        const VOLTAGE: u16 = 1 << 4;
        REMOTE
            | match self {
                Self::NotReadyToSwitchOn => 0x00,
                Self::SwitchOnDisabled => 0x40,
                Self::ReadyToSwitchOn => 0x21 | VOLTAGE,
                Self::SwitchedOn => 0x23 | VOLTAGE,
                Self::OperationEnabled => 0x27 | VOLTAGE,
                Self::QuickStopActive => 0x07 | VOLTAGE,
                Self::FaultReactionActive => 0x0F | VOLTAGE,
                Self::Fault => 0x08,
            }
    }

    /// Returns the state that a controlword leads to from this one: the transitions of CiA 402 but
    /// for 16, back from a quick stop, which is optional. `before` is the controlword before it.
    pub fn after(self, controlword: u16, before: u16) -> Self {
        const VOLTAGE: u16 = 1 << 1;
        const NO_QUICK_STOP: u16 = 1 << 2;
        let rises = controlword & !before & Controlword::FAULT_RESET != 0;
        let word = controlword & 0x0F;
        let off = word & VOLTAGE == 0;
        let stop = !off && word & NO_QUICK_STOP == 0;
        match (self, word) {
            (Self::Fault, _) if rises => Self::SwitchOnDisabled,
            (Self::NotReadyToSwitchOn | Self::FaultReactionActive | Self::Fault, _) => self,
            (_, _) if off => Self::SwitchOnDisabled,
            (Self::OperationEnabled | Self::QuickStopActive, _) if stop => Self::QuickStopActive,
            (_, _) if stop => Self::SwitchOnDisabled,
            (Self::QuickStopActive, _) => self,
            (Self::SwitchOnDisabled, 0x07 | 0x0F) => self,
            (Self::ReadyToSwitchOn | Self::OperationEnabled, 0x07) => Self::SwitchedOn,
            (Self::ReadyToSwitchOn | Self::SwitchedOn, 0x0F) => Self::OperationEnabled,
            // Bit 3 counts in what is left only together with bit 0.
            (_, 0x06 | 0x0E) => Self::ReadyToSwitchOn,
            _ => self,
        }
    }

    /// Returns what the state means to the safety state machine. A quick stop that this program did not command is an
    /// emergency stop.
    pub fn mode(self) -> DriveMode {
        match self {
            Self::NotReadyToSwitchOn
            | Self::SwitchOnDisabled
            | Self::ReadyToSwitchOn
            | Self::SwitchedOn => DriveMode::Disabled,
            Self::OperationEnabled => DriveMode::Enabled,
            Self::QuickStopActive => DriveMode::EmergencyStop,
            Self::FaultReactionActive | Self::Fault => DriveMode::Fault,
        }
    }

    /// Returns the controlword that leads a step further to [`Self::OperationEnabled`].
    pub fn controlword_on(self) -> u16 {
        match self {
            Self::SwitchOnDisabled => Controlword::SHUTDOWN,
            Self::ReadyToSwitchOn => Controlword::SWITCH_ON,
            Self::SwitchedOn | Self::OperationEnabled => Controlword::ENABLE_OPERATION,
            Self::QuickStopActive => Controlword::QUICK_STOP,
            Self::NotReadyToSwitchOn | Self::FaultReactionActive | Self::Fault => {
                Controlword::DISABLE_VOLTAGE
            }
        }
    }
}

impl fmt::Display for PowerState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::NotReadyToSwitchOn => "not ready to switch on",
            Self::SwitchOnDisabled => "switch on disabled",
            Self::ReadyToSwitchOn => "ready to switch on",
            Self::SwitchedOn => "switched on",
            Self::OperationEnabled => "operation enabled",
            Self::QuickStopActive => "quick stop active",
            Self::FaultReactionActive => "fault reaction active",
            Self::Fault => "fault",
        })
    }
}

/// Controlwords of CiA 402.
pub struct Controlword;

impl Controlword {
    /// Off at once, without a ramp.
    pub const DISABLE_VOLTAGE: u16 = 0x0000;
    /// Off on the drive's quick-stop ramp.
    pub const QUICK_STOP: u16 = 0x0002;
    /// Ready.
    pub const SHUTDOWN: u16 = 0x0006;
    /// On, without torque.
    pub const SWITCH_ON: u16 = 0x0007;
    /// On.
    pub const ENABLE_OPERATION: u16 = 0x000F;
    /// Its rising bit resets a fault.
    pub const FAULT_RESET: u16 = 0x0080;
}
