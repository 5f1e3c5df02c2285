//! A recording over the live view, at the pace at which it was recorded.

use anyhow::{Context, Result};
use sidehill_bridge::recording::live::LiveView;
use sidehill_bridge::recording::{MessageSink, Recording, scan};
use std::time::{Duration, Instant};

/// Longest pause between two messages that is kept, so that a gap in a recording is no wait.
const PAUSE_MAX_NS: u64 = 2_000_000_000;

/// Plays the files of a recording to whoever looks.
///
/// # Errors
/// A file that can no longer be read.
pub(super) fn play(recording: &Recording, live: &mut LiveView) -> Result<()> {
    let begin = Instant::now();
    let (mut before_ns, mut played_ns) = (None, 0);
    for file in &recording.files {
        scan(file, &mut |topic, time_ns, message| {
            let pause_ns = time_ns.saturating_sub(before_ns.unwrap_or(time_ns));
            before_ns = Some(time_ns.max(before_ns.unwrap_or(0)));
            played_ns += pause_ns.min(PAUSE_MAX_NS);
            let due = begin + Duration::from_nanos(played_ns);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
            live.put(topic, time_ns, message);
            Ok(())
        })
        .with_context(|| format!("{}: cannot be played", file.display()))?;
    }
    Ok(())
}
