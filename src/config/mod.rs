//! Configuration files: the one place that reads YAML.

#[cfg(feature = "drive")]
mod bridge;
mod campaign;
mod conditions;
mod file;
mod keys;
mod overlay;
mod plant;
mod prepared;
mod reference;
#[cfg(feature = "drive")]
pub mod ros2;
mod scenario;
mod variation;

#[cfg(feature = "drive")]
pub use bridge::{RunConfig, RunPort, VehicleConfig, VehiclePort, load_layout};
pub use campaign::{Campaign, Drawn};
pub(crate) use campaign::{find, put};
pub use conditions::Conditions;
pub(crate) use file::{Bundle, no_text};
pub use file::{
    CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigError, ConfigFile, DEFAULT_SCENARIO, to_yaml,
};
pub use plant::{Plant, PlantKind};
pub use prepared::Prepared;
pub use reference::{LoadedReference, Source, read_route};
#[cfg(feature = "drive")]
pub(crate) use scenario::led_point;
pub use scenario::{Overrides, Scenario};
