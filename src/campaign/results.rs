//! The results of a campaign on the disk: append-only CSV, a row an outcome.
//!
//! A row is one write, followed to the disk before the next run of its thread begins. So a kill can
//! only leave a torn last line, which has no line's end and is cut off when the file is opened again.

use crate::config::Campaign;
use crate::record::Summary;
use anyhow::{Context, Result, bail};
use serde_yaml::Value;
use sidehill_controller::config::ControllerKind;
use std::collections::HashSet;
use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// What became of one run with one controller.
pub struct Outcome {
    /// Number of the run.
    pub index: u32,
    /// Its seed.
    pub seed: u64,
    /// Who drove.
    pub kind: ControllerKind,
    /// What was drawn, in the order of the campaign's keys; empty where drawing failed.
    pub values: Vec<Value>,
    /// The figures, or why there are none.
    pub figures: Result<Summary, String>,
}

/// What the summary needs of a row.
#[derive(Debug, Clone, PartialEq)]
pub struct Row {
    /// Number of the run.
    pub index: u32,
    /// Controller's name.
    pub controller: String,
    /// Whether it came to the end.
    pub completed: bool,
    /// Cross-track RMS, m, where the run started.
    pub cross_track_rms_m: Option<f64>,
    /// Steer total variation, m/s.
    pub steer_total_variation_m_s: Option<f64>,
}

/// Columns before what is drawn.
const BEFORE: [&str; 4] = ["campaign", "index", "seed", "controller"];
/// Columns after it.
const AFTER: [&str; 11] = [
    "completed",
    "ended_by",
    "cross_track_rms_m",
    "cross_track_p95_m",
    "cross_track_max_m",
    "along_track_rms_m",
    "heading_rms_rad",
    "steer_total_variation_m_s",
    "goal_error_m",
    "constraint_violations",
    "fallbacks",
];

/// The file of results, open for more.
pub struct Results {
    file: Mutex<File>,
    fingerprint: String,
    columns: usize,
    held: HashSet<(u32, String)>,
}

impl Results {
    /// Opens a file of results or begins one; a torn last line is cut off.
    ///
    /// # Errors
    /// Results of another campaign, rows that make no sense, or what the disk says.
    pub fn open(path: &Path, campaign: &Campaign) -> Result<Self> {
        let name = || path.display().to_string();
        let mut file = OpenOptions::new()
            .read(true)
            .append(true)
            .create(true)
            .open(path)
            .with_context(name)?;
        // Two campaigns that append to one file would both run everything.
        file.try_lock()
            .with_context(|| format!("{}: in use by another campaign", name()))?;
        let mut bytes = Vec::new();
        file.read_to_end(&mut bytes).with_context(name)?;
        let whole = bytes.iter().rposition(|&b| b == b'\n').map_or(0, |i| i + 1);
        if whole < bytes.len() {
            file.set_len(whole as u64).with_context(name)?;
        }
        let fingerprint = campaign.fingerprint()?;
        if whole == 0 {
            let header = header(campaign);
            file.write_all(&line(header.iter().map(String::as_str))?)
                .and_then(|()| file.sync_data())
                .with_context(name)?;
        }
        let held = rows(&bytes[..whole], campaign, &fingerprint)
            .with_context(name)?
            .into_iter()
            .map(|row| (row.index, row.controller))
            .collect();
        Ok(Self {
            file: Mutex::new(file),
            columns: campaign.keys().count(),
            fingerprint,
            held,
        })
    }

    /// Returns whether the file had this run when it was opened.
    pub fn holds(&self, index: u32, kind: ControllerKind) -> bool {
        self.held.contains(&(index, kind.name().to_owned()))
    }

    /// Writes an outcome and waits until it is on the disk.
    ///
    /// # Errors
    /// What the disk says.
    pub fn append(&self, outcome: &Outcome) -> Result<()> {
        let mut fields = vec![
            self.fingerprint.clone(),
            outcome.index.to_string(),
            outcome.seed.to_string(),
            outcome.kind.name().to_owned(),
        ];
        for column in 0..self.columns {
            fields.push(match outcome.values.get(column) {
                None => String::new(),
                Some(Value::Number(number)) => number.to_string(),
                Some(value) => serde_json::to_string(value)?,
            });
        }
        // A line's end within a field would look like a row's.
        let plain = |reason: &str| reason.replace(['\n', '\r'], " ");
        match &outcome.figures {
            Ok(s) => fields.extend([
                s.completed.to_string(),
                plain(s.ended_by.as_deref().unwrap_or("")),
                s.cross_track_rms_m.to_string(),
                s.cross_track_p95_m.to_string(),
                s.cross_track_max_m.to_string(),
                s.along_track_rms_m.to_string(),
                s.heading_rms_rad.to_string(),
                s.steer_total_variation_m_s.to_string(),
                s.goal_error_m.to_string(),
                s.constraint_violations.to_string(),
                s.fallbacks.to_string(),
            ]),
            Err(reason) => {
                fields.extend(["false".to_owned(), plain(reason)]);
                fields.resize(BEFORE.len() + self.columns + AFTER.len(), String::new());
            }
        }
        let line = line(fields.iter().map(String::as_str))?;
        let mut file = self.file.lock().unwrap_or_else(PoisonError::into_inner);
        file.write_all(&line).and_then(|()| file.sync_data())?;
        Ok(())
    }
}

/// Returns the rows of a file of results that are whole.
///
/// # Errors
/// As [`Results::open`].
pub fn read(path: &Path, campaign: &Campaign) -> Result<Vec<Row>> {
    let name = || path.display().to_string();
    let bytes = std::fs::read(path).with_context(name)?;
    rows(&bytes, campaign, &campaign.fingerprint()?).with_context(name)
}

fn header(campaign: &Campaign) -> Vec<String> {
    BEFORE
        .into_iter()
        .chain(campaign.keys())
        .chain(AFTER)
        .map(str::to_owned)
        .collect()
}

fn line<'a>(fields: impl Iterator<Item = &'a str>) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(fields)?;
    Ok(writer.into_inner()?)
}

pub(super) fn rows(text: &[u8], campaign: &Campaign, fingerprint: &str) -> Result<Vec<Row>> {
    if text.is_empty() {
        return Ok(Vec::new());
    }
    let mut reader = csv::Reader::from_reader(text);
    let header = header(campaign);
    if !reader.headers()?.iter().eq(header.iter()) {
        bail!(
            "its columns are not those of campaign {}: results of another one?",
            campaign.name
        );
    }
    let at = |name: &str| header.iter().position(|column| column == name).unwrap_or(0);
    let (completed, rms, steer) = (
        at("completed"),
        at("cross_track_rms_m"),
        at("steer_total_variation_m_s"),
    );
    let mut rows = Vec::new();
    for record in reader.records() {
        let record = record?;
        if &record[0] != fingerprint {
            bail!(
                "made by a campaign with fingerprint {}, this one has {fingerprint}: seed, draws, \
                 scenario, vehicles or version are others",
                &record[0]
            );
        }
        let number = |column: usize| -> Result<Option<f64>> {
            match &record[column] {
                "" => Ok(None),
                text => Ok(Some(text.parse()?)),
            }
        };
        rows.push(Row {
            index: record[1].parse()?,
            controller: record[3].to_owned(),
            completed: record[completed].parse()?,
            cross_track_rms_m: number(rms)?,
            steer_total_variation_m_s: number(steer)?,
        });
    }
    Ok(rows)
}
