//! The program `sidehill-drive`: what drives a vehicle, real or virtual, in real time.
//!
//! A library so that tests can use it; its interface is not stable.
#![allow(clippy::print_stdout, clippy::print_stderr)]

pub mod can;
pub mod drive_route;
pub mod faults;
mod interrupts;
mod keeper;
pub mod odometry;
mod recording;
mod ros2;
pub mod route;
pub mod run;
pub mod vehicle;

/// Version of the program, its commit, and its DDS.
pub const VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    " (commit ",
    env!("SIDEHILL_COMMIT"),
    "; DDS: ",
    env!("SIDEHILL_DDS"),
    ")"
);
