//! The program `sidehill`: configuration files, closed-loop simulation, figures and reports.
//!
//! A library so that tests, benches and the Python module can use it; its interface is not stable. In a browser
//! (bridge/play) it has what a simulation needs, and nothing that needs an operating system.
#![allow(clippy::print_stdout, clippy::print_stderr)]
#![cfg_attr(target_family = "wasm", allow(dead_code, unused_imports))]

pub mod closed_loop;
pub mod config;
mod foreign;
mod guard_watch;
pub mod learned;
mod limits;
pub mod record;

#[cfg(not(target_family = "wasm"))]
pub mod bag;
#[cfg(not(target_family = "wasm"))]
pub mod campaign;
#[cfg(not(target_family = "wasm"))]
pub mod check;
#[cfg(not(target_family = "wasm"))]
pub mod console;
#[cfg(all(feature = "package", not(target_family = "wasm")))]
pub mod documents;
#[cfg(not(target_family = "wasm"))]
pub mod drive;
#[cfg(not(target_family = "wasm"))]
pub mod drive_log;
#[cfg(not(target_family = "wasm"))]
pub mod drive_report;
#[cfg(not(target_family = "wasm"))]
pub mod exit;
#[cfg(not(target_family = "wasm"))]
pub mod icr;
#[cfg(not(target_family = "wasm"))]
pub mod identify;
#[cfg(not(target_family = "wasm"))]
pub mod init;
#[cfg(not(target_family = "wasm"))]
mod log_file;
#[cfg(not(target_family = "wasm"))]
pub mod migrate;
#[cfg(not(target_family = "wasm"))]
pub mod odometry;
#[cfg(not(target_family = "wasm"))]
pub mod output;
#[cfg(not(target_family = "wasm"))]
pub mod play;
#[cfg(not(target_family = "wasm"))]
pub mod progress;
#[cfg(not(target_family = "wasm"))]
pub mod qp_recording;
#[cfg(not(target_family = "wasm"))]
pub mod recording;
#[cfg(not(target_family = "wasm"))]
pub mod replay;
#[cfg(not(target_family = "wasm"))]
pub mod report;
#[cfg(not(target_family = "wasm"))]
pub mod route;
#[cfg(not(target_family = "wasm"))]
pub mod simulate;
#[cfg(not(target_family = "wasm"))]
mod sqlite;
#[cfg(not(target_family = "wasm"))]
pub mod tune;

/// Version of the program, and its sources: a simulation of the same sources has the same result.
pub const VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    " (sources ",
    env!("SIDEHILL_BUILD"),
    ")"
);
