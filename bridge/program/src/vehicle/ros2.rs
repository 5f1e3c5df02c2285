//! A virtual rover on ROS 2.

use super::rover::Rover;
use crate::ros2::environment;
use anyhow::{Context, Result};
use sidehill::config::{ConfigFile, Prepared, VehicleConfig};
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::rover::RosVehicle;
use sidehill_plant::simulation::TrueState;
use sidehill_ros2::port::rover::VehicleNode;

pub(super) struct RosRover {
    vehicle: RosVehicle,
    node: VehicleNode,
    origin_ns: i64,
    arguments: RosArguments,
    environment: RosEnvironment,
}

impl RosRover {
    pub fn start(
        file: &ConfigFile,
        config: &VehicleConfig,
        world: &Prepared,
        ros: &[String],
        epoch: Epoch,
    ) -> Result<Self> {
        let arguments = RosArguments::parse(ros).with_context(|| file.name())?;
        // If it publishes a clock, its time starts at 0, otherwise at the present time.
        let origin_ns = match config.ros2.clock_factor {
            Some(_) => 0,
            None => (epoch.unix_s(0.0) * 1e9) as i64,
        };
        let vehicle = config.ros2_rover(file, world, origin_ns)?;
        let environment = environment().with_context(|| file.name())?;
        let node = VehicleNode::start(&vehicle, origin_ns, &arguments, &environment)
            .with_context(|| file.name())?;
        Ok(Self {
            vehicle,
            node,
            origin_ns,
            arguments,
            environment,
        })
    }
}

impl Rover for RosRover {
    fn advance(&mut self, now_s: f64) -> Result<bool> {
        if let Some(motors) = self.node.command(&self.vehicle) {
            self.vehicle.take(motors, now_s);
        }
        self.vehicle.advance(now_s)?;
        let due = now_s >= self.vehicle.next_report_s();
        if due {
            let node = &mut self.node;
            self.vehicle.report(now_s, |report| node.publish(report));
        }
        Ok(due)
    }

    fn resume(&mut self) -> Result<()> {
        self.node = VehicleNode::start(
            &self.vehicle,
            self.origin_ns,
            &self.arguments,
            &self.environment,
        )?;
        Ok(())
    }

    fn state(&self) -> &TrueState {
        self.vehicle.state()
    }

    fn mode(&self) -> DriveMode {
        self.vehicle.mode()
    }
}
