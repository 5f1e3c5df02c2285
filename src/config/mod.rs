//! Configuration files: the one place that reads YAML.

#[cfg(feature = "drive")]
mod bridge;
mod campaign;
mod conditions;
mod plant;
mod reference;
#[cfg(feature = "drive")]
pub mod ros2;
mod scenario;

#[cfg(feature = "drive")]
pub use bridge::{RunConfig, RunPort, VehicleConfig, VehiclePort, load_layout};
pub use campaign::{Campaign, Drawn};
pub use conditions::Conditions;
pub use plant::{Plant, PlantKind};
pub use scenario::{Overrides, Prepared, Scenario};

use serde::Serialize;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// What is wrong with a file, with its name.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{file}: {reason}")]
    Read {
        /// Name of the file.
        file: String,
        /// Why not.
        reason: std::io::Error,
    },
    /// Its YAML does not hold what is expected; the message names key, value and range.
    #[error("{file}: {message}")]
    Content {
        /// Name of the file.
        file: String,
        /// Key, value and what is allowed.
        message: String,
    },
}

/// Files compiled into the program, by their names in its repository.
const BUILT_IN: [(&str, &str); 5] = [
    (
        "config/conditions/realistic.yaml",
        include_str!("../../config/conditions/realistic.yaml"),
    ),
    (
        "config/scenarios/figure_eight.yaml",
        include_str!("../../config/scenarios/figure_eight.yaml"),
    ),
    (
        "config/vehicles/j8.yaml",
        include_str!("../../config/vehicles/j8.yaml"),
    ),
    (
        CONTACT_VEHICLE,
        include_str!("../../config/vehicles/j8_contact.yaml"),
    ),
    (
        CONTACT_IDENTIFIED,
        include_str!("../../config/vehicles/j8_contact_identified.yaml"),
    ),
];

/// The scenario that runs when none is named.
pub const DEFAULT_SCENARIO: &str = "config/scenarios/figure_eight.yaml";

/// The vehicle on wheels that `--plant contact` drives where the scenario names none.
pub const CONTACT_VEHICLE: &str = "config/vehicles/j8_contact.yaml";
/// What identification found of it: the parameters controllers have then.
pub const CONTACT_IDENTIFIED: &str = "config/vehicles/j8_contact_identified.yaml";

/// A file's name and text; names inside it are relative to it.
#[derive(Debug, Clone)]
pub struct ConfigFile {
    path: PathBuf,
    origin: Origin,
    text: String,
}

/// Where the files come from that a file names.
#[derive(Debug, Clone)]
enum Origin {
    Disk,
    BuiltIn,
    Bundle(Bundle),
}

/// Files by their paths, which are read from the disk where they are not in it yet. What was read with a
/// bundle on one machine can be read with it on another.
pub(crate) type Bundle = Arc<Mutex<BTreeMap<PathBuf, String>>>;

impl ConfigFile {
    /// Reads a file from the disk.
    ///
    /// # Errors
    /// [`ConfigError::Read`] with its name.
    pub fn read(path: &Path) -> Result<Self, ConfigError> {
        let text = std::fs::read_to_string(path).map_err(|reason| ConfigError::Read {
            file: path.display().to_string(),
            reason,
        })?;
        Ok(Self::with_text(path, text))
    }

    /// Returns a file as if `text` stood in it.
    pub fn with_text(path: &Path, text: String) -> Self {
        Self {
            path: path.to_owned(),
            origin: Origin::Disk,
            text,
        }
    }

    /// Returns the file of that name that is compiled into the program.
    ///
    /// # Errors
    /// [`ConfigError::Read`] where there is none.
    pub fn built_in(name: &str) -> Result<Self, ConfigError> {
        BUILT_IN
            .iter()
            .find(|(built_in, _)| *built_in == name)
            .map(|(name, text)| Self {
                path: PathBuf::from(name),
                origin: Origin::BuiltIn,
                text: (*text).to_owned(),
            })
            .ok_or_else(|| ConfigError::Read {
                file: format!("{name} (built in)"),
                reason: std::io::ErrorKind::NotFound.into(),
            })
    }

    /// Returns the file that this one names, relative to itself.
    ///
    /// # Errors
    /// [`ConfigError::Read`] with the whole name.
    pub fn sibling(&self, name: &Path) -> Result<Self, ConfigError> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let path = normalised(&folder.join(name));
        match &self.origin {
            Origin::Disk => Self::read(&path),
            Origin::BuiltIn => Self::built_in(&path.to_string_lossy()),
            Origin::Bundle(files) => {
                let mut held = files.lock().unwrap_or_else(PoisonError::into_inner);
                let text = match held.get(&path) {
                    Some(text) => text.clone(),
                    None => Self::read(&path)?.text,
                };
                held.insert(path.clone(), text.clone());
                Ok(Self::with_text(&path, text).with_bundle(files.clone()))
            }
        }
    }

    /// Returns this file with what it names taken from, and put into, a bundle.
    pub(crate) fn with_bundle(self, files: Bundle) -> Self {
        Self {
            origin: Origin::Bundle(files),
            ..self
        }
    }

    /// Returns the name for messages.
    pub fn name(&self) -> String {
        if matches!(self.origin, Origin::BuiltIn) {
            format!("{} (built in)", self.path.display())
        } else {
            self.path.display().to_string()
        }
    }

    /// Returns the path as it was given.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the text.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns this file with `keys` in place of its own of the same name; of `controller` only what
    /// is named there is replaced.
    ///
    /// # Errors
    /// [`ConfigError::Content`] where the text is no YAML mapping.
    pub fn with_keys(&self, keys: &serde_yaml::Mapping) -> Result<Self, ConfigError> {
        let mut all: serde_yaml::Mapping = self.parse()?;
        conditions::overlay(&mut all, keys);
        let text = serde_yaml::to_string(&all).map_err(|error| self.error(error))?;
        Ok(Self {
            text,
            ..self.clone()
        })
    }

    /// Reads the text as YAML.
    ///
    /// # Errors
    /// [`ConfigError::Content`] with file, key, value and range.
    pub fn parse<T: DeserializeOwned>(&self) -> Result<T, ConfigError> {
        serde_yaml::from_str(&self.text).map_err(|error| self.error(error))
    }

    /// Returns an error about this file's content.
    pub fn error(&self, message: impl ToString) -> ConfigError {
        ConfigError::Content {
            file: self.name(),
            message: message.to_string(),
        }
    }
}

/// Returns a value as YAML.
///
/// # Errors
/// Why it has no form in YAML.
pub fn to_yaml(value: &impl Serialize) -> Result<String, serde_yaml::Error> {
    serde_yaml::to_string(value)
}

/// Returns a path without `.` and with each `..` resolved against the folder before it.
fn normalised(path: &Path) -> PathBuf {
    let mut out = PathBuf::new();
    for component in path.components() {
        match component {
            Component::CurDir => {}
            Component::ParentDir
                if matches!(out.components().next_back(), Some(Component::Normal(_))) =>
            {
                out.pop();
            }
            other => out.push(other),
        }
    }
    out
}
