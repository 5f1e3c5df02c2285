//! Text on standard output and standard error.
//!
//! Whoever reads it may go at any time (`| head -1`, a log collector that dies, a terminal that is
//! closed). Text that cannot be written is dropped and counted; the program goes on.

use std::fmt::Display;
use std::io::Write;
use std::sync::atomic::{AtomicU64, Ordering};

static DROPPED: AtomicU64 = AtomicU64::new(0);

/// Prints `text` as it is.
pub fn text(text: impl Display) {
    count(write!(std::io::stdout().lock(), "{text}"));
}

/// Prints `text` and a line's end.
pub fn line(text: impl Display) {
    count(writeln!(std::io::stdout().lock(), "{text}"));
}

/// Prints `text` and a line's end to standard error.
pub fn complain(text: impl Display) {
    count(writeln!(std::io::stderr().lock(), "{text}"));
}

/// Returns how many texts could not be written.
pub fn dropped() -> u64 {
    DROPPED.load(Ordering::Relaxed)
}

fn count(written: std::io::Result<()>) {
    if written.is_err() {
        DROPPED.fetch_add(1, Ordering::Relaxed);
    }
}
