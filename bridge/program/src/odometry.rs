//! `sidehill odometry --live`: slope-corrected odometry as a node of ROS 2.

use crate::interrupts::Interrupts;
use crate::ros2::environment;
use anyhow::{Context, Result, ensure};
use sidehill::config::{ConfigFile, LiveOdometryConfig};
use sidehill::console;
use sidehill::drive_log::LogArgs;
use sidehill::odometry::OdometryArgs;
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::ros2::arguments::RosArguments;
use sidehill_bridge::ros2::settings::odometry::OdometryConfig;
use sidehill_plant::vehicle::Vehicle;
use sidehill_ros2::odometry::{OdometryNode, OdometrySetup};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Interval at which new readings are polled.
const PERIOD: Duration = Duration::from_millis(2);
/// Time after the start until missing readings are named.
const PATIENCE: Duration = Duration::from_secs(5);

/// Publishes odometry until a signal arrives.
///
/// # Errors
/// A file that cannot be read, a setting out of range, or a network that cannot be used.
pub fn run(args: &OdometryArgs, ros_arguments: &[String]) -> Result<ExitCode> {
    ensure!(
        args.maps == LogArgs::default(),
        "--live: --columns and --topics are for logs"
    );
    let (config, vehicle) = configuration(args)?;
    let arguments = RosArguments::parse(ros_arguments)?;
    let interrupts = Interrupts::watch()?;
    let mut node = OdometryNode::start(OdometrySetup {
        config,
        vehicle: &vehicle,
        arguments: &arguments,
        environment: &environment()?,
        epoch: Epoch::now(),
    })?;
    let started = Instant::now();
    let mut warned = false;
    while !interrupts.ended() {
        ensure!(!interrupts.take_resumed(), "the program was suspended");
        node.step();
        if !warned && node.published() == 0 && started.elapsed() > PATIENCE {
            warned = true;
            let (rejected, reason) = node.rejected();
            let rejected = match rejected {
                0 => "no message has arrived".to_owned(),
                count => format!("{count} messages were rejected, the last: {reason}"),
            };
            console::complain(format_args!(
                "odometry waits for tread speeds and attitude: {rejected}"
            ));
        }
        std::thread::sleep(PERIOD);
    }
    let (rejected, reason) = node.rejected();
    console::line(serde_json::json!({
        "published": node.published(),
        "gaps": node.gaps(),
        "rejected": rejected,
        "last_rejection": reason,
    }));
    Ok(ExitCode::SUCCESS)
}

/// Returns the configuration of the node, from a file or with defaults for a vehicle.
fn configuration(args: &OdometryArgs) -> Result<(OdometryConfig, Vehicle)> {
    match (&args.log, &args.vehicle) {
        (Some(path), vehicle) => {
            ensure!(
                vehicle.is_none(),
                "--vehicle: the configuration of --live names the vehicle"
            );
            let file = ConfigFile::read(path)?;
            let config: LiveOdometryConfig = file.parse()?;
            let vehicle = config.checked(&file)?;
            Ok((config.ros2, vehicle))
        }
        (None, Some(vehicle)) => {
            let vehicle = ConfigFile::read(vehicle)?.parse()?;
            Ok((OdometryConfig::default(), vehicle))
        }
        (None, None) => None.context("--live needs a configuration or --vehicle FILE"),
    }
}
