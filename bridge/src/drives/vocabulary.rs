use serde::Serialize;
use sidehill_plant::speeds::MotorSpeeds;

/// A command to both drives, as the safety gives it to a port.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveCommand {
    /// Effective speeds, after c_l and c_r.
    pub speeds: MotorSpeeds,
    /// Whether the drives are to be enabled.
    pub enable: bool,
    /// Whether drives that support it may reset a fault. Only while an operator's arming is carried
    /// out.
    pub fault_reset: bool,
}

impl DriveCommand {
    /// Zero speed and disable.
    pub const OFF: Self = Self {
        speeds: MotorSpeeds::STOP,
        enable: false,
        fault_reset: false,
    };
}

/// State of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveMode {
    /// Off, and can be enabled.
    Disabled,
    /// Follows commands.
    Enabled,
    /// Its emergency stop is pressed.
    EmergencyStop,
    /// It reports a fault.
    Fault,
    /// It takes no commands and may go on as commanded before: a CANopen node that is not operational.
    NotOperational,
    /// It is on and does not follow speeds: somebody has changed its mode of operation.
    OtherMode,
    /// It is on, and its reported speed stays the same to the bit while its commands change.
    Frozen,
}

impl DriveMode {
    /// Returns the worse of two drives' states: emergency stop, then fault, then not operational, then
    /// in another mode, then frozen, then disabled.
    pub fn worse(self, other: Self) -> Self {
        let from_worst = [
            Self::EmergencyStop,
            Self::Fault,
            Self::NotOperational,
            Self::OtherMode,
            Self::Frozen,
            Self::Disabled,
        ];
        let mut found = from_worst.into_iter();
        found
            .find(|mode| self == *mode || other == *mode)
            .unwrap_or(Self::Enabled)
    }
}

/// What both drives report.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveFeedback {
    /// Effective speeds reached, after c_l and c_r.
    pub speeds: MotorSpeeds,
    /// State; the worse of the two drives'.
    pub mode: DriveMode,
}

/// State of the link to the drives, as far as the port knows it. CAN has all of them; a port of
/// another kind uses `Active`, `Down` and `Absent`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// Carries messages.
    #[default]
    Active,
    /// Carries messages, with errors: CAN's error-warning.
    Warning,
    /// Carries messages, with so many errors that this side may no longer signal them: CAN's
    /// error-passive.
    Passive,
    /// This side has left the link after too many errors.
    BusOff,
    /// The interface is down.
    Down,
    /// The interface does not exist.
    Absent,
    /// Carries messages, and another node sends those that are this program's alone.
    Foreign,
}

impl LinkState {
    /// Returns whether messages may get through and only this program leads the drives.
    pub fn carries(self) -> bool {
        matches!(self, Self::Active | Self::Warning | Self::Passive)
    }
}

/// Why a command was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// The queue of the interface is full. The command is dropped, since a later one is newer.
    #[error("the queue of the interface is full")]
    QueueFull,
    /// The interface is down.
    #[error("the interface is down")]
    Down,
    /// The interface does not exist, or cannot be opened.
    #[error("there is no such interface, or no permission to use it")]
    Absent,
    /// The thread that sends has ended.
    #[error("the thread that sends commands has ended")]
    ThreadEnded,
    /// A value of the command does not fit its signal.
    #[error("the command does not fit its signals")]
    Values,
    /// Another error of the system.
    #[error("system error {errno}")]
    System {
        /// Its number.
        errno: i32,
    },
}
