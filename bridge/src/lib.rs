//! How a rover is told to drive: what is on its CAN bus, when it may move, through which port, and
//! in which cycle.
//!
//! ```text
//! Decision -> Safety -> Port
//! ```

pub mod bus;
pub mod can;
pub mod clock;
pub mod cycle;
pub mod drive;
pub mod mission;
pub mod motors;
pub mod pilot;
pub mod port;
pub mod realtime;
pub mod record;
pub mod ros2;
pub mod safety;
pub mod virtual_vehicle;
