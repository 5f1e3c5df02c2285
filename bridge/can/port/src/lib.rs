//! Drives and sensors on a CAN bus, over SocketCAN.
//!
//! What the frames mean is `sidehill-can`'s.

mod bus_monitor;
mod inputs;
mod interface;
mod port;
mod record;
mod sender;
mod system;

pub use bus_monitor::{BusEvent, BusMonitor, RestartAnswer};
pub use inputs::{CanInputs, bus_fault};
pub use interface::{bit_rate, lost_frames};
pub use port::CanPort;
pub use record::CanRecord;
pub use sender::Sender;
