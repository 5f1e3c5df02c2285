//! What a skid-steer rover does on a slope: frames, ICR kinematics, terrain, drive train, sensors
//! and their simulation. This crate does no input or output and knows no file format.
//!
//! Frames are those of the paper: body X right, Y forward, Z up; world X_g and Y_g horizontal, Z_g up;
//! yaw counter-clockwise from Y_g ([`frames`]). A rover that turns on the spot across a slope slides
//! downhill, and on level ground it does not:
//!
//! ```
//! use sidehill_plant::frames::Attitude;
//! use sidehill_plant::speeds::TreadSpeeds;
//! use sidehill_plant::vehicle::Vehicle;
//!
//! let treads = TreadSpeeds { left_m_s: -0.3, right_m_s: 0.3 };
//! let right_side_down = Attitude { roll_rad: 0.1, pitch_rad: 0.0 };
//! let vehicle = Vehicle::j8();
//! let level = vehicle.body_velocity(Attitude::default(), treads);
//! let slope = vehicle.body_velocity(right_side_down, treads);
//! assert_eq!(level, vehicle.on_level_ground().body_velocity(right_side_down, treads));
//! assert!(slope.right_m_s > level.right_m_s + 0.03);
//! ```

pub mod bounds;
pub mod contact;
pub mod dead_reckoning;
pub mod drive_train;
pub mod extension;
pub mod fingerprint;
pub mod frames;
pub mod icr;
mod icr_parameters;
pub mod identification;
mod linearised;
pub mod log;
pub mod motion;
pub mod number;
pub mod odometry;
pub mod prediction;
pub mod sample;
pub mod sensors;
pub mod simulation;
pub mod slip_gains;
pub mod speeds;
pub mod statistics;
pub mod terrain;
#[cfg(test)]
mod test_support;
pub mod vehicle;
