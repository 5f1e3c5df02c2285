//! What is on the CAN bus, apart from any socket: database, signals, messages and their layout.

pub mod cia402;
pub mod config;
pub mod controller_side;
pub mod database;
pub mod frame;
pub mod layout;
pub mod message;
mod port;
pub mod signal;
mod socket;
pub mod vehicle_side;

pub use port::CanPort;
pub use socket::{BusEvent, BusMonitor, RestartAnswer, Sender};

#[cfg(test)]
mod tests;
