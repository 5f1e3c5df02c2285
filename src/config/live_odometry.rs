//! Configuration of `odometry --live`.

use super::{ConfigError, ConfigFile};
use serde::Deserialize;
use sidehill_bridge::ros2::convert::TwistMapping;
use sidehill_bridge::ros2::settings::odometry::OdometryConfig;
use sidehill_bridge::ros2::settings::topics::SpeedSource;
use sidehill_plant::vehicle::Vehicle;
use std::path::PathBuf;

/// What `sidehill odometry --live` reads.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LiveOdometryConfig {
    /// [Vehicle](#vehicle) file.
    pub vehicle: PathBuf,
    /// [Topics, frames and times](#topics-of-the-odometry-node).
    #[serde(default)]
    pub ros2: OdometryConfig,
}

impl LiveOdometryConfig {
    /// Returns the vehicle of a configuration whose values are all in range.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault, key, value and range.
    pub fn checked(&self, file: &ConfigFile) -> Result<Vehicle, ConfigError> {
        let vehicle: Vehicle = file.sibling(&self.vehicle)?.parse()?;
        self.ros2
            .validate()
            .and_then(|()| TwistMapping::new(self.ros2.track_width_m, &vehicle).map(drop))
            .map_err(|error| file.error(error))?;
        if self.ros2.speeds == SpeedSource::Commands {
            return Err(file
                .error("ros2.speeds: commands are no odometry, must be odometry or joint_states"));
        }
        Ok(vehicle)
    }
}
