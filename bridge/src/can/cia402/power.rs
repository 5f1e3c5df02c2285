use crate::can::layout::DriveMode;

/// State of a drive's power as its statusword tells it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PowerState {
    /// It starts.
    NotReadyToSwitchOn,
    /// Off, and locked until it is told to get ready.
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
    /// Returns the state that a statusword tells, `None` for a word that CiA 402 does not have.
    pub fn of(statusword: u16) -> Option<Self> {
        // Bit 5, quick stop, tells only some of the states apart.
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

    /// Returns what the state means to the safety. A quick stop that nobody here asked for is an
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
