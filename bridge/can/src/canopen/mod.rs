//! Both ends of CANopen drives in operation: the master that sets them up and commands them, and virtual drives; and
//! what finds the nodes of a bus and reads their objects.

mod drive;
mod master;
mod scan;

pub use drive::VirtualDrives;
pub use master::Master;
pub use scan::{FoundNode, NetworkScan, ObjectReader};

#[cfg(test)]
mod tests;
