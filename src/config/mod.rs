//! Configuration files: the only place that reads YAML.

#[cfg(not(target_family = "wasm"))]
mod bus;
mod campaign;
mod conditions;
mod draws;
mod file;
mod geo_keys;
mod geotiff;
mod ground;
mod hints;
mod keys;
#[cfg(not(target_family = "wasm"))]
mod live_odometry;
mod migration;
mod overlay;
mod plant;
mod prepared;
#[cfg(not(target_family = "wasm"))]
mod record;
mod reference;
mod removed;
#[cfg(not(target_family = "wasm"))]
mod run;
mod scenario;
mod start;
mod variation;
#[cfg(not(target_family = "wasm"))]
mod virtual_rover;

#[cfg(not(target_family = "wasm"))]
pub use bus::load_layout;
pub use campaign::{Campaign, Drawn};
pub use conditions::Conditions;
pub(crate) use draws::{find, put};
pub(crate) use file::NO_KEYS;
pub use file::{
    Bundle, CONTACT_IDENTIFIED, CONTACT_VEHICLE, ConfigError, ConfigFile, DEFAULT_SCENARIO, to_yaml,
};
#[cfg(not(target_family = "wasm"))]
pub use live_odometry::LiveOdometryConfig;

/// The program by its sources: results of two builds are not mixed.
pub(crate) const BUILD: &str = env!("SIDEHILL_BUILD");

pub use migration::Migration;
pub use overlay::changed;
pub use plant::{Plant, PlantKind};
pub use prepared::Prepared;
pub use reference::{
    LoadedReference, Source, ground_along, ground_point, named, read_route, route_warnings,
};
#[cfg(not(target_family = "wasm"))]
pub use run::{RunConfig, RunPort};
pub(crate) use scenario::point_behind_icrs;
pub use scenario::{Overrides, Scenario};
#[cfg(not(target_family = "wasm"))]
pub use virtual_rover::{VehicleConfig, VehiclePort};
