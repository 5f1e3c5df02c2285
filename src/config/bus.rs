//! The layout of a CAN bus, for `run` and `vehicle`.

use super::{ConfigError, ConfigFile};
use sidehill_can::config::CanConfig;
use sidehill_can::database::Database;
use sidehill_can::layout::Layout;
use std::path::Path;

/// Returns the layout of the bus in a file and the database it names.
///
/// # Errors
/// Names the file, the message and the signal that is wrong.
pub fn load_layout(file: &ConfigFile) -> Result<Layout, ConfigError> {
    let config: CanConfig = file.parse()?;
    let database = file.sibling(Path::new(&config.database))?;
    let database =
        Database::parse(&database.name(), database.text()).map_err(|error| file.error(error))?;
    Layout::new(&config, &database).map_err(|error| file.error(error))
}

/// Returns the interface and the layout of its bus.
///
/// # Errors
/// Names the key that is missing, or what is wrong with the layout.
pub(super) fn bus<'a>(
    file: &ConfigFile,
    interface: Option<&'a str>,
    layout: Option<&Path>,
) -> Result<(&'a str, Layout), ConfigError> {
    let interface = needed(file, "interface", interface)?;
    let layout = needed(file, "can", layout)?;
    Ok((interface, load_layout(&file.sibling(layout)?)?))
}

/// Returns the value of a key that this port needs.
///
/// # Errors
/// Names the key where it is missing.
pub(super) fn needed<T>(file: &ConfigFile, key: &str, value: Option<T>) -> Result<T, ConfigError> {
    value.ok_or_else(|| file.error(format!("{key}: is missing, which this port needs")))
}
