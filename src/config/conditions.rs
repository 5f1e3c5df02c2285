//! Sensing, actuation and ground that replace a scenario's own.

use super::plant::{GroundFriction, PlantKind};
use super::{ConfigError, ConfigFile};
use serde::Deserialize;
use serde_yaml::Mapping;
use sidehill_controller::config::ControllerConfig;
use sidehill_plant::drive_train::DriveTrainConfig;
use sidehill_plant::sensors::SensorsConfig;
use std::path::Path;

/// The built-in conditions, by their name on the command line.
const REALISTIC: (&str, &str) = ("realistic", "config/conditions/realistic.yaml");

/// Keys that conditions may have, so that errors name the conditions file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ConditionKeys {
    /// Name for tables.
    name: String,
    /// What moves the vehicle.
    #[serde(default, rename = "plant")]
    _plant: Option<PlantKind>,
    /// [Friction](#friction).
    #[serde(default)]
    friction: Option<GroundFriction>,
    /// [Drive train](#drive-train).
    #[serde(default, rename = "drive_train")]
    _drive_train: DriveTrainConfig,
    /// [Sensors](#sensors).
    #[serde(default, rename = "sensors")]
    _sensors: SensorsConfig,
    /// [Controller settings](#controller-settings) in place of those of the scenario, key by key.
    #[serde(default)]
    controller: ControllerConfig,
}

/// Keys that replace those of a scenario.
pub struct Conditions {
    /// Name for tables.
    pub name: String,
    keys: Mapping,
}

impl Conditions {
    /// Reads the file of that name, or the conditions of that name that are built in.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn read(name: &Path) -> Result<Self, ConfigError> {
        if name == Path::new(REALISTIC.0) {
            Self::parse(&ConfigFile::built_in(REALISTIC.1)?)
        } else {
            Self::parse(&ConfigFile::read(name)?)
        }
    }

    /// Reads the conditions that another file names, relative to itself or built in.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn beside(file: &ConfigFile, name: &Path) -> Result<Self, ConfigError> {
        if name == Path::new(REALISTIC.0) {
            Self::read(name)
        } else {
            Self::parse(&file.sibling(name)?)
        }
    }

    /// Reads conditions from a file.
    ///
    /// # Errors
    /// [`ConfigError`] with file, key, value and range.
    pub fn parse(file: &ConfigFile) -> Result<Self, ConfigError> {
        let checked: ConditionKeys = file.parse()?;
        if let Some(friction) = &checked.friction {
            friction
                .check()
                .map_err(|error| file.error(format!("friction.{error}")))?;
        }
        checked
            .controller
            .validate()
            .map_err(|error| file.error(format!("controller.{error}")))?;
        let mut keys: Mapping = file.parse()?;
        keys.remove("name");
        Ok(Self {
            name: checked.name,
            keys,
        })
    }

    /// Returns a scenario's file with these keys in it.
    ///
    /// # Errors
    /// [`ConfigError::Content`] where the scenario is not a YAML mapping.
    pub fn put_into(&self, scenario: &ConfigFile) -> Result<ConfigFile, ConfigError> {
        scenario.with_keys(&self.keys)
    }
}
