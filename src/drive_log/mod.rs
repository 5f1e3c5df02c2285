//! Logs of drives: CSV with a column map and ROS 2 bags with a topic map, both converted to the same rows.

mod choice;
mod fixes;
mod interpolation;
mod joints;
mod live_positions;
mod positions;
mod rows;
mod series;
#[cfg(test)]
mod tests;
mod topics;
mod transform_poses;

pub use choice::Chosen;
pub use live_positions::LivePositions;
pub use positions::{Positions, positions};
pub use topics::{AttitudeTopic, PoseTopic, StampSource, TopicMap, TreadSpeedTopic};

use crate::config::{ConfigFile, no_text};
use crate::console;
use anyhow::{Context, Result, bail};
use sidehill_plant::log::{ColumnMap, DriveLog};
use std::path::{Path, PathBuf};

/// Arguments of every command that reads logs: what their columns or topics mean.
#[derive(Debug, Clone, Default, PartialEq, Eq, clap::Args)]
pub struct LogArgs {
    /// YAML file that names the columns of CSV logs, if they are not time_s, v_left_m_s,
    /// v_right_m_s, roll_rad, pitch_rad, x_m, y_m, z_m, yaw_rad.
    #[arg(long, value_name = "FILE")]
    pub columns: Option<PathBuf>,
    /// YAML file that names the topics of logs that are ROS 2 bags (a folder, .mcap or .db3).
    #[arg(long, value_name = "FILE")]
    pub topics: Option<PathBuf>,
}

/// Reads logs by their maps.
#[derive(Debug)]
pub struct LogReader {
    columns: ColumnMap,
    /// With the name of its file.
    topics: Option<(String, TopicMap)>,
}

impl LogReader {
    /// Reads the maps.
    ///
    /// # Errors
    /// Names the file and key at fault.
    pub fn new(args: &LogArgs) -> Result<Self> {
        let columns = args.columns.as_deref();
        let columns = columns.map_or_else(
            || Ok(ColumnMap::default()),
            |path| ConfigFile::read(path)?.parse(),
        )?;
        let topics = match &args.topics {
            Some(path) => {
                let file = ConfigFile::read(path)?;
                Some((file.name(), TopicMap::read(&file)?))
            }
            None => None,
        };
        Ok(Self { columns, topics })
    }

    /// Returns the log of a file or bag, and prints warnings about it.
    ///
    /// # Errors
    /// Names the file and row, column, topic or key at fault.
    pub fn read(&self, path: &Path) -> Result<DriveLog> {
        let name = || path.display().to_string();
        let log = self.read_rows(path)?;
        for suspicion in log.suspicions() {
            console::complain(format_args!("{}: warning: {suspicion}", name()));
        }
        Ok(log)
    }

    fn read_rows(&self, path: &Path) -> Result<DriveLog> {
        if !crate::bag::is_bag(path) {
            return self.read_csv(path);
        }
        let bag = crate::bag::Bag::open(path)?;
        let chosen = Chosen::of(&bag, self.topics.as_ref())?;
        let (log, notes) = rows::log(&bag, &chosen)?;
        for note in bag.notes().iter().chain(&chosen.notes).chain(&notes) {
            console::complain(format_args!("{}: note: {note}", path.display()));
        }
        Ok(log)
    }

    fn read_csv(&self, path: &Path) -> Result<DriveLog> {
        let name = || path.display().to_string();
        let bytes = std::fs::read(path).with_context(name)?;
        if let Some(reason) = no_text(&bytes) {
            bail!("{}: {reason}", name());
        }
        DriveLog::read(bytes.as_slice(), &self.columns).with_context(name)
    }
}
