//! Logs of drives: CSV with a column map and ROS 2 bags with a topic map, both converted to the same rows.

#[cfg(feature = "drive")]
mod choice;
#[cfg(feature = "drive")]
mod commands;
#[cfg(feature = "drive")]
mod fixes;
#[cfg(feature = "drive")]
mod interpolation;
#[cfg(feature = "drive")]
mod joints;
#[cfg(feature = "drive")]
mod live_positions;
#[cfg(feature = "drive")]
mod positions;
#[cfg(feature = "drive")]
mod rows;
#[cfg(feature = "drive")]
mod series;
#[cfg(test)]
mod tests;
mod topics;
#[cfg(feature = "drive")]
mod transform_poses;

#[cfg(feature = "drive")]
pub use choice::Chosen;
#[cfg(feature = "drive")]
pub use live_positions::LivePositions;
#[cfg(feature = "drive")]
pub use positions::{Positions, positions};
pub use topics::{AttitudeTopic, CommandTopic, PoseTopic, StampSource, TopicMap, TreadSpeedTopic};

use crate::config::{ConfigFile, no_text};
use crate::console;
use anyhow::{Context, Result, bail};
use sidehill_plant::identification::DriveRecord;
use sidehill_plant::log::{ColumnMap, DriveLog, read_commands};
use sidehill_plant::speeds::EncoderScale;
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

    #[cfg(feature = "drive")]
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

    #[cfg(not(feature = "drive"))]
    fn read_rows(&self, path: &Path) -> Result<DriveLog> {
        anyhow::ensure!(self.topics.is_none(), "--topics: this build reads no bags");
        self.read_csv(path)
    }

    /// Returns commands and measured speeds of a file, bag or recording, effective by `scale` where the commands are.
    ///
    /// # Errors
    /// Names the file and row, column, topic or key at fault.
    pub fn read_commands(&self, path: &Path, scale: &EncoderScale) -> Result<DriveRecord> {
        #[cfg(feature = "drive")]
        if crate::bag::is_bag(path) {
            return commands::record(path, self.topics.as_ref(), scale);
        }
        let name = || path.display().to_string();
        let bytes = std::fs::read(path).with_context(name)?;
        if let Some(reason) = no_text(&bytes) {
            bail!("{}: {reason}", name());
        }
        read_commands(bytes.as_slice(), &self.columns, scale).with_context(name)
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
