//! The vocabulary of every port: commands to the drives, their feedback, the state of the link to them, and
//! the clock.
//!
//! A new port implements [`Port`] and needs nothing else from this crate.

mod clock;
mod inputs;
mod motors;
mod port;
mod vocabulary;

pub use clock::{Clock, Epoch, ExternalClock};
pub use inputs::MISSING_AFTER_S;
pub use inputs::{Input, InputStatus};
pub use motors::{MeasuredMotorSpeeds, MotorCommand};
pub use port::newer;
pub use port::{Port, PortInputs};
pub use vocabulary::{DriveCommand, DriveFeedback, DriveMode, LinkState, SendError};
