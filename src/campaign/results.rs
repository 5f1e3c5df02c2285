//! The results of a campaign on disk: a CSV file with one row per outcome.
//!
//! While a campaign runs, each row is appended and synced to disk before its thread starts the next run. So a
//! kill can leave at most one incomplete last line, which is cut off when the file is opened again. When all
//! runs are done, the file is replaced by its sorted rows.

use super::merge::{self, Merged};
use super::table::{CampaignTable, RunOutcome};
use crate::config::Campaign;
use crate::output;
use anyhow::{Context, Result, bail};
use sidehill_controller::config::ControllerKind;
use std::collections::HashSet;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

/// The results file, open for appending and locked against a second campaign.
pub struct Results {
    path: PathBuf,
    file: Mutex<File>,
    table: CampaignTable,
    held: HashSet<(u32, String)>,
}

impl Results {
    /// Opens or creates a results file; an incomplete last line is cut off.
    ///
    /// # Errors
    /// Results of another campaign, invalid rows, or an I/O error.
    pub fn open(path: &Path, campaign: &Campaign) -> Result<Self> {
        let name = || path.display().to_string();
        let mut file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(path)
            .with_context(name)?;
        // Two campaigns appending to one file would both run everything.
        file.try_lock()
            .with_context(|| format!("{}: in use by another campaign", name()))?;
        if replaced(&file, path).with_context(name)? {
            bail!("{}: in use by another campaign", name());
        }
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).with_context(name)?;
        let whole = merge::whole_lines(&bytes);
        if whole.len() < bytes.len() {
            file.set_len(whole.len() as u64).with_context(name)?;
        }
        let table = CampaignTable::of(campaign)?;
        if whole.is_empty() {
            file.write_all(&table.header_line()?)
                .and_then(|()| file.sync_data())
                .with_context(name)?;
        }
        let held = table.rows(whole).with_context(name)?;
        let held = held.into_iter().map(|row| (row.index, row.controller));
        Ok(Self {
            path: path.to_owned(),
            file: Mutex::new(file),
            held: held.collect(),
            table,
        })
    }

    /// Returns whether the file had this run when it was opened.
    pub fn holds(&self, index: u32, kind: ControllerKind) -> bool {
        self.held.contains(&(index, kind.name().to_owned()))
    }

    /// Writes an outcome and waits until it is on disk.
    ///
    /// # Errors
    /// An I/O error.
    pub fn append(&self, outcome: &RunOutcome) -> Result<()> {
        self.write(&self.table.line(outcome)?)
    }

    /// Writes the rows of `csv`, results of the same campaign with their header, and waits until they
    /// are on disk. [`Results::finish`] removes duplicates.
    ///
    /// # Errors
    /// Results of another campaign, invalid rows, or an I/O error.
    pub fn append_csv(&self, csv: &[u8]) -> Result<()> {
        self.table.rows(csv)?;
        let header = csv.iter().position(|&byte| byte == b'\n');
        self.write(&csv[header.map_or(csv.len(), |end| end + 1)..])
    }

    fn write(&self, lines: &[u8]) -> Result<()> {
        let name = || self.path.display().to_string();
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(lines)
            .and_then(|()| file.sync_data())
            .with_context(name)
    }

    /// Replaces the file by its rows, sorted and without duplicates, and returns its content. The file is identical
    /// byte for byte however many threads, processes or machines made the rows.
    ///
    /// # Errors
    /// Rows of the same run and controller that differ, or an I/O error; the file is unchanged.
    pub fn finish(self) -> Result<Vec<u8>> {
        let name = || self.path.display().to_string();
        let bytes = std::fs::read(&self.path).with_context(name)?;
        let mut merged = Merged::default();
        merged.add(&bytes).with_context(name)?;
        let sorted = merged.csv()?;
        if sorted != bytes {
            // A symbolic link stays a link.
            let path = self.path.canonicalize().with_context(name)?;
            output::write(&path, &sorted, true)?;
        }
        Ok(sorted)
    }
}

/// Returns whether another file has taken the place of `file` since it was opened.
#[cfg(unix)]
fn replaced(file: &File, path: &Path) -> std::io::Result<bool> {
    use std::os::unix::fs::MetadataExt;
    let (open, named) = (file.metadata()?, std::fs::metadata(path)?);
    Ok((open.dev(), open.ino()) != (named.dev(), named.ino()))
}

/// On other systems an open file cannot be replaced.
#[cfg(not(unix))]
fn replaced(_: &File, _: &Path) -> std::io::Result<bool> {
    Ok(false)
}
