//! What the program `sidehill` is made of besides `plant` and `controller`: configuration files,
//! closed-loop simulation, figures and reports.
//!
//! Kept as a library so that tests and benches reach it; it promises no stable interface.

pub mod bridge_config;
pub mod record;
pub mod run;
pub mod vehicle;
