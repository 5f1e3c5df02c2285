//! The virtual rover: one simulated vehicle with its drives and injected faults, whichever port it
//! hangs on.
//!
//! [`SimulatedPort`] has it in the controller's own process, [`CanRover`] answers CAN frames, and
//! [`crate::ros2::port::rover`] puts it on the ROS 2 graph.

mod can_rover;
mod drive;
mod fault;
mod simulated_port;
mod virtual_rover;

pub use can_rover::{CanFault, CanRover, CanRoverError, CanRoverSetup};
pub use drive::{DriveConfig, VirtualDrive};
pub use fault::{Fault, FaultWindow};
pub use simulated_port::SimulatedPort;
pub use virtual_rover::{DriveStep, ReportTimer, RoverDrives, RoverSetup, VirtualRover};
