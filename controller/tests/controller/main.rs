//! The controller as its users see it: paths, routes, and closed loops with the simulated J8.

// The lints' exceptions for tests do not reach helper functions.
#![allow(clippy::unwrap_used, clippy::panic, clippy::print_stdout)]

mod adaptation;
mod ahead;
mod allocation;
mod corners;
mod endurance;
mod extra;
mod following;
mod guard;
mod memory;
mod path;
mod poses;
mod repeat;
mod rig;
mod routes;
mod serialise;
mod speed_profile;
mod stops;
mod supervision;
