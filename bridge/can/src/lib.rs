//! What is on the CAN bus, apart from any socket: database, signals, messages and their layout.

pub mod canopen;
pub mod cia402;
pub mod commissioning;
pub mod config;
pub mod controller_side;
pub mod database;
pub mod eds;
pub mod frame;
pub mod frozen;
pub mod layout;
pub mod load;
pub mod message;
pub mod rover;
pub mod signal;
pub mod vehicle_side;
pub mod watch;

#[cfg(test)]
mod tests;
