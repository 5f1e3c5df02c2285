//! The files of `run --out`.

use anyhow::{Context, Result};
use serde::Serialize;
use sidehill::output;
use sidehill_bridge::control_loop::record::{
    EventLine, LogEntry, Outputs, Recorder, TakeEntry, TakeEvent,
};
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// The files of `--out`.
pub(super) struct Files {
    candump: BufWriter<File>,
    events: BufWriter<File>,
    cycles: csv::Writer<File>,
}

/// First column of `cycles.csv`.
#[derive(Serialize)]
struct UnixTime {
    unix_s: f64,
}

impl Files {
    /// Creates the folder and the files in it; those of an earlier run are kept beside them.
    ///
    /// # Errors
    /// Names a file that cannot be written.
    pub(super) fn create(folder: &Path) -> Result<Self> {
        let paths = ["candump.log", "events.jsonl", "cycles.csv"].map(|name| folder.join(name));
        let named = |file: &Path| format!("cannot write {}", file.display());
        std::fs::create_dir_all(folder).with_context(|| named(folder))?;
        output::keep_earlier(&paths)?;
        let open = |file: &Path| File::create(file).with_context(|| named(file));
        let [candump, events, cycles] = paths;
        Ok(Self {
            candump: BufWriter::new(open(&candump)?),
            events: BufWriter::new(open(&events)?),
            cycles: csv::Writer::from_writer(open(&cycles)?),
        })
    }

    /// Writes the entries of all threads, and passes each event to `seen` and every entry to `all`.
    ///
    /// # Errors
    /// An I/O error.
    pub(super) fn write(
        &mut self,
        recorder: &mut Recorder,
        seen: &mut TakeEvent<'_>,
        all: &mut TakeEntry<'_>,
    ) -> Result<()> {
        let cycles = &mut self.cycles;
        recorder.drain(&mut Outputs {
            candump: Some(&mut self.candump),
            events: Some(&mut self.events),
            seen: Some(&mut |event: &EventLine<'_>| seen(event)),
            cycles: Some(&mut |unix_s, row| Ok(cycles.serialize((UnixTime { unix_s }, row))?)),
            all: Some(&mut |time_s: f64, entry: &LogEntry| all(time_s, entry)),
        })?;
        // Flush, so that little is lost if the program is killed.
        self.candump.flush()?;
        self.events.flush()?;
        self.cycles.flush()?;
        Ok(())
    }
}
