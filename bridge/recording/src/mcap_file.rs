//! Recordings as MCAP files, split by size.

use super::messages::Topic;
use super::sink::MessageSink;
use super::whole_file::{PENDING_MAX, WholeFile};
use mcap::records::{MessageHeader, Metadata};
use mcap::{Attachment, McapError, WriteOptions, Writer};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Error, ErrorKind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest time that messages wait for the disk.
const FLUSH_PERIOD: Duration = Duration::from_millis(500);
const MEGABYTE: u64 = 1_000_000;

/// How large a recording may become.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RecordLimits {
    /// Largest size of a file, MB.
    pub max_size: f64,
    /// Whether a file that is full is followed by another. Otherwise the recording ends.
    pub split: bool,
    /// Newest files that are kept, with `split`; 0 keeps all.
    pub keep: u32,
}

impl Default for RecordLimits {
    fn default() -> Self {
        Self {
            max_size: 2000.0,
            split: true,
            keep: 0,
        }
    }
}

impl RecordLimits {
    /// Checks every range.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(1.0, 1e6, "MB").check("max_size", self.max_size)?;
        Bounds::new(0.0, 1e6, "")
            .check("keep", f64::from(self.keep))
            .map(drop)
    }
}

/// What every file of a recording begins with.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Header {
    /// Facts by name.
    pub facts: BTreeMap<String, String>,
    /// Configuration files by the names under which they were read.
    pub files: BTreeMap<PathBuf, String>,
}

/// How a recording fares.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct RecordingStatus {
    /// The file that is written.
    pub file: PathBuf,
    /// Bytes on the disk, in all files.
    pub bytes: u64,
    /// Why nothing is recorded any more.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ended: Option<String>,
}

/// Name of the metadata that a recording of this program has.
pub(super) const METADATA: &str = "sidehill";

/// Layout of the messages. It grows with every change of a message that an older reader would misread.
pub(super) const FORMAT: &str = "2";
/// Name of the fact that holds it.
pub(super) const FORMAT_FACT: &str = "format";

/// Records messages to MCAP files. Never fails after it was created: what the disk refuses ends the
/// recording, and [`McapRecording::status`] says so.
pub struct McapRecording {
    path: PathBuf,
    header: Header,
    limits: RecordLimits,
    part: u32,
    parts: Vec<PathBuf>,
    open: Option<RecordingPart>,
    /// Bytes of the files before this one.
    earlier: u64,
    status: RecordingStatus,
    flushed: Instant,
    /// Whether messages wait for the disk.
    waiting: bool,
    /// What every file repeats, so that it can be replayed and looked at without those before it: the newest
    /// path, and the scene that stays.
    latched: BTreeMap<Topic, (u64, Vec<u8>)>,
    /// Log times never go back: readers without an index rely on it.
    newest_ns: u64,
}

struct RecordingPart {
    writer: Writer<WholeFile>,
    channels: BTreeMap<Topic, (u16, u32)>,
    /// Bytes given to the writer.
    bytes: u64,
}

impl McapRecording {
    /// Creates the first file. It replaces a file of that name only with `replace`; no other file is ever replaced:
    /// parts take numbers that are free.
    ///
    /// # Errors
    /// The disk's; a file that is there, or that another program is recording to.
    pub fn create(
        path: &Path,
        header: Header,
        limits: RecordLimits,
        replace: bool,
    ) -> Result<Self, Error> {
        if replace {
            make_way(path)?;
        }
        let mut recording = Self {
            path: path.to_owned(),
            header,
            limits,
            part: 0,
            parts: Vec::new(),
            open: None,
            earlier: 0,
            status: RecordingStatus::default(),
            flushed: Instant::now(),
            waiting: false,
            newest_ns: 0,
            latched: BTreeMap::new(),
        };
        recording.begin_part()?;
        Ok(recording)
    }

    /// Returns how the recording fares.
    pub fn status(&self) -> &RecordingStatus {
        &self.status
    }

    /// Returns the name of a file of the recording at `path`; the first has that name itself.
    pub fn part_name(path: &Path, part: u32) -> PathBuf {
        if part == 0 {
            return path.to_owned();
        }
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        path.with_file_name(format!("{stem}_{part}.{ending}"))
    }

