//! Logs of drives: CSV with a column map and ROS 2 bags with a topic map, both converted to the same rows.

mod choice;
mod commands;
mod fixes;
mod interpolation;
mod joints;
mod live_positions;
mod own;
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
pub use topics::{
    AttitudeTopic, CommandTopic, ImuAxes, PoseTopic, StampSource, TopicMap, TreadSpeedTopic,
};

use crate::config::ConfigFile;
use crate::console;
use crate::log_file;
use anyhow::{Context, Result};
use sidehill_plant::log::DriveRecord;
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
    /// Largest size of a log, and of what one of its files decompresses to, bytes; by default 1 GB for
    /// CSV, and for a file of a bag 64 MB or 50 times its size, whichever is more.
    #[arg(long, value_name = "BYTES")]
    pub max_bytes: Option<u64>,
}

/// Reads logs by their maps.
#[derive(Debug)]
pub struct LogReader {
    columns: ColumnMap,
    /// With the name of its file.
    topics: Option<(String, TopicMap)>,
    max_bytes: Option<u64>,
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
        Ok(Self {
            columns,
            topics,
            max_bytes: args.max_bytes,
        })
    }

    /// Returns the log of a file or bag, and prints warnings about it.
    ///
    /// # Errors
    /// Names the file and row, column, topic or key at fault.
    pub fn read(&self, path: &Path) -> Result<DriveLog> {
        let name = || path.display().to_string();
        let log = self.read_rows(path)?;
        for note in log.notes() {
            console::complain(format_args!("{}: note: {note}", name()));
        }
        for suspicion in log.suspicions() {
            console::complain(format_args!("{}: warning: {suspicion}", name()));
        }
        Ok(log)
    }

    fn read_rows(&self, path: &Path) -> Result<DriveLog> {
        if !crate::bag::is_bag(path) {
            return self.read_csv(path);
        }
        if let (None, Some(series)) = (&self.topics, own::read(path)?) {
            let (log, notes) = rows::rows(&path.display().to_string(), series)?;
            for note in &notes {
                console::complain(format_args!("{}: note: {note}", path.display()));
            }
            return Ok(log);
        }
        let bag = crate::bag::Bag::open(path, self.max_bytes)?;
        let chosen = Chosen::of(&bag, self.topics.as_ref())?;
        let (log, notes) = rows::log(&bag, &chosen)?;
        for note in bag.notes().iter().chain(&chosen.notes).chain(&notes) {
            console::complain(format_args!("{}: note: {note}", path.display()));
        }
        Ok(log)
    }

    /// Returns commands and measured speeds of a file, bag or recording, effective by `scale` where the commands are,
    /// and prints what was left out.
    ///
    /// # Errors
    /// Names the file and row, column, topic or key at fault.
    pub fn read_commands(&self, path: &Path, scale: &EncoderScale) -> Result<DriveRecord> {
        if crate::bag::is_bag(path) {
            return commands::record(path, self.topics.as_ref(), self.max_bytes, scale);
        }
        let name = || path.display().to_string();
        let source = log_file::open(path, self.max_bytes)?;
        let (record, note) = read_commands(source, &self.columns, scale).with_context(name)?;
        if let Some(note) = note {
            console::complain(format_args!("{}: note: {note}", name()));
        }
        Ok(record)
    }

    fn read_csv(&self, path: &Path) -> Result<DriveLog> {
        let source = log_file::open(path, self.max_bytes)?;
        DriveLog::read(source, &self.columns).with_context(|| path.display().to_string())
    }
}
