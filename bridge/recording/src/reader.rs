//! Reading recordings of this program, also those that were cut off.

use super::framing::{Framed, Records, changed, cut_off_chunk, in_chunk};
use super::mcap_file::{FORMAT, FORMAT_FACT, Header, METADATA, McapRecording};
use super::messages::{ControllerCycle, PathCommand, Topic};
use mcap::records::{ChunkHeader, Record, op};
use sidehill_bridge::control_loop::tap::{PathRecord, RecordedPath};
use sidehill_bridge::ros2::message::cdr::{CdrError, from_cdr};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::{MeasuredTreadSpeeds, MotorSpeeds};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// Why a recording cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RecordingError {
    /// The file cannot be read.
    #[error("{}: {reason}", file.display())]
    Read {
        /// The file.
        file: PathBuf,
        /// Why not.
        reason: std::io::Error,
    },
    /// It is not a recording of this program.
    #[error("{}: {reason}", file.display())]
    NotOurs {
        /// The file.
        file: PathBuf,
        /// What is missing.
        reason: String,
    },
    /// Its messages are laid out as those of another version.
    #[error(
        "{}: its messages have layout {found}, this program reads layout {FORMAT}; replay it with the version of sidehill that recorded it{}",
        file.display(), version.as_ref().map_or_else(String::new, |version| format!(", {version}"))
    )]
    Format {
        /// The file.
        file: PathBuf,
        /// Layout that the file names.
        found: String,
        /// Version of the program that recorded it, where it says so.
        version: Option<String>,
    },
    /// A message does not hold what its schema says.
    #[error("{}: a message of {topic} is damaged: {reason}", file.display())]
    Message {
        /// The file.
        file: PathBuf,
        /// Its topic.
        topic: &'static str,
        /// What is wrong.
        reason: CdrError,
    },
}

/// A recording, read as far as it goes.
#[derive(Debug, Clone, Default)]
pub struct Recording {
    /// What it begins with.
    pub header: Header,
    /// Steps of the controller, in order.
    pub cycles: Vec<ControllerCycle>,
    /// Paths by their serials.
    pub paths: BTreeMap<u64, PathRecord>,
    /// Why reading ended before the end of the file; none where it did not.
    pub damaged: Option<String>,
    /// Files read.
    pub files: Vec<PathBuf>,
}

impl Recording {
    /// Reads a recording from any of its files: those before it that are left, and those that continue it.
    ///
    /// # Errors
    /// [`RecordingError`]; not for a file that was cut off.
    pub fn read(path: &Path) -> Result<Self, RecordingError> {
        let mut named = Self::default();
        named.add(path)?;
        let part = named.part().unwrap_or(0);
        let first = McapRecording::first_name(path, part);
        let mut recording = Self::default();
        // Numbers may be missing: older files were deleted, and names in use were passed over.
        let present = McapRecording::present(&first).unwrap_or_default();
        let (before, after): (Vec<_>, Vec<_>) = present
            .into_iter()
            .filter(|(number, _)| *number != part)
            .partition(|(number, _)| *number < part);
        let others = |files: Vec<(u32, PathBuf)>| {
            let other = |(number, name): (u32, PathBuf)| named.neighbour(&name, number);
            files.into_iter().filter_map(other).collect::<Vec<_>>()
        };
        let (before, after) = (others(before), others(after));
        recording.header = named.header.clone();
        for file in before.into_iter().chain([named]).chain(after) {
            recording.append(file);
        }
        Ok(recording)
    }

    /// Returns the number of this file in its recording.
    fn part(&self) -> Option<u32> {
        self.header.facts.get("part")?.parse().ok()
    }

    /// Returns another file of the same recording, where it is there.
    fn neighbour(&self, name: &Path, part: u32) -> Option<Self> {
        // Its first message ends this pass: another recording is not read any further.
        let mut header = Header::default();
        let _ = scan_with(name, &mut header, &mut |_, _, _| {
            Err(RecordingError::NotOurs {
                file: name.to_owned(),
                reason: String::new(),
            })
        });
        let same = |fact: &str, expected: Option<&str>| {
            header.facts.get(fact).map(String::as_str) == expected
        };
        let id = self.header.facts.get("recording").map(String::as_str);
        if !same("recording", id) || !same("part", Some(&part.to_string())) {
            return None;
        }
        let mut other = Self::default();
        other.add(name).ok().map(|()| other)
    }

