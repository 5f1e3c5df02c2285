//! Decompression of chunks, messages and files.

use super::limits::Budget;
use std::io::{self, Read, Write};

/// The first bytes of a frame of zstd. No message that is read begins so: those of ROS 2 begin with 0.
pub(super) const ZSTD: &[u8] = &[0x28, 0xB5, 0x2F, 0xFD];

/// Returns the decompressed bytes and, if they are incomplete, the reason.
pub(super) fn zstd(compressed: &[u8], budget: &mut Budget) -> (Vec<u8>, Option<String>) {
    let mut out = Vec::new();
    let (mut left, reason) = budget.record_max();
    let result = frames(compressed, |frame| {
        copy(frame, &mut out, &mut left, &reason)
    });
    let spent = budget.take(out.len() as u64);
    (out, result.err().or(spent.err()))
}

/// Returns the decompressed bytes of an LZ4 frame and, if they are incomplete, the reason.
pub(super) fn lz4(compressed: &[u8], budget: &mut Budget) -> (Vec<u8>, Option<String>) {
    let mut out = Vec::new();
    let (mut left, reason) = budget.record_max();
    let mut decoder = lz4_flex::frame::FrameDecoder::new(compressed);
    let result =
        copy(&mut decoder, &mut out, &mut left, &reason).map_err(|error| format!("lz4: {error}"));
    let spent = budget.take(out.len() as u64);
    (out, result.err().or(spent.err()))
}

/// Decompresses a whole file.
///
/// # Errors
/// Why it cannot be decompressed or written.
pub(super) fn zstd_file(
    compressed: impl Read,
    to: &mut impl Write,
    budget: &Budget,
) -> Result<(), String> {
    let (mut left, reason) = (budget.left(), budget.exceeded());
    frames(compressed, |frame| copy(frame, to, &mut left, &reason))
}

/// Calls `take` for each frame of a stream, which may hold several.
fn frames(
    compressed: impl Read,
    mut take: impl FnMut(&mut dyn Read) -> io::Result<()>,
) -> Result<(), String> {
    let failed = |error: &dyn std::fmt::Display| format!("zstd: {error}");
    let mut source = io::BufReader::new(compressed);
    while !io::BufRead::fill_buf(&mut source)
        .map_err(|error| failed(&error))?
        .is_empty()
    {
        let mut decoder =
            ruzstd::decoding::StreamingDecoder::new(&mut source).map_err(|error| failed(&error))?;
        take(&mut decoder).map_err(|error| failed(&error))?;
    }
    Ok(())
}

/// Copies a stream of at most `left` bytes, which become fewer; what was read before an error is kept.
fn copy(
    source: &mut dyn Read,
    out: &mut dyn Write,
    left: &mut u64,
    reason: &str,
) -> io::Result<()> {
    let copied = io::copy(&mut source.take(left.saturating_add(1)), out)?;
    *left = left
        .checked_sub(copied)
        .ok_or_else(|| io::Error::other(reason.to_owned()))?;
    Ok(())
}
