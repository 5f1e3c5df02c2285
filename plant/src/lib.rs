//! What a skid-steer rover does on a slope: frames, ICR kinematics, terrain, drive train, sensors
//! and their simulation. This crate does no input or output and knows no file format.

pub mod contact;
pub mod frames;
pub mod icr;
pub mod motion;
pub mod sample;
pub mod speeds;
pub mod terrain;
pub mod vehicle;
