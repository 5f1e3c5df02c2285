//! The program `sidehill`: arguments in, exit status out.
#![allow(clippy::print_stderr)]

use anyhow::anyhow;
#[cfg(feature = "package")]
use clap::CommandFactory;
use clap::{Parser, Subcommand};
#[cfg(feature = "package")]
use sidehill::documents;
use sidehill::{
    campaign, check, console, icr, identify, init, live_odometry, odometry, replay, route, run,
    simulate, tune, vehicle,
};
use sidehill_bridge::ros2::node::arguments;
use std::process::ExitCode;

/// Path tracking for skid-steer rovers on slopes. Without a subcommand it simulates the figure of
/// eight on a hillside with several controllers.
#[derive(Debug, Parser)]
#[command(version)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulates a scenario with its controllers, side by side.
    Simulate(simulate::SimulateArgs),
    /// Runs many seeded simulations on all cores and compares controllers over them.
    Campaign(campaign::CampaignArgs),
    /// Searches for better settings of a controller, and accepts them only if held-out runs
    /// improve as well.
    Tune(tune::TuneArgs),
    /// Evaluates ICRIK: CSV with roll_rad, pitch_rad, v_left_m_s, v_right_m_s on standard input.
    /// These are effective tread speeds: c_l and c_r of the vehicle are not applied.
    Icr(icr::IcrArgs),
    /// Compares the odometry of ICRHK, ICRIK and ideal differential drive with the poses of a log.
    /// With --live, runs as a ROS 2 node that publishes slope-corrected odometry.
    Odometry(odometry::OdometryArgs),
    /// Identifies a vehicle's parameters from logs of level and sloping ground.
    Identify(identify::IdentifyArgs),
    /// Writes the path of a drive, from a recording or live from a ROS 2 topic, smoothed and thinned
    /// out, as GPX or CSV.
    Route(route::RouteArgs),
    /// Drives a course in real time on a CAN bus or on ROS 2.
    Run(run::RunArgs),
    /// Runs a virtual rover in real time on a CAN bus or on ROS 2, where it takes --ros-args.
    Vehicle(vehicle::VehicleArgs),
    /// Feeds the samples of a recording to the controller again, or to another one.
    Replay(replay::ReplayArgs),
    /// Validates configuration files.
    Check(check::CheckArgs),
    /// Writes a commented set of configuration files for a robot.
    Init(init::InitArgs),
    /// Writes man pages and shell completions, for packages.
    #[cfg(feature = "package")]
    #[command(hide = true)]
    Documents(documents::DocumentsArgs),
}

fn main() -> ExitCode {
    let (own, ros) = arguments::split(std::env::args());
    let command = Cli::parse_from(own)
        .command
        .unwrap_or_else(|| Command::Simulate(simulate::SimulateArgs::default()));
    // A vehicle drives on without its output.
    let drives = matches!(command, Command::Run(_) | Command::Vehicle(_));
    let result = match command {
        Command::Run(args) => run::run(&args, &ros),
        Command::Vehicle(args) => vehicle::run(&args, &ros),
        Command::Odometry(args) if args.live => live_odometry::run(&args, &ros),
        Command::Route(args) if args.is_live() => {
            route::run(&args, &ros).map(|()| ExitCode::SUCCESS)
        }
        _ if !ros.is_empty() => Err(anyhow!("--ros-args: this command is not a ROS 2 node")),
        Command::Simulate(args) => simulate::run(&args),
        Command::Campaign(args) => campaign::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Tune(args) => tune::run(&args),
        Command::Icr(args) => icr::run(&args, std::io::stdin().lock(), std::io::stdout().lock())
            .map(|()| ExitCode::SUCCESS),
        Command::Odometry(args) => odometry::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Identify(args) => identify::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Route(args) => route::run(&args, &[]).map(|()| ExitCode::SUCCESS),
        Command::Replay(args) => replay::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Init(args) => init::run(&args).map(|()| ExitCode::SUCCESS),
        #[cfg(feature = "package")]
        Command::Documents(args) => {
            documents::run(&args, &mut Cli::command()).map(|()| ExitCode::SUCCESS)
        }
    };
    let fault = console::output_fault().filter(|_| !drives && result.is_ok());
    if let Some(fault) = fault {
        console::complain(format_args!("sidehill: standard output: {fault}"));
        return ExitCode::from(2);
    }
    result.unwrap_or_else(|error| {
        console::complain(format_args!("sidehill: {error:#}"));
        ExitCode::from(2)
    })
}
