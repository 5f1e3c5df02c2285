//! The program `sidehill`: arguments in, exit status out.
#![allow(clippy::print_stderr)]

use clap::{Parser, Subcommand};
use sidehill::{run, vehicle};
use std::process::ExitCode;

/// Path tracking for skid-steer rovers on slopes.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Drives a course in real time on a CAN bus.
    Run(run::RunArgs),
    /// Is a virtual rover in real time on a CAN bus.
    Vehicle(vehicle::VehicleArgs),
}

fn main() -> ExitCode {
    let result = match Cli::parse().command {
        Command::Run(args) => run::run(&args),
        Command::Vehicle(args) => vehicle::run(&args),
    };
    result.unwrap_or_else(|error| {
        eprintln!("sidehill: {error:#}");
        ExitCode::from(2)
    })
}
