//! `--record` and `--live` of real-time drives.

mod drive;
mod vehicle;

pub(crate) use drive::DriveRecording;
pub(crate) use vehicle::VehicleRecording;
