//! What a file is by its first bytes, and how much of a text log is read.

use crate::config::no_text;
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

/// Returns what a file is that is no log, and how to come by one.
///
/// # Errors
/// The file cannot be read.
pub(crate) fn foreign(path: &Path) -> io::Result<Option<String>> {
    const LFS: &[u8] = b"version https://git-lfs.github.com/spec/";
    const ROS1: &[u8] = b"#ROSBAG V";
    let mut begin = Vec::new();
    File::open(path)?
        .take(LFS.len() as u64)
        .read_to_end(&mut begin)?;
    Ok(if begin.starts_with(LFS) {
        Some(
            "is a pointer of Git LFS, not the file itself: `git lfs pull` in its repository fetches the file"
                .to_owned(),
        )
    } else if begin.starts_with(ROS1) {
        Some(
            "is a bag of ROS 1; `rosbags-convert --src FILE.bag --dst FOLDER` of the Python package rosbags makes a \
             bag of ROS 2 of it"
                .to_owned(),
        )
    } else {
        None
    })
}

/// Opens a text log, of which no more is read than `--max-bytes` allows.
///
/// # Errors
/// Names the file and what it is instead.
pub(super) fn open(path: &Path, max_bytes: Option<u64>) -> Result<impl Read> {
    let name = || path.display().to_string();
    if path.is_file()
        && let Some(reason) = foreign(path).with_context(name)?
    {
        bail!("{}: {reason}", name());
    }
    let mut source = BufReader::new(File::open(path).with_context(name)?);
    if let Some(reason) = no_text(source.fill_buf().with_context(name)?) {
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
