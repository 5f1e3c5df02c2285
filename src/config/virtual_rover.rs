//! Configuration of `vehicle`.

use super::bus::bus;
use super::record::{RecordConfig, recording};
use super::{ConfigError, ConfigFile, Overrides, PlantKind, Prepared, Scenario};
use serde::Deserialize;
use sidehill_bridge::can::layout::Layout;
use sidehill_bridge::recording::RecordLimits;
use sidehill_bridge::ros2::port::rover::VehicleNodeConfig;
use sidehill_bridge::rover::{CanFault, DriveConfig, FaultWindow};
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::sensors::SensorsConfig;
use std::path::{Path, PathBuf};

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
    /// How it is commanded.
    #[serde(default)]
    pub port: VehiclePort,
    /// Its topics and frames, of port `ros2`.
    #[serde(default)]
    pub ros2: VehicleNodeConfig,
    /// SocketCAN interface.
    #[serde(default)]
    pub interface: Option<String>,
    /// Layout of the bus, relative to this file.
    #[serde(default)]
    pub can: Option<PathBuf>,
    /// The world: vehicle, ground, start, drive train and sensors of a scenario, relative to this
    /// file.
    pub scenario: PathBuf,
    /// What moves the vehicle, instead of the scenario's plant.
    #[serde(default)]
    pub plant: Option<PlantKind>,
    /// Seed of everything random, instead of the scenario's.
    #[serde(default)]
    pub seed: Option<u64>,
    /// Drive train, instead of the scenario's.
    #[serde(default)]
    pub drive_train: Option<DriveTrainConfig>,
    /// Errors of the sensors, instead of the scenario's.
    #[serde(default)]
    pub sensors: Option<SensorsConfig>,
    /// The drives' side of the enable handshake.
    #[serde(default)]
    pub drive: DriveConfig,
    /// Time between reports, s.
    #[serde(default = "fifty_milliseconds")]
    pub report_period_s: f64,
    /// Faults to inject, of port `can`.
    #[serde(default)]
    pub faults: Vec<FaultWindow<CanFault>>,
    /// Recording of the vehicle.
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
