//! How a rover is told to drive: what is on its CAN bus, when it may move, through which port, and
//! in which cycle.
//!
//! ```text
//! Decision -> Safety -> Port
//! ```

pub mod can;
pub mod control_loop;
pub mod drives;
pub mod ros2;
pub mod rover;
pub mod safety;
