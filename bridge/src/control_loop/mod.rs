//! The real-time loop: each cycle receives, decides, checks, sends and records, at absolute times.
//!
//! ```text
//! Port::receive -> ControllerRunner::decide -> Safety::step -> Port::send -> RecordSink
//! ```
//!
//! [`LoopSetup::start`] starts the loop and the controller, each in its thread. [`ControlLoop::run`]
//! runs until the course is finished, the time is over, or a signal comes, and returns the
//! [`RunEnding`]. [`channel`] connects the loop to the client that gives it paths; [`record`] takes what is logged,
//! [`learned`] what was learned, out of it without waiting.

mod actions;
pub mod channel;
mod config;
mod cycle;
mod jog;
pub mod learned;
pub mod record;
mod run;
pub mod runner;
pub mod scheduling;
mod setup;
pub mod tap;
mod timing;

pub use config::CycleConfig;
pub use cycle::ControlLoop;
pub use jog::JogRunner;
pub use run::{RunEnding, RunOptions, Signals};
pub use setup::{LoopError, LoopSetup, LoopThread, RunReport};
pub use timing::LoopTiming;

#[cfg(test)]
mod tests;
