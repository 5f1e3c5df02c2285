//! How a rover is told to drive: what is on its CAN bus, when it may move, through which port, and
//! in which cycle.
//!
//! ```text
//! Decision -> Safety -> Port
//! ```

pub mod can;
pub mod motors;
pub mod safety;
