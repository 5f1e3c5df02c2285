//! Configuration files: the only place that reads YAML.

#[cfg(feature = "drive")]
mod bus;
mod campaign;
mod conditions;
mod draws;
mod file;
mod ground;
mod hints;
mod keys;
mod overlay;
mod plant;
mod prepared;
#[cfg(feature = "drive")]
mod record;
mod reference;
#[cfg(feature = "drive")]
pub mod ros2;
#[cfg(feature = "drive")]
mod run;
mod scenario;
mod start;
mod variation;
#[cfg(feature = "drive")]
mod virtual_rover;

#[cfg(feature = "drive")]
pub use bus::load_layout;
pub use campaign::{Campaign, Drawn};
pub use conditions::Conditions;
pub(crate) use draws::{find, put};
pub(crate) use file::Bundle;
pub use file::{
    CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigError, ConfigFile, DEFAULT_SCENARIO, to_yaml,
};
pub(crate) use hints::no_text;

/// The program by its sources: results of two builds are not mixed.
pub(crate) const BUILD: &str = env!("SIDEHILL_BUILD");

pub use plant::{Plant, PlantKind};
pub use prepared::Prepared;
pub use reference::{LoadedReference, Source, read_route};
#[cfg(feature = "drive")]
pub use run::{RunConfig, RunPort};
#[cfg(feature = "drive")]
pub(crate) use scenario::point_behind_icrs;
pub use scenario::{Overrides, Scenario};
#[cfg(feature = "drive")]
pub use virtual_rover::{VehicleConfig, VehiclePort};
