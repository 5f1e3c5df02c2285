//! Decompression of chunks, messages and files.

use std::io::{self, Read};

/// Largest decompressed size, bytes. Anything larger counts as damage.
const SIZE_MAX: u64 = 4 << 30;

/// Returns the decompressed bytes and, if they are incomplete, the reason.
pub(super) fn zstd(compressed: &[u8]) -> (Vec<u8>, Option<String>) {
    let mut rest = compressed;
    let mut out = Vec::new();
    // A stream may hold several frames.
    while !rest.is_empty() {
        let decoder = ruzstd::decoding::StreamingDecoder::new(&mut rest);
        let result = match decoder {
            Ok(mut decoder) => read_all(&mut decoder, &mut out),
            Err(error) => Err(io::Error::other(error.to_string())),
        };
        if let Err(error) = result {
            return (out, Some(format!("zstd: {error}")));
        }
    }
    (out, None)
}

/// Returns the decompressed bytes of an LZ4 frame and, if they are incomplete, the reason.
pub(super) fn lz4(compressed: &[u8]) -> (Vec<u8>, Option<String>) {
    let mut out = Vec::new();
    let result = read_all(
        &mut lz4_flex::frame::FrameDecoder::new(compressed),
        &mut out,
    );
    (out, result.err().map(|error| format!("lz4: {error}")))
}

fn read_all(source: &mut dyn Read, out: &mut Vec<u8>) -> io::Result<()> {
    let left = SIZE_MAX.saturating_sub(out.len() as u64);
    // Keep what was read before the error.
    let read = source.take(left).read_to_end(out)?;
    if read as u64 == left {
        return Err(io::Error::other("larger than 4 GiB"));
    }
    Ok(())
}
