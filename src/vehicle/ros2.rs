//! A virtual rover on ROS 2.

use super::rover::Rover;
use crate::config::ros2::environment;
use crate::config::{Prepared, VehicleConfig};
use anyhow::Result;
use sidehill_bridge::drives::DriveMode;
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::ros2::node::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::port::rover::{RosVehicle, VehicleNode, VehicleSetup};
use sidehill_plant::simulation::TrueState;

pub(super) struct RosRover {
    vehicle: RosVehicle,
    node: VehicleNode,
    origin_ns: i64,
    arguments: RosArguments,
    environment: RosEnvironment,
}

impl RosRover {
    pub fn start(
        config: &VehicleConfig,
        world: &Prepared,
        ros: &[String],
        epoch: Epoch,
    ) -> Result<Self> {
        let arguments = RosArguments::parse(ros)?;
        // If it publishes a clock, its time starts at 0, otherwise at the present time.
        let origin_ns = match config.ros2.clock_factor {
            Some(_) => 0,
            None => (epoch.unix_s(0.0) * 1e9) as i64,
        };
        let vehicle = build(config, world, origin_ns)?;
        let environment = environment()?;
        let node = VehicleNode::start(&vehicle, origin_ns, &arguments, &environment)?;
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

/// Returns the vehicle of a configuration in its world, with its drives off; `origin_ns` is the stamp of its time 0.
pub(super) fn build(
    config: &VehicleConfig,
    world: &Prepared,
    origin_ns: i64,
) -> Result<RosVehicle> {
    let setup = VehicleSetup {
        dt_s: world.step_s,
        correction: world.plant.encoder_scale(),
        vehicle: &world.vehicle,
        drive: config.drive,
        report_period_s: config.report_period_s,
        origin_ns,
    };
    Ok(RosVehicle::new(
        world.simulation()?,
        &setup,
        config.ros2.clone(),
    )?)
}
