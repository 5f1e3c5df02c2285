use serde::Serialize;
use sidehill_plant::speeds::MotorSpeeds;

/// What the drives are told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveCommand {
    /// Effective speeds.
    pub speeds: MotorSpeeds,
    /// Whether the drives shall be on.
    pub enable: bool,
    /// Whether drives that can be told to do so may forget a fault: only after an operator has armed.
    pub fault_reset: bool,
}

impl DriveCommand {
    /// Zero, and off.
    pub const OFF: Self = Self {
        speeds: MotorSpeeds::STOP,
        enable: false,
        fault_reset: false,
    };
}

/// State of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveMode {
    /// Off, and can be switched on.
    Disabled,
    /// Follows commands.
    Enabled,
    /// Somebody pressed the button.
    EmergencyStop,
    /// The drive has a fault of its own.
    Fault,
}

impl DriveMode {
    /// Returns the worse of two drives' states: emergency stop before fault before off before on.
    pub fn worse(self, other: Self) -> Self {
        [Self::EmergencyStop, Self::Fault, Self::Disabled]
            .into_iter()
            .find(|mode| self == *mode || other == *mode)
            .unwrap_or(Self::Enabled)
    }
}

/// What both drives say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveFeedback {
    /// Effective speeds reached.
    pub speeds: MotorSpeeds,
    /// SafetyState; the worse of the two drives'.
    pub mode: DriveMode,
}

/// State of the bus as far as the port knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum LinkState {
    /// In order.
    #[default]
    Active,
    /// Many errors.
    Warning,
    /// Too many errors: the node only listens for them.
    Passive,
    /// The node has left the bus.
    BusOff,
    /// The interface is down.
    Down,
    /// There is no interface.
    Absent,
}

impl LinkState {
    /// Returns whether frames may get through.
    pub fn carries(self) -> bool {
        matches!(self, Self::Active | Self::Warning | Self::Passive)
    }
}

/// Why a frame was not sent.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SendError {
    /// The interface's queue is full; the frame is dropped, since a later one is newer.
    #[error("the queue of the interface is full")]
    QueueFull,
    /// The interface is down.
    #[error("the interface is down")]
    Down,
    /// There is no interface, or it cannot be opened.
    #[error("there is no such interface, or no permission to use it")]
    Absent,
    /// The frame's values do not fit.
    #[error("the command does not fit its signals")]
    Values,
    /// Another error of the system.
    #[error("system error {errno}")]
    System {
        /// Its number.
        errno: i32,
    },
}
