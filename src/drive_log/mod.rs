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
use crate::log_file;
use anyhow::{Context, Result};
use sidehill_plant::log::DriveRecord;
use sidehill_plant::log::{ColumnMap, DriveLog, read_commands};
use sidehill_plant::speeds::EncoderScale;
use std::io::Read;
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

    /// Returns the log of a file or bag; `note` gets what was left out of it or looks wrong, a line each with its name.
    ///
    /// # Errors
    /// Names the file and row, column, topic or key at fault.
    pub fn read(&self, path: &Path, mut note: impl FnMut(String)) -> Result<DriveLog> {
        let name = path.display().to_string();
        if !crate::bag::is_bag(path) {
            let source = log_file::open(path, self.max_bytes)?;
            return self.read_text(&name, source, note);
        }
        let (log, notes) = self.read_bag(path)?;
        for text in &notes {
            note(format!("{name}: note: {text}"));
        }
        judge(&name, &log, note);
        Ok(log)
    }

    /// As [`Self::read`], of a CSV text with a name for messages.
    ///
    /// # Errors
    /// Names the row and column at fault.
    pub fn read_text(
        &self,
        name: &str,
        csv: impl Read,
        note: impl FnMut(String),
    ) -> Result<DriveLog> {
        let log = DriveLog::read(csv, &self.columns).with_context(|| name.to_owned())?;
        judge(name, &log, note);
        Ok(log)
    }

    /// Returns the log of a bag with notes.
    fn read_bag(&self, path: &Path) -> Result<(DriveLog, Vec<String>)> {
        if let (None, Some(series)) = (&self.topics, own::read(path)?) {
            return rows::rows(&path.display().to_string(), series);
        }
        let bag = crate::bag::Bag::open(path, self.max_bytes)?;
        let chosen = Chosen::of(&bag, self.topics.as_ref())?;
        let (log, notes) = rows::log(&bag, &chosen)?;
        let all = bag.notes().iter().chain(&chosen.notes).cloned();
        Ok((log, all.chain(notes).collect()))
    }

    /// Returns commands and measured speeds of a file, bag or recording, effective by `scale` where the commands are;
    /// `note` gets what was left out, a line each with its name.
    ///
    /// # Errors
    /// Names the file and row, column, topic or key at fault.
    pub fn read_commands(
        &self,
        path: &Path,
        scale: &EncoderScale,
        mut note: impl FnMut(String),
    ) -> Result<DriveRecord> {
        let name = path.display().to_string();
        if !crate::bag::is_bag(path) {
            let source = log_file::open(path, self.max_bytes)?;
            return self.read_commands_of_text(&name, source, scale, note);
        }
        let (record, notes) = commands::record(path, self.topics.as_ref(), self.max_bytes, scale)?;
        for text in &notes {
            note(format!("{name}: note: {text}"));
        }
        Ok(record)
    }

    /// As [`Self::read_commands`], of a CSV text with a name for messages.
    ///
    /// # Errors
    /// Names the row and column at fault.
    pub fn read_commands_of_text(
        &self,
        name: &str,
        csv: impl Read,
        scale: &EncoderScale,
        mut note: impl FnMut(String),
    ) -> Result<DriveRecord> {
        let (record, text) =
            read_commands(csv, &self.columns, scale).with_context(|| name.to_owned())?;
        if let Some(text) = text {
            note(format!("{name}: note: {text}"));
        }
        Ok(record)
    }
}

/// Hands on what a log says of itself.
fn judge(name: &str, log: &DriveLog, mut note: impl FnMut(String)) {
    for text in log.notes() {
        note(format!("{name}: note: {text}"));
    }
    for suspicion in log.suspicions() {
        note(format!("{name}: warning: {suspicion}"));
    }
}