    /// Returns the name of the first file of the recording whose file `part` is at `path`.
    pub(super) fn first_name(path: &Path, part: u32) -> PathBuf {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        match stem.strip_suffix(&format!("_{part}")) {
            Some(first) if part > 0 => path.with_file_name(format!("{first}.{ending}")),
            _ => path.to_owned(),
        }
    }

    /// Returns the files whose names belong to a recording at `path`, of whatever recording they are, with their
    /// numbers and in their order.
    ///
    /// # Errors
    /// The folder cannot be read.
    pub fn present(path: &Path) -> Result<Vec<(u32, PathBuf)>, Error> {
        let folder = match path.parent() {
            Some(parent) if !parent.as_os_str().is_empty() => parent,
            _ => Path::new("."),
        };
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        let number = |name: &str| -> Option<u32> {
            let stem_found = name.strip_suffix(&*ending)?.strip_suffix('.')?;
            match stem_found.strip_prefix(&*stem)? {
                "" => Some(0),
                rest => rest.strip_prefix('_')?.parse().ok(),
            }
        };
        let mut found = Vec::new();
        for entry in std::fs::read_dir(folder)? {
            let name = entry?.file_name().to_string_lossy().into_owned();
            if let Some(number) = number(&name) {
                let file = Self::part_name(path, number);
                found.extend((file.file_name() == Some(name.as_ref())).then_some((number, file)));
            }
        }
        found.sort();
        Ok(found)
    }

    /// Gives what has waited long enough to the disk. To be called about as often as messages come.
    pub fn flush_when_due(&mut self) {
        if self.waiting && self.flushed.elapsed() >= FLUSH_PERIOD {
            self.attempt(Self::flush);
        }
    }

    /// Writes the index and closes the file.
    pub fn finish(mut self) -> RecordingStatus {
        self.attempt(Self::end_part);
        self.status
    }

    /// Does something with the file; a failure ends the recording.
    fn attempt(&mut self, what: impl FnOnce(&mut Self) -> Result<(), Error>) {
        if self.open.is_some()
            && let Err(error) = what(self)
        {
            self.open = None;
            self.status.ended = Some(format!("{}: {error}", self.status.file.display()));
        }
    }

    fn begin_part(&mut self) -> Result<(), Error> {
        let (name, file) = loop {
            let name = Self::part_name(&self.path, self.part);
            // Neither follows a link nor opens a file that is there.
            let created = OpenOptions::new().write(true).create_new(true).open(&name);
            match created {
                Ok(file) => break (name, file),
                Err(error) if error.kind() == ErrorKind::AlreadyExists && self.part > 0 => {
                    self.part += 1;
                }
                Err(error) => return Err(error),
            }
        };
        // Only a program that replaces a file asks for the lock; some file systems have none.
        let _ = file.try_lock();
        let program = format!("sidehill {}", env!("CARGO_PKG_VERSION"));
        let mut writer = WriteOptions::library(WriteOptions::new(), program)
            .profile("ros2")
            .compression(None)
            .calculate_data_section_crc(false)
            .create(WholeFile::new(file))
            .map_err(io_error)?;
        let mut facts = self.header.facts.clone();
        facts.insert("part".to_owned(), self.part.to_string());
        facts.insert(FORMAT_FACT.to_owned(), FORMAT.to_owned());
        let mut bytes = 0;
        writer
            .write_metadata(&Metadata {
                name: METADATA.to_owned(),
                metadata: facts,
            })
            .map_err(io_error)?;
        for (name, text) in &self.header.files {
            bytes += text.len() as u64;
            writer
                .attach(&Attachment {
                    log_time: self.newest_ns,
                    create_time: 0,
                    name: name.to_string_lossy().into_owned(),
                    media_type: "text/plain".to_owned(),
                    data: Cow::Borrowed(text.as_bytes()),
                })
                .map_err(io_error)?;
        }
        let mut channels = BTreeMap::new();
        for topic in Topic::ALL {
            let schema = topic.schema();
            let id = writer
                .add_schema(&topic.type_name(), "ros2msg", schema.as_bytes())
                .and_then(|schema| writer.add_channel(schema, topic.name(), "cdr", &qos()))
                .map_err(io_error)?;
            channels.insert(topic, (id, 0));
        }
        self.status.file = name.clone();
        self.parts.push(name);
        self.open = Some(RecordingPart {
            writer,
            channels,
            bytes: bytes + 1,
        });
        self.flush()
    }

