//! What a skid-steer rover on a slope should do: path, speed profile, reference, model-predictive
//! control, estimation and supervision. This crate does no input or output.
pub mod course;
pub mod mpc;
pub mod path;
pub mod speed_profile;
pub mod trajectory;
