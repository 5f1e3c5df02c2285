//! What a skid-steer rover on a slope should do: path, speed profile, reference, model-predictive
//! control, estimation and supervision. This crate does no input or output.

pub mod config;
pub mod controller;
pub mod course;
pub mod estimator;
pub mod mpc;
pub mod path;
pub mod pure_pursuit;
pub mod reference;
pub mod speed_profile;
pub mod trajectory;
