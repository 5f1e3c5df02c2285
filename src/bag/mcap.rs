//! MCAP files, read from the start, so that files without an end can be read; the specification is at mcap.dev/spec.
//!
//! `mcap` parses the records. Its readers skip a chunk whose length is missing because the recorder was killed,
//! so this module finds the records itself.

use super::compression;
use super::error::BagError;
use super::limits::{Budget, RECORD_MAX};
use super::message::{Message, Outcome, Topic, Visit};
use ::mcap::records::{ChunkHeader, Record, op};
use ::mcap::{MAGIC, parse_record};
use crc::{CRC_32_ISO_HDLC, Crc};
use std::collections::BTreeMap;
use std::io::{self, Read};
use std::path::Path;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// Calls `visit` for each message of `source`, in the order of the file.
pub(super) fn read(
    mut source: impl Read,
    name: &Path,
    budget: &mut Budget,
    visit: Visit<'_>,
) -> Result<Outcome, BagError> {
    let unreadable = |reason: io::Error| BagError::Read {
        file: name.to_owned(),
        reason,
    };
    let mut magic = Vec::new();
    let mut start = (&mut source).take(MAGIC.len() as u64);
    start.read_to_end(&mut magic).map_err(unreadable)?;
    if magic != MAGIC {
        return Err(BagError::Content {
            file: name.to_owned(),
            reason: "not an MCAP file: it does not begin as one".to_owned(),
        });
    }
    let mut reader = Reader {
        name,
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        budget,
        visit,
    };
    let cut_off = loop {
        match next_record(&mut source).map_err(unreadable)? {
            Framed::End => break Some("it has no end".to_owned()),
            Framed::CutOff {
                op: op::CHUNK,
                body,
            } => {
                reader.interrupted_chunk(&body)?;
                break Some("its last chunk was not finished".to_owned());
            }
            Framed::CutOff { .. } => break Some("its last record was not finished".to_owned()),
            // What follows repeats the index only.
            Framed::Whole {
                op: op::DATA_END | op::FOOTER,
                ..
            } => break None,
            Framed::Whole {
                op: op::CHUNK,
                body,
            } => reader.chunk(&body)?,
            Framed::Whole { op, body } => reader.record(op, &body)?,
        }
    };
    Ok(Outcome {
        topics: reader.channels.into_values().collect(),
        cut_off,
    })
}

/// A record of the file, possibly cut off.
enum Framed {
    Whole { op: u8, body: Vec<u8> },
    CutOff { op: u8, body: Vec<u8> },
    End,
}

fn next_record(source: &mut impl Read) -> io::Result<Framed> {
    let mut header = Vec::new();
    source.take(9).read_to_end(&mut header)?;
    let Some((op, length)) = header.split_first() else {
        return Ok(Framed::End);
    };
    let op = *op;
    let mut body = Vec::new();
    let Ok(length) = length.try_into().map(u64::from_le_bytes) else {
        return Ok(Framed::CutOff { op, body });
    };
    source.take(length.min(RECORD_MAX)).read_to_end(&mut body)?;
    Ok(if body.len() as u64 == length {
        Framed::Whole { op, body }
    } else {
        Framed::CutOff { op, body }
    })
}

/// State while a file's records are read.
struct Reader<'a> {
    name: &'a Path,
    /// Names of the message types.
    schemas: BTreeMap<u16, String>,
    channels: BTreeMap<u16, Topic>,
    budget: &'a mut Budget,
    visit: Visit<'a>,
}

impl Reader<'_> {
    fn damaged(&self, reason: impl std::fmt::Display) -> BagError {
        BagError::Content {
            file: self.name.to_owned(),
            reason: format!("damaged: {reason}"),
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
        if header.uncompressed_crc != 0 && CRC.checksum(&records) != header.uncompressed_crc {
            return Err(self.damaged("a chunk has another checksum than was recorded"));
        }
        let rest = self.records(&records)?;
        match rest {
            0 => Ok(()),
            _ => Err(self.damaged("a chunk ends within a record")),
        }
    }

    /// Reads the whole records of a chunk that ends with the file. Its length and sizes may never have been
    /// written, so nothing of its header but the compression is relied on.
    fn interrupted_chunk(&mut self, body: &[u8]) -> Result<(), BagError> {
        const BEFORE_COMPRESSION: usize = 8 + 8 + 8 + 4;
        let tail = body.get(BEFORE_COMPRESSION..).unwrap_or_default();
        let Some((length, tail)) = tail.split_first_chunk() else {
            return Ok(());
        };
        let length = u32::from_le_bytes(*length) as usize;
        let compression = tail.get(..length).unwrap_or_default();
        let Some(data) = length.checked_add(8).and_then(|from| tail.get(from..)) else {
            return Ok(());
        };
        let header = ChunkHeader {
            message_start_time: 0,
            message_end_time: 0,
            uncompressed_size: 0,
            uncompressed_crc: 0,
            compression: String::from_utf8_lossy(compression).into_owned(),
            compressed_size: 0,
        };
        let (records, _) = decompressed(&header, data, self.budget);
        self.records(&records).map(drop)
    }

    /// Reads records up to the first that is not whole, and returns how many bytes remain.
    fn records(&mut self, mut bytes: &[u8]) -> Result<usize, BagError> {
        while let Some((header, rest)) = bytes.split_first_chunk::<9>() {
            let [op, length @ ..] = *header;
            let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
            let Some(body) = rest.get(..length) else {
                break;
            };
            self.record(op, body)?;
            bytes = &rest[length..];
        }
        Ok(bytes.len())
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
                let topic = Topic {
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
                (self.visit)(Message {
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
