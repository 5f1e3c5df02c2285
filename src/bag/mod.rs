//! Bags of ROS 2 (rosbag2): MCAP and SQLite files, or a folder of them with its `metadata.yaml`.
//!
//! Reads recordings of Humble to Kilted. An interrupted recording is read up to its last complete message, and
//! [`Bag::notes`] says so.

mod compression;
mod error;
mod files;
mod limits;
mod mcap;
mod message;
mod sqlite;
#[cfg(test)]
pub(crate) mod tests;

pub use error::BagError;
pub use message::{BagTopic, RecordedMessage};

use files::{BagFile, Storage};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A bag whose topics are known.
#[derive(Debug)]
pub struct Bag {
    path: PathBuf,
    files: Vec<BagFile>,
    topics: BTreeMap<BagTopic, usize>,
    notes: Vec<String>,
}

/// Returns whether a file or folder is to be read as a bag, by its name.
pub fn is_bag(path: &Path) -> bool {
    path.is_dir() || Storage::of_name(path).is_some()
}

impl Bag {
    /// Finds the files of a bag and reads them once for their topics. `max_bytes` is the most that one of its files
    /// may hold when decompressed; without it, 64 MB or 50 times its size, whichever is more.
    ///
    /// # Errors
    /// [`BagError`] with the file that cannot be read, is not a bag, holds too much, or contains no message.
    pub fn open(path: &Path, max_bytes: Option<u64>) -> Result<Self, BagError> {
        let (mut files, mut notes) = files::find(path, max_bytes)?;
        let mut topics: BTreeMap<BagTopic, usize> = BTreeMap::new();
        files.retain(|file| {
            if file.blank() {
                let name = file.path.file_name().unwrap_or_default().display();
                notes.push(format!(
                    "{name}: nothing was written to it, as after a power cut; the other files are used"
                ));
            }
            !file.blank()
        });
        for file in &files {
            let outcome = file.read(&mut |message| {
                match topics.get_mut(message.topic) {
                    Some(count) => *count += 1,
                    None => drop(topics.insert(message.topic.clone(), 1)),
                }
                Ok(())
            })?;
            for topic in outcome.topics {
                topics.entry(topic).or_default();
            }
            notes.extend(outcome.cut_off.map(|reason| {
                let name = file.path.file_name().unwrap_or_default().display();
                format!("{name}: the recording was interrupted ({reason}); what precedes is used")
            }));
        }
        if topics.values().all(|count| *count == 0) {
            return Err(BagError::NoMessages {
                bag: path.to_owned(),
                notes: notes.join("; "),
            });
        }
        Ok(Self {
            path: path.to_owned(),
            files,
            topics,
            notes,
        })
    }

    /// Returns the name it was opened by.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns notes for the user about its state: files that were interrupted.
    pub fn notes(&self) -> &[String] {
        &self.notes
    }

    /// Returns its topics and how many messages each has.
    pub fn topics(&self) -> impl Iterator<Item = (&BagTopic, usize)> {
        self.topics.iter().map(|(topic, count)| (topic, *count))
    }

    /// Returns its topics as a list for a message: a line each with name, type and number of messages.
    pub fn topic_list(&self) -> String {
        let line = |(topic, count): (&BagTopic, usize)| {
            format!(
                "\n  {} ({}, {count} messages)",
                topic.name, topic.message_type
            )
        };
        self.topics().map(line).collect()
    }

    /// Calls `visit` for each message in the order of recording.
    ///
    /// # Errors
    /// That of `visit`, or [`BagError`] of a file that can no longer be read.
    pub fn read(
        &self,
        visit: &mut dyn FnMut(RecordedMessage<'_>) -> Result<(), BagError>,
    ) -> Result<(), BagError> {
        for file in &self.files {
            file.read(visit)?;
        }
        Ok(())
    }
}
