//! Bags in MCAP.

use super::compression;
use super::error::BagError;
use super::limits::Budget;
use super::message::{BagTopic, FileFindings, RecordedMessage, Visit};
use ::mcap::parse_record;
use ::mcap::records::{ChunkHeader, Record, op};
use sidehill_recording::framing::{Framed, Records, changed, cut_off_chunk, in_chunk};
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::Path;

/// Calls `visit` for each message of `source`, in the order of the file.
pub(super) fn read(
    source: impl Read,
    name: &Path,
    budget: &mut Budget,
    visit: Visit<'_>,
) -> Result<FileFindings, BagError> {
    let unreadable = |reason: io::Error| BagError::Read {
        file: name.to_owned(),
        reason,
    };
    let Some(mut records) = Records::begin(source).map_err(unreadable)? else {
        return Err(BagError::Content {
            file: name.to_owned(),
            reason: "not an MCAP file: it does not begin as one".to_owned(),
        });
    };
    let mut reader = McapState {
        name,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        budget,
        visit,
    };
    let cut_off = loop {
        match records.next_record().map_err(unreadable)? {
            Framed::End => break None,
            Framed::CutOff(reason) => break Some(reason.to_owned()),
            Framed::CutOffChunk(body) => {
                reader.interrupted_chunk(&body)?;
                break Some("its last chunk was not finished".to_owned());
            }
            Framed::Whole {
                op: op::CHUNK,
                body,
            } => reader.chunk(&body)?,
            Framed::Whole { op, body } => reader.record(op, &body)?,
        }
    };
    Ok(FileFindings {
        topics: reader.channels.into_values().collect(),
        cut_off,
    })
}

/// State while a file's records are read.
struct McapState<'a> {
    name: &'a Path,
    /// Names of the message types.
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, BagTopic>,
    budget: &'a mut Budget,
    visit: Visit<'a>,
}

impl McapState<'_> {
    fn damaged(&self, reason: impl std::fmt::Display) -> BagError {
        BagError::Content {
            file: self.name.to_owned(),
            reason: format!(
                "damaged: {reason}; `mcap recover FILE --output MENDED` writes what can still be read"
            ),
        }
    }

    fn chunk(&mut self, body: &[u8]) -> Result<(), BagError> {
        let record = parse_record(op::CHUNK, body).map_err(|error| self.damaged(error))?;
        let Record::Chunk { header, data } = record else {
            return Ok(());
        };
        let (records, fault) = decompressed(&header, &data, self.budget);
        if let Some(fault) = fault {
            return Err(self.damaged(format_args!("a chunk: {fault}")));
        }
        if let Some(reason) = changed(&header, &records) {
            return Err(self.damaged(reason));
        }
        match in_chunk(&records, |op, body| self.record(op, body))? {
            0 => Ok(()),
            _ => Err(self.damaged("a chunk ends within a record")),
        }
    }

    /// Reads the whole records of a chunk that ends with the file.
    fn interrupted_chunk(&mut self, body: &[u8]) -> Result<(), BagError> {
        let Some((header, data)) = cut_off_chunk(body) else {
            return Ok(());
        };
        let (records, _) = decompressed(&header, data, self.budget);
        in_chunk(&records, |op, body| self.record(op, body)).map(drop)
    }

    fn record(&mut self, op: u8, body: &[u8]) -> Result<(), BagError> {
        match op {
            op::SCHEMA | op::CHANNEL | op::MESSAGE => {}
            _ => return Ok(()),
        }
        match parse_record(op, body).map_err(|error| self.damaged(error))? {
            Record::Schema { header, .. } => {
                self.schemas.insert(header.id, header.name);
            }
            Record::Channel(channel) => {
                let message_type = self.schemas.get(&channel.schema_id).cloned();
                let topic = BagTopic {
                    name: channel.topic,
                    message_type: message_type.unwrap_or_default(),
                    encoding: channel.message_encoding,
                };
                self.channels.insert(channel.id, topic);
            }
            Record::Message { header, data } => {
                let id = header.channel_id;
                let Some(topic) = self.channels.get(&id) else {
                    return Err(self.damaged(format_args!(
                        "a message is of channel {id}, which is unknown"
                    )));
                };
                (self.visit)(RecordedMessage {
                    topic,
                    received_ns: i64::try_from(header.log_time).unwrap_or(i64::MAX),
                    data: &data,
                })?;
            }
            _ => {}
        }
        Ok(())
    }
}

/// Returns the records of a chunk and, if they are incomplete, the reason.
fn decompressed<'a>(
    header: &ChunkHeader,
    data: &'a [u8],
    budget: &mut Budget,
) -> (std::borrow::Cow<'a, [u8]>, Option<String>) {
    let (bytes, fault) = match header.compression.as_str() {
        "" => return (data.into(), None),
        "zstd" => compression::zstd(data, budget),
        "lz4" => compression::lz4(data, budget),
        other => {
            let fault = format!("the compression {other:?} is not read, only lz4 and zstd");
            return (Vec::new().into(), Some(fault));
        }
    };
    (bytes.into(), fault)
}
