//! The program `sidehill-drive`: arguments in, exit status out.

use anyhow::bail;
#[cfg(feature = "package")]
use clap::CommandFactory;
use clap::{Parser, Subcommand};
#[cfg(feature = "package")]
use sidehill::documents;
use sidehill::{console, drive};
use sidehill_bridge::ros2::arguments;
use sidehill_drive::{can, drive_route, faults, odometry, route, run, vehicle};
use std::process::ExitCode;

/// Drives a rover, or a virtual one, on a CAN bus or on ROS 2. `sidehill` has all other commands.
#[derive(Debug, Parser)]
#[command(version = sidehill_drive::VERSION)]
struct DriveCli {
    #[command(subcommand)]
    command: LiveCommand,
}

#[derive(Debug, Subcommand)]
enum LiveCommand {
    /// Drives a course in real time on a CAN bus or on ROS 2.
    Run(drive::RunArgs),
    /// Drives a virtual rover through faults drawn from a seed, in simulated time, and counts how it stops.
    Faults(faults::FaultsArgs),
    /// Has a running `sidehill run` on ROS 2 drive a stored route, in lanes if wanted; takes --ros-args. Enter, or
    /// SIGUSR2 and SIGUSR1, pauses and goes on.
    DriveRoute(drive::DriveRouteArgs),
    /// Runs a virtual rover in real time on a CAN bus or on ROS 2, where it takes --ros-args.
    Vehicle(drive::VehicleArgs),
    /// Finds, watches and tests drives on a CAN bus.
    Can(drive::CanArgs),
    /// With --live, runs as a ROS 2 node that publishes slope-corrected odometry.
    Odometry(sidehill::odometry::OdometryArgs),
    /// With `live`, writes the path of a drive from a ROS 2 topic as GPX or CSV.
    Route(sidehill::route::RouteArgs),
    /// Writes man pages and shell completions, for packages.
    #[cfg(feature = "package")]
    #[command(hide = true)]
    Documents(documents::DocumentsArgs),
}

fn main() -> ExitCode {
    let (own, ros) = arguments::split(std::env::args());
    let command = DriveCli::parse_from(own).command;
    // A vehicle drives on without its output.
    let drives = matches!(command, LiveCommand::Run(_) | LiveCommand::Vehicle(_));
    console::end("sidehill-drive", execute(command, &ros), !drives)
}

fn execute(command: LiveCommand, ros: &[String]) -> anyhow::Result<ExitCode> {
    match command {
        LiveCommand::Run(args) => run::run(&args, ros),
        LiveCommand::Vehicle(args) => vehicle::run(&args, ros),
        LiveCommand::Faults(args) => faults::run(&args),
        LiveCommand::DriveRoute(args) => drive_route::run(&args, ros),
        LiveCommand::Can(args) => can::run(&args),
        LiveCommand::Odometry(args) if args.live => odometry::run(&args, ros),
        LiveCommand::Odometry(_) => bail!("without --live this is a command of sidehill"),
        LiveCommand::Route(args) if args.is_live() => {
            route::run(&args, ros).map(|()| ExitCode::SUCCESS)
        }
        LiveCommand::Route(_) => bail!("without `live` this is a command of sidehill"),
        #[cfg(feature = "package")]
        LiveCommand::Documents(args) => {
            documents::run(&args, &mut DriveCli::command()).map(|()| ExitCode::SUCCESS)
        }
    }
}
