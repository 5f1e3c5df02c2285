//! What is on the CAN bus, apart from any socket: database, signals, messages and their layout.

mod bus_monitor;
pub mod cia402;
pub mod config;
pub mod controller_side;
pub mod database;
pub mod frame;
mod inputs;
pub mod layout;
pub mod message;
mod port;
mod record;
mod sender;
pub mod signal;
mod system;
pub mod vehicle_side;

pub use bus_monitor::{BusEvent, BusMonitor, RestartAnswer};
pub use inputs::CanInputs;
pub use port::CanPort;
pub use record::CanRecord;
pub use sender::Sender;

#[cfg(test)]
mod tests;
