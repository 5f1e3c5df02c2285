//! What a skid-steer rover does on a slope: frames, ICR kinematics, terrain, drive train, sensors
//! and their simulation. This crate does no input or output and knows no file format.

pub mod contact;
pub mod correction;
pub mod dead_reckoning;
pub mod drive_train;
pub mod extension;
pub mod frames;
pub mod icr;
pub mod identification;
pub mod log;
pub mod motion;
pub mod odometry;
pub mod prediction;
pub mod sample;
pub mod sensors;
pub mod simulation;
pub mod speeds;
pub mod terrain;
pub mod vehicle;
