//! The program `sidehill`: configuration files, closed-loop simulation, figures and reports.
//!
//! A library so that tests, benches and the Python module can use it; its interface is not stable.
#![allow(clippy::print_stdout, clippy::print_stderr)]

pub mod bag;
pub mod campaign;
pub mod check;
pub mod closed_loop;
pub mod config;
pub mod console;
#[cfg(feature = "package")]
pub mod documents;
pub mod drive;
pub mod drive_log;
mod guard_watch;
pub mod icr;
pub mod identify;
pub mod init;
pub mod learned;
mod limits;
mod log_file;
mod npz;
pub mod odometry;
pub mod output;
pub mod progress;
pub mod qp_recording;
pub mod record;
pub mod recording;
pub mod replay;
pub mod report;
pub mod route;
pub mod simulate;
pub mod tune;
