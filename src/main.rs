//! The program `sidehill`: arguments in, exit status out.

use anyhow::anyhow;
#[cfg(feature = "package")]
use clap::CommandFactory;
use clap::{Parser, Subcommand};
#[cfg(feature = "package")]
use sidehill::documents;
use sidehill::{
    campaign, check, console, drive, drive_report, icr, identify, init, migrate, odometry, play,
    replay, route, simulate, tune,
};
use sidehill_bridge::ros2::arguments;
use std::process::ExitCode;

/// Path tracking for skid-steer rovers on slopes. Without a subcommand it simulates the figure of
/// eight on a hillside with several controllers.
#[derive(Debug, Parser)]
#[command(version = sidehill::VERSION)]
struct Cli {
    #[command(subcommand)]
    command: Option<Command>,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Simulates a scenario with its controllers, side by side.
    Simulate(simulate::SimulateArgs),
    /// Serves a page with a hillside to play on: the simulation runs in the browser.
    Play(play::PlayArgs),
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
    Run(drive::RunArgs),
    /// Has a running `sidehill run` on ROS 2 drive a stored route, in lanes if wanted; takes --ros-args. Enter, or
    /// SIGUSR2 and SIGUSR1, pauses and goes on.
    DriveRoute(drive::DriveRouteArgs),
    /// Runs a virtual rover in real time on a CAN bus or on ROS 2, where it takes --ros-args.
    Vehicle(drive::VehicleArgs),
    /// Finds, watches and tests drives on a CAN bus.
    Can(drive::CanArgs),
    /// Feeds the samples of a recording to the controller again, or to another one.
    Replay(replay::ReplayArgs),
    /// Tells what a recorded drive was like: what was driven, stops and their causes, worst places, sensors; and whether it
    /// kept to limits.
    Report(drive_report::ReportArgs),
    /// Validates configuration files.
    Check(check::CheckArgs),
    /// Takes keys that no longer exist out of configuration files.
    Migrate(migrate::MigrateArgs),
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
    let result = match command {
        Command::Run(_) | Command::Vehicle(_) | Command::DriveRoute(_) | Command::Can(_) => {
            Err(drive::hand_over())
        }
        Command::Odometry(args) if args.live => Err(drive::hand_over()),
        Command::Route(args) if args.is_live() => Err(drive::hand_over()),
        _ if !ros.is_empty() => Err(anyhow!("--ros-args: this command is not a ROS 2 node")),
        Command::Simulate(args) => simulate::run(&args),
        Command::Play(args) => play::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Campaign(args) => campaign::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Tune(args) => tune::run(&args),
        Command::Icr(args) => icr::run(&args, std::io::stdin().lock(), std::io::stdout().lock())
            .map(|()| ExitCode::SUCCESS),
        Command::Odometry(args) => odometry::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Identify(args) => identify::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Route(args) => route::run(&args).map(|()| ExitCode::SUCCESS),
        Command::Replay(args) => replay::run(&args),
        Command::Report(args) => drive_report::run(&args),
        Command::Check(args) => check::run(&args),
        Command::Migrate(args) => migrate::run(&args),
        Command::Init(args) => init::run(&args).map(|()| ExitCode::SUCCESS),
        #[cfg(feature = "package")]
        Command::Documents(args) => {
            documents::run(&args, &mut Cli::command()).map(|()| ExitCode::SUCCESS)
        }
    };
    console::end("sidehill", result, true)
}