    fn flush(&mut self) -> Result<(), Error> {
        self.flushed = Instant::now();
        self.waiting = false;
        if let Some(part) = &mut self.open {
            part.writer.flush().map_err(io_error)?;
            self.status.bytes = self.earlier + part.bytes;
        }
        Ok(())
    }

    fn end_part(&mut self) -> Result<(), Error> {
        if let Some(mut part) = self.open.take() {
            part.writer.flush().map_err(io_error)?;
            part.writer.finish().map_err(io_error)?;
            let size = part.writer.into_inner().finish()?;
            self.earlier += size;
            self.status.bytes = self.earlier;
        }
        Ok(())
    }

    fn append(&mut self, topic: Topic, time_ns: u64, message: &[u8]) -> Result<(), Error> {
        match topic {
            Topic::PathCommand | Topic::Path => {
                self.latched.insert(topic, (time_ns, message.to_vec()));
            }
            Topic::Scene => {
                self.latched
                    .entry(topic)
                    .or_insert_with(|| (time_ns, message.to_vec()));
            }
            _ => {}
        }
        let before = self.open.as_ref().map_or(0, |part| part.bytes);
        self.write(topic, time_ns, message)?;
        let Some(bytes) = self.open.as_ref().map(|part| part.bytes) else {
            return Ok(());
        };
        if bytes >= (self.limits.max_size * MEGABYTE as f64) as u64 {
            return self.next_part();
        }
        if bytes / PENDING_MAX as u64 != before / PENDING_MAX as u64 {
            self.flush()?;
        }
        Ok(())
    }

    fn write(&mut self, topic: Topic, time_ns: u64, message: &[u8]) -> Result<(), Error> {
        let Some(part) = &mut self.open else {
            return Ok(());
        };
        let Some((channel, sequence)) = part.channels.get_mut(&topic) else {
            return Ok(());
        };
        *sequence += 1;
        self.waiting = true;
        self.newest_ns = self.newest_ns.max(time_ns);
        part.writer
            .write_to_known_channel(
                &MessageHeader {
                    channel_id: *channel,
                    sequence: *sequence,
                    log_time: self.newest_ns,
                    publish_time: time_ns,
                },
                message,
            )
            .map_err(io_error)?;
        // Header and index of a message have 47 bytes.
        part.bytes += message.len() as u64 + 47;
        Ok(())
    }

    fn next_part(&mut self) -> Result<(), Error> {
        self.end_part()?;
        if !self.limits.split {
            self.status.ended = Some("the file has reached record.max_size".to_owned());
            return Ok(());
        }
        self.part += 1;
        let keep = self.limits.keep as usize;
        while keep > 0 && self.parts.len() >= keep {
            std::fs::remove_file(self.parts.remove(0))?;
        }
        self.begin_part()?;
        for (topic, (time_ns, message)) in std::mem::take(&mut self.latched) {
            self.write(topic, time_ns, &message)?;
            self.latched.insert(topic, (time_ns, message));
        }
        Ok(())
    }
}

impl MessageSink for McapRecording {
    fn put(&mut self, topic: Topic, time_ns: u64, message: &[u8]) {
        self.attempt(|this| this.append(topic, time_ns, message));
    }
}

/// Removes a file so that a recording can take its name; the file that a link leads to stays.
fn make_way(path: &Path) -> Result<(), Error> {
    match std::fs::metadata(path) {
        Ok(found) if found.is_file() => {
            if let Err(TryLockError::WouldBlock) = File::open(path)?.try_lock() {
                return Err(Error::new(
                    ErrorKind::ResourceBusy,
                    "another program is recording to it",
                ));
            }
        }
        Ok(_) => return Err(Error::new(ErrorKind::AlreadyExists, "is not a file")),
        Err(_) => {}
    }
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

/// What rosbag2 stores of a topic's quality of service.
fn qos() -> BTreeMap<String, String> {
    BTreeMap::from([("offered_qos_profiles".to_owned(), String::new())])
}

fn io_error(error: McapError) -> Error {
    match error {
        McapError::Io(error) => error,
        other => Error::other(other),
    }
}
