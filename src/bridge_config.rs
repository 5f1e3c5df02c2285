//! Configuration of `run` and `vehicle`, and the files they name.

use anyhow::{Context, Result};
use serde::Deserialize;
use serde::de::DeserializeOwned;
use sidehill_bridge::can::config::CanConfig;
use sidehill_bridge::can::database::Database;
use sidehill_bridge::can::layout::Layout;
use sidehill_bridge::cycle::CycleConfig;
use sidehill_bridge::drive::DriveConfig;
use sidehill_bridge::realtime::RealtimeConfig;
use sidehill_bridge::safety::SafetyConfig;
use sidehill_bridge::virtual_vehicle::InjectedFault;
use sidehill_controller::config::{ControllerConfig, ControllerKind};
use sidehill_controller::course::Course;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::sensors::SensorsConfig;
use sidehill_plant::vehicle::{RangeError, Vehicle};
use std::path::{Path, PathBuf};

/// What `sidehill run` reads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// SocketCAN interface.
    pub interface: String,
    /// Layout of the bus, relative to this file.
    pub can: PathBuf,
    /// Instead of the bus: the virtual vehicle of this file, simulated in real time within the
    /// program.
    #[serde(default)]
    pub simulated: Option<PathBuf>,
    /// Vehicle that the controller steers by, relative to this file.
    pub vehicle: PathBuf,
    /// Which controller.
    pub controller: ControllerKind,
    /// Its settings.
    #[serde(default)]
    pub settings: ControllerConfig,
    /// What is driven.
    pub course: Course,
    /// Rounds of a periodic course.
    #[serde(default = "one")]
    pub laps: u32,
    /// The cycle.
    #[serde(default)]
    pub cycle: CycleConfig,
    /// The safety.
    #[serde(default)]
    pub safety: SafetyConfig,
    /// What is asked of the system.
    #[serde(default)]
    pub realtime: RealtimeConfig,
}

/// What `sidehill vehicle` reads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VehicleConfig {
    /// SocketCAN interface.
    pub interface: String,
    /// Layout of the bus, relative to this file.
    pub can: PathBuf,
    /// The true vehicle, relative to this file.
    pub vehicle: PathBuf,
    /// Slope of the ground, deg.
    #[serde(default)]
    pub slope_deg: f64,
    /// Direction of uphill, counter-clockwise from Y_g, deg.
    #[serde(default)]
    pub uphill_deg: f64,
    /// Where the vehicle stands first.
    #[serde(default)]
    pub start: Start,
    /// Between command and treads.
    #[serde(default)]
    pub drive_train: DriveTrainConfig,
    /// Errors of the sensors.
    #[serde(default)]
    pub sensors: SensorsConfig,
    /// The drives' own side of the handshake.
    #[serde(default)]
    pub drive: DriveConfig,
    /// Step of the simulation, s.
    #[serde(default = "five_milliseconds")]
    pub dt_s: f64,
    /// Time between reports, s.
    #[serde(default = "fifty_milliseconds")]
    pub report_period_s: f64,
    /// Seed of everything random.
    #[serde(default)]
    pub seed: u64,
    /// What goes wrong on purpose.
    #[serde(default)]
    pub faults: Vec<InjectedFault>,
}

/// Where a vehicle stands.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Start {
    /// X_g, m.
    pub x_m: f64,
    /// Y_g, m.
    pub y_m: f64,
    /// Heading, counter-clockwise from Y_g, deg.
    pub heading_deg: f64,
}

impl Start {
    /// Returns the pose.
    pub fn pose(&self) -> PlanarPose {
        PlanarPose {
            x_m: self.x_m,
            y_m: self.y_m,
            yaw_rad: self.heading_deg.to_radians(),
        }
    }
}

impl VehicleConfig {
    /// Checks what is not checked where it is used.
    ///
    /// # Errors
    /// [`RangeError`] with the key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        RangeError::check("dt_s", self.dt_s, 1e-3, 0.05, "from 0.001 to 0.05 s")?;
        Ok(())
    }
}

/// Returns what a YAML file says.
///
/// # Errors
/// Names the file, and the key or line that is wrong.
pub fn read_yaml<T: DeserializeOwned>(file: &Path) -> Result<T> {
    serde_yaml::from_str(&read(file)?).with_context(|| file.display().to_string())
}

/// Returns the layout of the bus in a file and the database it names.
///
/// # Errors
/// Names the file, the message and the signal that is wrong.
pub fn load_layout(file: &Path) -> Result<Layout> {
    let config: CanConfig = read_yaml(file)?;
    let database = resolve(file, Path::new(&config.database));
    let database = Database::parse(&database.display().to_string(), &read(&database)?)?;
    Layout::new(&config, &database).with_context(|| file.display().to_string())
}

/// Returns the vehicle in a file.
///
/// # Errors
/// Names the file and the key that is wrong.
pub fn load_vehicle(file: &Path) -> Result<Vehicle> {
    read_yaml(file)
}

/// Returns a file name that was relative to the file it is named in.
pub fn resolve(named_in: &Path, name: &Path) -> PathBuf {
    named_in
        .parent()
        .map_or_else(|| name.to_owned(), |folder| folder.join(name))
}

fn read(file: &Path) -> Result<String> {
    std::fs::read_to_string(file).with_context(|| format!("cannot read {}", file.display()))
}

fn one() -> u32 {
    1
}

fn five_milliseconds() -> f64 {
    0.005
}

fn fifty_milliseconds() -> f64 {
    0.05
}
