use crate::cia402::PowerState;
use crate::message::{DriveRole, MessageCodec};
use sidehill_bridge::drives::DriveMode;

/// What one drive reports.
#[derive(Clone)]
pub struct DriveCodec {
    /// What it moves.
    pub role: DriveRole,
    /// Its message.
    pub message: MessageCodec,
    /// Its states.
    pub states: DriveStates,
}

/// Off and on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EnableValues {
    /// Value for off.
    pub off: f64,
    /// Value for on.
    pub on: f64,
}

/// Which values of a signal mean which state.
#[derive(Debug, Clone, PartialEq)]
pub enum DriveStates {
    /// Those of a list.
    Values(Vec<(f64, DriveMode)>),
    /// Those of CiA 402.
    Statusword,
}

impl DriveStates {
    /// Returns the state of a value; none for an unknown one.
    pub fn mode(&self, value: f64) -> Option<DriveMode> {
        match self {
            Self::Values(values) => values
                .iter()
                .find_map(|(listed, mode)| ((listed - value).abs() < 1e-9).then_some(*mode)),
            Self::Statusword => PowerState::of(value as u16).map(PowerState::mode),
        }
    }

    /// Returns the first value that is listed for a state.
    pub fn value(&self, mode: DriveMode) -> Option<f64> {
        match self {
            Self::Values(values) => values
                .iter()
                .find_map(|(value, listed)| (*listed == mode).then_some(*value)),
            Self::Statusword => None,
        }
    }
}
