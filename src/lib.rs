//! The program `sidehill`: configuration files, closed-loop simulation, figures and reports.
//!
//! A library so that tests, benches and the Python module can use it; its interface is not stable.
#![allow(clippy::print_stdout, clippy::print_stderr)]

#[cfg(feature = "drive")]
pub mod bag;
pub mod campaign;
#[cfg(feature = "drive")]
pub mod check;
pub mod closed_loop;
pub mod config;
pub mod console;
#[cfg(feature = "package")]
pub mod documents;
pub mod drive_log;
mod guard_watch;
pub mod icr;
pub mod identify;
#[cfg(feature = "drive")]
pub mod init;
#[cfg(feature = "drive")]
mod interrupts;
pub mod learned;
mod limits;
#[cfg(feature = "drive")]
pub mod live_odometry;
pub mod odometry;
pub mod output;
pub mod progress;
pub mod qp_recording;
pub mod record;
#[cfg(feature = "drive")]
pub mod recording;
#[cfg(feature = "drive")]
pub mod replay;
pub mod report;
#[cfg(feature = "drive")]
pub mod route;
#[cfg(feature = "drive")]
pub mod run;
pub mod simulate;
pub mod tune;
#[cfg(feature = "drive")]
pub mod vehicle;
