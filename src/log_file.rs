//! How much of a text log is read.

use crate::foreign::foreign;
use anyhow::{Context, Result, bail};
use std::fmt;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read};
use std::path::Path;

/// What a text log may hold without --max-bytes, bytes: its rows are kept in memory.
const TEXT_MAX: u64 = 1_000_000_000;

/// A number of bytes as text.
pub(crate) struct Size(pub(crate) u64);

impl fmt::Display for Size {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            bytes @ 0..1_000_000 => write!(f, "{} kB", bytes.div_ceil(1000)),
            bytes => write!(f, "{} MB", bytes / 1_000_000),
        }
    }
}

/// Opens a text log, of which no more is read than `--max-bytes` allows.
///
/// # Errors
/// Names the file and what it is instead.
pub(crate) fn open(path: &Path, max_bytes: Option<u64>) -> Result<impl Read> {
    let name = || path.display().to_string();
    let mut source = BufReader::new(File::open(path).with_context(name)?);
    if let Some(reason) = foreign(source.fill_buf().with_context(name)?) {
        bail!("{}: {reason}", name());
    }
    Ok(Limited {
        source,
        left: max_bytes.unwrap_or(TEXT_MAX),
        whole: max_bytes.unwrap_or(TEXT_MAX),
    })
}

/// A source that fails behind its limit.
struct Limited<R> {
    source: R,
    left: u64,
    whole: u64,
}

impl<R: Read> Read for Limited<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let read = self.source.read(buffer)?;
        match self.left.checked_sub(read as u64) {
            Some(left) => {
                self.left = left;
                Ok(read)
            }
            None => Err(io::Error::other(format!(
                "it is larger than {}; --max-bytes allows more",
                Size(self.whole)
            ))),
        }
    }
}
