//! What a skid-steer rover on a slope should do: path, speed profile, reference, model-predictive
//! control, estimation and supervision. This crate does no input or output.
//!
//! A [`Controller`](controller::Controller) turns a [`Sample`](sidehill_plant::sample::Sample) of the
//! sensors into a [`Decision`](controller::Decision) once a control period:
//!
//! ```text
//! Sample -> Estimate -> Horizon -> Linearised -> Solution -> Decision
//! (sensors)  (state)    (targets)  (A, B, c)     (QP)        (safe command)
//! ```
//!
//! On a vehicle, call [`Controller::step`](controller::Controller::step) yourself and send the drives
//! [`Decision::command_for_drives`](controller::Decision::command_for_drives). In simulation,
//! [`ClosedLoop`](closed_loop::ClosedLoop) does both with anything that implements
//! [`Plant`](sidehill_plant::simulation::Plant):
//!
//! ```
#![doc = include_str!("../examples/follow.rs")]
//! ```

mod clock;
pub mod closed_loop;
pub mod config;
pub mod controller;
pub mod course;
pub mod estimator;
pub mod guard;
pub mod memory;
pub mod mpc;
pub mod path;
pub mod pure_pursuit;
pub mod reference;
mod serde_form;
pub mod speed_profile;
pub mod tracked_point;
pub mod trajectory;
