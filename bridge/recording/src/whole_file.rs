//! Files of MCAP that are complete at every moment.
//!
//! After each flush the file ends as a finished one without a summary does; the next flush overwrites that
//! end. A program that is killed thus leaves a file that any reader opens.

use std::fs::File;
use std::io::{Error, ErrorKind, Seek, SeekFrom, Write};

/// Bytes that wait for the disk at most.
pub(super) const PENDING_MAX: usize = 1 << 20;
/// The end of a file without a summary: data end, footer, magic.
const END: [u8; 50] = end();

const fn end() -> [u8; 50] {
    const MAGIC: [u8; 8] = [0x89, b'M', b'C', b'A', b'P', b'0', b'\r', b'\n'];
    let mut end = [0; 50];
    // Data end: its checksum is 0 for none.
    end[0] = 0x0F;
    end[1] = 4;
    // Footer: no summary, no offsets, no checksum.
    end[13] = 0x02;
    end[14] = 20;
    let mut i = 0;
    while i < MAGIC.len() {
        end[42 + i] = MAGIC[i];
        i += 1;
    }
    end
}

/// A file that is written at each flush, in one piece with a new end.
pub(super) struct WholeFile {
    file: File,
    /// Bytes of the file that stay.
    kept: u64,
    pending: Vec<u8>,
    /// Where the next byte goes, in `pending`.
    at: usize,
}

impl WholeFile {
    pub(super) fn new(file: File) -> Self {
        Self {
            file,
            kept: 0,
            pending: Vec::with_capacity(2 * PENDING_MAX),
            at: 0,
        }
    }

    /// Writes what is pending, the end of the file included, and returns its size.
    pub(super) fn finish(mut self) -> Result<u64, Error> {
        write_at(&self.file, &self.pending, self.kept)?;
        self.kept += self.pending.len() as u64;
        self.file.set_len(self.kept)?;
        Ok(self.kept)
    }
}

fn write_at(mut file: &File, bytes: &[u8], at: u64) -> Result<(), Error> {
    file.seek(SeekFrom::Start(at))?;
    file.write_all(bytes)
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let within = bytes.len().min(self.pending.len() - self.at);
        self.pending[self.at..self.at + within].copy_from_slice(&bytes[..within]);
        self.pending.extend_from_slice(&bytes[within..]);
        self.at += bytes.len();
        Ok(bytes.len())
    }

    fn flush(&mut self) -> Result<(), Error> {
        let length = self.pending.len();
        self.pending.extend_from_slice(&END);
        if let Err(error) = write_at(&self.file, &self.pending, self.kept) {
            // The file stays as whole as it was.
            let end = self.kept + END.len() as u64;
            let _ = write_at(&self.file, &END, self.kept);
            let _ = self.file.set_len(end);
            return Err(error);
        }
        self.kept += length as u64;
        self.pending.clear();
        self.at = 0;
        Ok(())
    }
}

impl Seek for WholeFile {
    fn seek(&mut self, to: SeekFrom) -> Result<u64, Error> {
        let position = match to {
            SeekFrom::Start(position) => Some(position),
            SeekFrom::Current(by) => (self.kept + self.at as u64).checked_add_signed(by),
            SeekFrom::End(by) => (self.kept + self.pending.len() as u64).checked_add_signed(by),
        };
        let at = position
            .and_then(|position| position.checked_sub(self.kept))
            .and_then(|at| usize::try_from(at).ok())
            .filter(|at| *at <= self.pending.len())
            .ok_or_else(|| {
                Error::new(ErrorKind::InvalidInput, "that part of the file is written")
            })?;
        self.at = at;
        Ok(self.kept + at as u64)
    }
}