    fn append(&mut self, mut file: Self) {
        self.cycles.append(&mut file.cycles);
        self.paths.append(&mut file.paths);
        self.files.append(&mut file.files);
        self.damaged = self.damaged.take().or(file.damaged);
    }

    fn add(&mut self, path: &Path) -> Result<(), RecordingError> {
        let mut header = Header::default();
        let mut visit = |topic, _: u64, message: &[u8]| self.take(path, topic, message);
        let damaged = scan_with(path, &mut header, &mut visit)?;
        self.header = header;
        self.damaged = damaged;
        self.files.push(path.to_owned());
        Ok(())
    }

    fn take(&mut self, file: &Path, topic: Topic, message: &[u8]) -> Result<(), RecordingError> {
        let damaged = |reason| RecordingError::Message {
            file: file.to_owned(),
            topic: topic.name(),
            reason,
        };
        match topic {
            Topic::ControllerCycle => self.cycles.push(from_cdr(message).map_err(damaged)?),
            Topic::PathCommand => {
                let command: PathCommand = from_cdr(message).map_err(damaged)?;
                let path = command
                    .present
                    .then(|| -> Result<_, CdrError> {
                        Ok(RecordedPath {
                            trajectory: from_cdr(&command.trajectory)?,
                            number: command.number,
                            laps: command.laps,
                            from_m: command.joined.then_some(command.from_m),
                        })
                    })
                    .transpose()
                    .map_err(damaged)?;
                let serial = command.serial;
                self.paths.insert(serial, PathRecord { serial, path });
            }
            _ => {}
        }
        Ok(())
    }
}

/// Takes a message of a recording: topic, time in ns and CDR.
type TakeMessage<'a> = dyn FnMut(Topic, u64, &[u8]) -> Result<(), RecordingError> + 'a;

/// Gives every message of one file of a recording to `visit`, with the fields of this version, and returns
/// why reading ended before the end of the file, where it did.
///
/// # Errors
/// A file that cannot be read, or the first error of `visit`.
pub fn scan(path: &Path, visit: &mut TakeMessage<'_>) -> Result<Option<String>, RecordingError> {
    scan_with(path, &mut Header::default(), visit)
}

fn scan_with(
    path: &Path,
    header: &mut Header,
    visit: &mut TakeMessage<'_>,
) -> Result<Option<String>, RecordingError> {
    let unreadable = |reason| RecordingError::Read {
        file: path.to_owned(),
        reason,
    };
    let source = BufReader::new(File::open(path).map_err(unreadable)?);
    let mut scan = Scan {
        path,
        header,
        visit,
        channels: BTreeMap::new(),
        ours: false,
    };
    let mut damaged = None;
    if let Some(mut records) = Records::begin(source).map_err(unreadable)? {
        damaged = loop {
            let taken = match records.next_record().map_err(unreadable)? {
                Framed::End => break None,
                Framed::CutOff(reason) => break Some(reason.to_owned()),
                Framed::CutOffChunk(body) => {
                    if let Some((header, data)) = cut_off_chunk(&body) {
                        scan.chunk(&header, data)?;
                    }
                    break Some("its last chunk was not finished".to_owned());
                }
                Framed::Whole { op, body } => scan.record(op, &body)?,
            };
            match taken {
                Taken::Used => {}
                Taken::Damaged(reason) => break Some(reason),
                // Nothing more is read of another program's recording.
                Taken::Foreign => break None,
            }
        };
    }
    if !scan.ours {
        return Err(RecordingError::NotOurs {
            file: path.to_owned(),
            reason: "not a recording of sidehill (`--record`): it has no metadata `sidehill`. Logs and bags of other programs are \
                     read by `odometry`, `identify` and `route`"
                .to_owned(),
        });
    }
    Ok(damaged)
}

/// Refuses messages of another layout. Those of recordings that name none are of layout 1.
fn check_format(file: &Path, header: &Header) -> Result<(), RecordingError> {
    let found = header.facts.get(FORMAT_FACT).map_or("1", String::as_str);
    if found == FORMAT {
        return Ok(());
    }
    Err(RecordingError::Format {
        file: file.to_owned(),
        found: found.to_owned(),
        version: header.facts.get("version").cloned(),
    })
}

