//! Configuration of `vehicle`.

use super::bus::bus;
use super::record::{RecordConfig, recording};
use super::{ConfigError, ConfigFile, Overrides, PlantKind, Prepared, Scenario};
use serde::Deserialize;
use sidehill_bridge::ros2::rover::{RosVehicle, VehicleNodeConfig, VehicleSetup};
use sidehill_bridge::rover::{DriveConfig, FaultWindow};
use sidehill_can::layout::Layout;
use sidehill_can::rover::{CanFault, CanRover, CanRoverSetup};
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_recording::RecordLimits;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// How a virtual vehicle is commanded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VehiclePort {
    /// A CAN bus.
    #[default]
    Can,
    /// Topics of ROS 2.
    Ros2,
}

/// What `sidehill vehicle` reads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleConfig {
    /// Transport.
    #[serde(default)]
    pub port: VehiclePort,
    /// [Topics and frames](#virtual-rover-on-ros-2) with `port: ros2`.
    #[serde(default)]
    pub ros2: VehicleNodeConfig,
    /// SocketCAN interface. Required with `port: can`.
    #[serde(default)]
    pub interface: Option<String>,
    /// [CAN layout](#can-layout) file. Required with `port: can`.
    #[serde(default)]
    pub can: Option<PathBuf>,
    /// [Scenario](#scenario) file: vehicle, ground, start, drive train and sensors.
    pub scenario: PathBuf,
    /// What moves the vehicle. None: the scenario's.
    #[serde(default)]
    pub plant: Option<PlantKind>,
    /// Seed of everything random. None: the scenario's.
    #[serde(default)]
    pub seed: Option<u64>,
    /// [Drive train](#drive-train) in place of the scenario's.
    #[serde(default)]
    pub drive_train: Option<DriveTrainConfig>,
    /// [Sensors](#sensors) in place of the scenario's.
    #[serde(default)]
    pub sensors: Option<SensorsConfig>,
    /// [The drives' own timeout](#drive).
    #[serde(default)]
    pub drive: DriveConfig,
    /// Time between reports.
    #[serde(default = "fifty_milliseconds")]
    pub report_period_s: f64,
    /// [Faults](#fault-on-can) to inject, with `port: can`.
    #[serde(default)]
    pub faults: Vec<FaultWindow<CanFault>>,
    /// [Recording](#record).
    #[serde(default)]
    pub record: Option<RecordConfig>,
}

impl VehicleConfig {
    /// Returns the file of the recording and its limits; none if the drive is not recorded. `given` is the file from
    /// the command line.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn recording(
        &self,
        file: &ConfigFile,
        given: Option<&Path>,
    ) -> Result<Option<(PathBuf, RecordLimits)>, ConfigError> {
        recording(file, self.record.as_ref(), given)
    }

    /// Returns the scenario with this file's settings replacing its own.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn world(&self, file: &ConfigFile) -> Result<Prepared, ConfigError> {
        let scenario = Scenario::read(file.sibling(&self.scenario)?)?;
        let mut world = scenario.prepare(&Overrides {
            plant: self.plant,
            seed: self.seed,
            ..Overrides::default()
        })?;
        world.drive_train = self.drive_train.clone().unwrap_or(world.drive_train);
        world.sensors = self.sensors.unwrap_or(world.sensors);
        Ok(world)
    }

    /// Checks all that the vehicle is made of, without a bus or a graph.
    ///
    /// # Errors
    /// As [`VehicleConfig::world`], and of its port.
    pub fn check(&self, file: &ConfigFile) -> Result<(), ConfigError> {
        self.recording(file, None)?;
        let world = self.world(file)?;
        match self.port {
            VehiclePort::Can => {
                let (_, layout) = self.bus(file)?;
                self.can_rover(file, &world, Arc::new(layout)).map(drop)
            }
            VehiclePort::Ros2 => self.ros2_rover(file, &world, 0).map(drop),
        }
    }

    /// Returns the vehicle in its world as it answers CAN frames, with its drives off.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn can_rover(
        &self,
        file: &ConfigFile,
        world: &Prepared,
        layout: Arc<Layout>,
    ) -> Result<CanRover, ConfigError> {
        let setup = CanRoverSetup {
            dt_s: world.step_s,
            correction: world.plant.encoder_scale(),
            drive: self.drive,
            report_period_s: self.report_period_s,
            faults: self.faults.clone(),
        };
        let simulation = world.simulation().map_err(|error| file.error(error))?;
        CanRover::new(simulation, layout, setup).map_err(|error| file.error(error))
    }

    /// Returns the vehicle in its world as it is on the ROS 2 graph, with its drives off; `origin_ns` is the stamp
    /// of its time 0.
    ///
    /// # Errors
    /// [`ConfigError`] with the file, key, value and range.
    pub fn ros2_rover(
        &self,
        file: &ConfigFile,
        world: &Prepared,
        origin_ns: i64,
    ) -> Result<RosVehicle, ConfigError> {
        let setup = VehicleSetup {
            dt_s: world.step_s,
            correction: world.plant.encoder_scale(),
            vehicle: &world.vehicle,
            drive: self.drive,
            report_period_s: self.report_period_s,
            origin_ns,
        };
        let simulation = world.simulation().map_err(|error| file.error(error))?;
        RosVehicle::new(simulation, &setup, self.ros2.clone()).map_err(|error| file.error(error))
    }

    /// Returns interface and layout of the bus.
    ///
    /// # Errors
    /// [`ConfigError`] where a key is missing or the layout's files are wrong.
    pub fn bus(&self, file: &ConfigFile) -> Result<(&str, Layout), ConfigError> {
        bus(file, self.interface.as_deref(), self.can.as_deref())
    }
}

fn fifty_milliseconds() -> f64 {
    0.05
}
