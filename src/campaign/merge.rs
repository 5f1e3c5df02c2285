//! Merges the results of parts of a campaign into the file that one machine would have written.

use super::table::{AFTER, BEFORE, GUARD, line, other_origin};
use crate::{console, output};
use anyhow::{Context, Result, bail};
use csv::StringRecord;
use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::io::Write;
use std::path::Path;

/// Rows of one campaign, each once, in the order of runs and then of the controllers' names.
#[derive(Default)]
pub struct Merged {
    header: Option<StringRecord>,
    fingerprint: String,
    rows: BTreeMap<(u32, String), StringRecord>,
}

impl Merged {
    /// Adds the rows of a file's text, which consists of complete lines. Duplicate rows are dropped.
    ///
    /// # Errors
    /// Names the line that is no result, belongs to another campaign, or differs from the row of the
    /// same run and controller.
    pub fn add(&mut self, text: &[u8]) -> Result<()> {
        let mut reader = csv::Reader::from_reader(text);
        let header = reader.headers()?.clone();
        let names: Vec<&str> = header.iter().collect();
        let own = names.strip_suffix(&GUARD).unwrap_or(&names);
        if !(own.starts_with(&BEFORE) && own.ends_with(&AFTER)) {
            bail!("line 1: these are not the columns of a campaign's results");
        }
        match &self.header {
            None => self.header = Some(header),
            Some(first) if *first != header => {
                bail!("line 1: its columns are others than those of the files before");
            }
            Some(_) => {}
        }
        for record in reader.records() {
            let record = record?;
            let at = record.position().map_or(0, csv::Position::line);
            self.insert(record).with_context(|| format!("line {at}"))?;
        }
        Ok(())
    }

    fn insert(&mut self, record: StringRecord) -> Result<()> {
        let (fingerprint, controller) = (&record[0], &record[3]);
        let index: u32 = record[1]
            .parse()
            .with_context(|| format!("index: `{}` is not the number of a run", &record[1]))?;
        if self.rows.is_empty() {
            fingerprint.clone_into(&mut self.fingerprint);
        } else if fingerprint != self.fingerprint {
            bail!(other_origin(fingerprint, &self.fingerprint));
        }
        match self.rows.entry((index, controller.to_owned())) {
            Entry::Vacant(entry) => {
                entry.insert(record);
            }
            Entry::Occupied(entry) if *entry.get() == record => {}
            Entry::Occupied(entry) => {
                let header = self.header.iter().flat_map(StringRecord::iter);
                let both = entry.get().iter().zip(&record);
                let (name, (held, new)) = header
                    .zip(both)
                    .find(|(_, (held, new))| held != new)
                    .unwrap_or_default();
                bail!(
                    "run {index} of {controller} is there with another {name}: {held}, here {new}"
                );
            }
        }
        Ok(())
    }

    /// Returns the file with all rows; empty if there are none.
    ///
    /// # Errors
    /// None that can happen; those of the CSV writer.
    pub fn csv(&self) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        for record in self.header.iter().chain(self.rows.values()) {
            out.extend(line(record.iter())?);
        }
        Ok(out)
    }
}

/// Merges result files into `out`, together with its own rows if it exists, or to standard output without `out`.
/// An incomplete last line of a killed campaign is left out with a warning.
///
/// # Errors
/// Names the file and line that do not belong to the others; `out` is unchanged.
pub fn run(files: &[impl AsRef<Path>], out: Option<&Path>) -> Result<()> {
    let mut merged = Merged::default();
    let held = out.filter(|out| out.exists());
    for path in held.into_iter().chain(files.iter().map(AsRef::as_ref)) {
        let name = || path.display().to_string();
        let bytes = std::fs::read(path).with_context(name)?;
        let whole = whole_lines(&bytes);
        if whole.len() < bytes.len() {
            console::complain(format_args!(
                "{}: the last line is torn and left out",
                name()
            ));
        }
        // A campaign killed before its first line was on the disk.
        if !whole.is_empty() {
            merged.add(whole).with_context(name)?;
        }
    }
    let csv = merged.csv()?;
    match out {
        Some(out) => output::write(out, &csv, true),
        None => Ok(std::io::stdout().write_all(&csv)?),
    }
}

/// Returns the complete lines.
pub fn whole_lines(bytes: &[u8]) -> &[u8] {
    let end = bytes.iter().rposition(|&byte| byte == b'\n');
    &bytes[..end.map_or(0, |last| last + 1)]
}
