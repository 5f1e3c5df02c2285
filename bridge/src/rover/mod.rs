//! The virtual rover: one simulated vehicle with its drives and injected faults, whichever port it
//! hangs on.
//!
//! [`SimulatedPort`] has it in the controller's own process; the crates `sidehill-can` and `sidehill-ros2` let
//! it answer CAN frames and put it on the ROS 2 graph.

mod drive;
mod fault;
mod simulated_port;
mod virtual_rover;

pub use drive::{DriveConfig, VirtualDrive};
pub use fault::{Fault, FaultWindow};
pub use simulated_port::SimulatedPort;
pub use virtual_rover::{DriveStep, ReportTimer, RoverDrives, RoverSetup, VirtualRover};
