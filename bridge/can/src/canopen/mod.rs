//! Both ends of CANopen drives in operation: the master that sets them up and commands them, and virtual drives.

mod drive;
mod master;

pub use drive::VirtualDrives;
pub use master::Master;

#[cfg(test)]
mod tests;
