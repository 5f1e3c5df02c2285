//! The records of an MCAP file, found one after the other from its start, so that files without an end can be read; the
//! specification is at mcap.dev/spec.
//!
//! `mcap` parses the records. Its readers skip a chunk whose length is missing because the recorder was killed, and
//! count wrongly where a record is longer than its chunk.

use crc::{CRC_32_ISO_HDLC, Crc};
use mcap::MAGIC;
use mcap::records::{ChunkHeader, op};
use std::io::{self, Read};

/// Largest record, bytes; chunks of rosbag2 and of this program have a few MB.
pub const RECORD_MAX: u64 = 128 << 20;

const CRC: Crc<u32> = Crc::<u32>::new(&CRC_32_ISO_HDLC);

/// What stands at a place of a file.
#[derive(Debug)]
pub enum Framed {
    /// A record.
    Whole {
        /// Its kind.
        op: u8,
        /// Its content.
        body: Vec<u8>,
    },
    /// A chunk that ends with the file: what is there of its content. Its length and sizes may never have been written.
    CutOffChunk(Vec<u8>),
    /// Nothing more, although the data have no end; the reason.
    CutOff(&'static str),
    /// The end of the data. What follows repeats the index only.
    End,
}

/// Reads the records of a file.
#[derive(Debug)]
pub struct Records<R>(R);

impl<R: Read> Records<R> {
    /// Returns the records of a source; nothing where it does not begin as an MCAP file.
    ///
    /// # Errors
    /// The source's.
    pub fn begin(mut source: R) -> io::Result<Option<Self>> {
        let mut magic = Vec::new();
        let mut start = (&mut source).take(MAGIC.len() as u64);
        start.read_to_end(&mut magic)?;
        Ok((magic == MAGIC).then_some(Self(source)))
    }

    /// Returns the next record.
    ///
    /// # Errors
    /// The source's.
    pub fn next_record(&mut self) -> io::Result<Framed> {
        const LAST: &str = "its last record was not finished";
        let mut header = Vec::new();
        (&mut self.0).take(9).read_to_end(&mut header)?;
        let Some((op, length)) = header.split_first() else {
            return Ok(Framed::CutOff("it has no end"));
        };
        let op = *op;
        match op {
            // A power cut leaves zeros where the disk had given room, and no record begins with one.
            0 => return Ok(Framed::CutOff("its rest is empty")),
            op::DATA_END | op::FOOTER => return Ok(Framed::End),
            _ => {}
        }
        let Ok(length) = length.try_into().map(u64::from_le_bytes) else {
            return Ok(Framed::CutOff(LAST));
        };
        let mut body = Vec::new();
        (&mut self.0)
            .take(length.min(RECORD_MAX))
            .read_to_end(&mut body)?;
        Ok(if body.len() as u64 == length {
            Framed::Whole { op, body }
        } else if op == op::CHUNK {
            Framed::CutOffChunk(body)
        } else {
            Framed::CutOff(LAST)
        })
    }
}

/// Calls `take` with kind and content of each record in a chunk up to the first that is not whole, and returns how many
/// bytes remain.
///
/// # Errors
/// That of `take`.
pub fn in_chunk<E>(
    mut records: &[u8],
    mut take: impl FnMut(u8, &[u8]) -> Result<(), E>,
) -> Result<usize, E> {
    while let Some((header, rest)) = records.split_first_chunk::<9>() {
        let [op, length @ ..] = *header;
        let length = usize::try_from(u64::from_le_bytes(length)).unwrap_or(usize::MAX);
        let Some(body) = rest.get(..length) else {
            break;
        };
        take(op, body)?;
        records = &rest[length..];
    }
    Ok(records.len())
}

/// Returns why the decompressed records of a chunk are not those that were recorded, if its checksum says so; 0 says nothing.
pub fn changed(header: &ChunkHeader, records: &[u8]) -> Option<&'static str> {
    let sound = header.uncompressed_crc == 0 || CRC.checksum(records) == header.uncompressed_crc;
    (!sound).then_some("a chunk has another checksum than was recorded")
}

/// Returns compression and compressed records of a chunk that ends with the file; of its header only the compression
/// is known. Nothing where not even that was written.
pub fn cut_off_chunk(body: &[u8]) -> Option<(ChunkHeader, &[u8])> {
    const BEFORE_COMPRESSION: usize = 8 + 8 + 8 + 4;
    let tail = body.get(BEFORE_COMPRESSION..)?;
    let (length, tail) = tail.split_first_chunk()?;
    let length = u32::from_le_bytes(*length) as usize;
    let compression = tail.get(..length)?;
    let data = tail.get(length.checked_add(8)?..)?;
    let header = ChunkHeader {
        message_start_time: 0,
        message_end_time: 0,
        uncompressed_size: 0,
        uncompressed_crc: 0,
        compression: String::from_utf8_lossy(compression).into_owned(),
        compressed_size: 0,
    };
    Some((header, data))
}