/// What became of a record.
enum Taken {
    Used,
    Damaged(String),
    /// Recordings of this program begin with their metadata: this is none.
    Foreign,
}

/// State while a file is read.
struct Scan<'a, 'b> {
    path: &'a Path,
    header: &'a mut Header,
    visit: &'a mut TakeMessage<'b>,
    /// Topics of the channels.
    channels: BTreeMap<u16, Topic>,
    ours: bool,
}

impl Scan<'_, '_> {
    fn chunk(&mut self, header: &ChunkHeader, records: &[u8]) -> Result<Taken, RecordingError> {
        let compression = &header.compression;
        if !compression.is_empty() {
            return Ok(if self.ours {
                Taken::Damaged(format!("a chunk is compressed by {compression:?}"))
            } else {
                Taken::Foreign
            });
        }
        if let Some(reason) = changed(header, records) {
            return Ok(Taken::Damaged(reason.to_owned()));
        }
        let mut last = Taken::Used;
        let rest = in_chunk(records, |op, body| {
            // A chunk within a chunk is none.
            if matches!(last, Taken::Used) && op != op::CHUNK {
                last = self.record(op, body)?;
            }
            Ok(())
        })?;
        if rest > 0 && matches!(last, Taken::Used) {
            last = Taken::Damaged("a chunk ends within a record".to_owned());
        }
        Ok(last)
    }

    fn record(&mut self, op: u8, body: &[u8]) -> Result<Taken, RecordingError> {
        let record = match mcap::parse_record(op, body) {
            Ok(record) => record,
            Err(error) => return Ok(Taken::Damaged(error.to_string())),
        };
        let begun = matches!(
            record,
            Record::Schema { .. } | Record::Channel(_) | Record::Message { .. }
        );
        if begun && !self.ours {
            return Ok(Taken::Foreign);
        }
        match record {
            Record::Chunk { header, data } => return self.chunk(&header, &data),
            Record::Metadata(metadata) if metadata.name == METADATA => {
                self.ours = true;
                self.header.facts = metadata.metadata;
                check_format(self.path, self.header)?;
            }
            Record::Attachment {
                header: named,
                data,
                ..
            } => {
                let text = String::from_utf8_lossy(&data).into_owned();
                self.header.files.insert(named.name.into(), text);
            }
            Record::Channel(channel) => {
                let topic = Topic::ALL
                    .into_iter()
                    .find(|topic| topic.name() == channel.topic);
                self.channels.extend(topic.map(|topic| (channel.id, topic)));
            }
            Record::Message { header, data } => {
                if let Some(&topic) = self.channels.get(&header.channel_id) {
                    (self.visit)(topic, header.publish_time, &data)?;
                }
            }
            _ => {}
        }
        Ok(Taken::Used)
    }
}

impl ControllerCycle {
    /// Returns what the controller got.
    pub fn sample(&self) -> Sample {
        Sample {
            time_s: self.time_s,
            tread_speeds: self.has_tread_speeds.then_some(Stamped {
                time_s: self.tread_speeds_time_s,
                value: MeasuredTreadSpeeds {
                    left_m_s: self.left_m_s,
                    right_m_s: self.right_m_s,
                },
            }),
            attitude: self.has_attitude.then_some(Stamped {
                time_s: self.attitude_time_s,
                value: Attitude {
                    roll_rad: self.roll_rad,
                    pitch_rad: self.pitch_rad,
                },
            }),
            yaw_rate: self.has_yaw_rate.then_some(Stamped {
                time_s: self.yaw_rate_time_s,
                value: self.yaw_rate_rad_s,
            }),
            pose: self.has_pose.then_some(Stamped {
                time_s: self.pose_time_s,
                value: Pose {
                    x_m: self.x_m,
                    y_m: self.y_m,
                    z_m: self.z_m,
                    yaw_rad: self.yaw_rad,
                },
            }),
        }
    }

    /// Returns what it decided, as effective speeds.
    pub fn command(&self) -> MotorSpeeds {
        MotorSpeeds {
            traction_m_s: self.traction_m_s,
            steer_m_s: self.steer_m_s,
        }
    }

    /// Returns which look at the deadline ended a solve.
    pub fn cut_at(&self) -> Option<u32> {
        self.cut.then_some(self.cut_at)
    }
}
