//! Drives and sensors over topics.
//!
//! ```text
//! topics -> inputs (thread) -> readings -> Ros2Port -> control loop
//! control loop -> Ros2Port -> commands (thread) -> topics
//! ```
//!
//! The control loop waits for neither thread.

mod course;
mod drives;
pub(crate) mod emergency_stop;
pub(crate) mod fixes;
pub(crate) mod graph_monitor;
pub(crate) mod inputs;
pub(crate) mod readings;
pub mod rover;
pub(crate) mod shared_inputs;
mod stamp_clock;

pub use drives::Ros2Port;
pub use fixes::{FixReading, FixSettings};
pub use shared_inputs::Note;
