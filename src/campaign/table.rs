//! Columns and rows of a campaign's results.

use crate::config::Campaign;
use crate::record::{GuardSummary, Summary};
use anyhow::{Context, Result, bail};
use serde_yaml::Value;
use sidehill_controller::config::ControllerKind;

/// Outcome of one run with one controller.
pub struct RunOutcome {
    /// Number of the run.
    pub index: u32,
    /// Its seed.
    pub seed: u64,
    /// The controller.
    pub kind: ControllerKind,
    /// What was drawn, in the order of the campaign's keys; empty where drawing failed.
    pub values: Vec<Value>,
    /// The figures, or why there are none.
    pub figures: Result<Summary, String>,
}

/// The fields of a row that the summary needs.
#[derive(Debug, Clone, PartialEq)]
pub struct CampaignRow {
    /// Number of the run.
    pub index: u32,
    /// Controller's name.
    pub controller: String,
    /// Whether it completed.
    pub completed: bool,
    /// Cross-track RMS, m, where the run started.
    pub cross_track_rms_m: Option<f64>,
    /// Steer total variation, m/s.
    pub steer_total_variation_m_s: Option<f64>,
    /// Distance travelled over the time of the run, m/s.
    pub mean_speed_m_s: Option<f64>,
    /// Time of the run, s.
    pub time_s: Option<f64>,
    /// Largest effective speed of a tread, m/s.
    pub tread_speed_max_m_s: Option<f64>,
}

/// Columns before the drawn values.
pub(super) const BEFORE: [&str; 4] = ["campaign", "index", "seed", "controller"];
/// Columns after the drawn values.
pub(super) const AFTER: [&str; 16] = [
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
    "mean_speed_m_s",
    "time_s",
    "tread_speed_max_m_s",
    "cross_track_bound_held",
    "cross_track_ahead_bound_held",
];

/// Columns after those where the steepness guard is on.
pub(super) const GUARD: [&str; 5] = [
    "rollover_margin_min",
    "friction_use_max",
    "tilt_max_deg",
    "speed_share_min",
    "warned_s",
];

/// The columns of one campaign's results.
pub struct CampaignTable {
    name: String,
    fingerprint: String,
    header: Vec<String>,
    /// Whether the columns of the guard are among them.
    guard: bool,
}

impl CampaignTable {
    /// Returns the table of a campaign.
    ///
    /// # Errors
    /// Why the campaign has no fingerprint.
    pub fn of(campaign: &Campaign) -> Result<Self> {
        let guard = campaign.has_guard()?;
        let after = AFTER.into_iter().chain(GUARD.into_iter().filter(|_| guard));
        let header = BEFORE.into_iter().chain(campaign.keys()).chain(after);
        Ok(Self {
            name: campaign.name.clone(),
            fingerprint: campaign.fingerprint()?,
            header: header.map(str::to_owned).collect(),
            guard,
        })
    }

    /// Returns the first line.
    ///
    /// # Errors
    /// None that can happen; those of the CSV writer.
    pub fn header_line(&self) -> Result<Vec<u8>> {
        line(self.header.iter().map(String::as_str))
    }

    /// Returns the line of an outcome.
    ///
    /// # Errors
    /// A drawn value that cannot be written as JSON.
    pub fn line(&self, outcome: &RunOutcome) -> Result<Vec<u8>> {
        let mut fields = vec![
            self.fingerprint.clone(),
            outcome.index.to_string(),
            outcome.seed.to_string(),
            outcome.kind.name().to_owned(),
        ];
        let after = AFTER.len() + if self.guard { GUARD.len() } else { 0 };
        for column in 0..self.header.len() - BEFORE.len() - after {
            fields.push(match outcome.values.get(column) {
                None => String::new(),
                Some(Value::Number(number)) => number.to_string(),
                Some(value) => serde_json::to_string(value)?,
            });
        }
        // A line break within a field would look like the end of a row.
        let plain = |reason: &str| reason.replace(['\n', '\r'], " ");
        let field = |share: Option<f64>| share.map_or_else(String::new, |share| share.to_string());
        match &outcome.figures {
            Ok(s) => {
                fields.extend([
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
                    s.mean_speed_m_s.to_string(),
                    s.time_s.to_string(),
                    s.tread_speed_max_m_s.to_string(),
                    field(s.cross_track_bound_held),
                    field(s.cross_track_ahead_bound_held),
                ]);
                if self.guard {
                    fields.extend(guard_fields(s.guard.as_ref()));
                }
            }
            Err(reason) => {
                fields.extend(["false".to_owned(), plain(reason)]);
                fields.resize(self.header.len(), String::new());
            }
        }
        line(fields.iter().map(String::as_str))
    }

    /// Returns the rows of a file's text, which consists of complete lines.
    ///
    /// # Errors
    /// Results of another campaign, or invalid rows.
    pub fn rows(&self, text: &[u8]) -> Result<Vec<CampaignRow>> {
        if text.is_empty() {
            return Ok(Vec::new());
        }
        let mut reader = csv::Reader::from_reader(text);
        if !reader.headers()?.iter().eq(self.header.iter()) {
            bail!(
                "its columns are not those of campaign {}: results of another one?",
                self.name
            );
        }
        let at = |name: &str| {
            let position = self.header.iter().position(|column| column == name);
            position.with_context(|| format!("there is no column {name}"))
        };
        let (completed, rms, steer) = (
            at("completed")?,
            at("cross_track_rms_m")?,
            at("steer_total_variation_m_s")?,
        );
        let (speed, time, tread) = (
            at("mean_speed_m_s")?,
            at("time_s")?,
            at("tread_speed_max_m_s")?,
        );
        let mut rows = Vec::new();
        for record in reader.records() {
            let record = record?;
            if record[0] != self.fingerprint {
                bail!(other_origin(&record[0], &self.fingerprint));
            }
            let number = |column: usize| -> Result<Option<f64>> {
                match &record[column] {
                    "" => Ok(None),
                    text => Ok(Some(text.parse()?)),
                }
            };
            rows.push(CampaignRow {
                index: record[1].parse()?,
                controller: record[3].to_owned(),
                completed: record[completed].parse()?,
                cross_track_rms_m: number(rms)?,
                steer_total_variation_m_s: number(steer)?,
                mean_speed_m_s: number(speed)?,
                time_s: number(time)?,
                tread_speed_max_m_s: number(tread)?,
            });
        }
        Ok(rows)
    }
}

/// Returns why rows of one fingerprint do not belong to those of another.
pub(super) fn other_origin(found: &str, expected: &str) -> String {
    let split = |fingerprint: &str| -> (String, String) {
        let (campaign, build) = fingerprint
            .split_once('-')
            .unwrap_or((fingerprint, "unknown"));
        (campaign.to_owned(), build.to_owned())
    };
    let ((campaign, build), (own_campaign, own_build)) = (split(found), split(expected));
    if campaign == own_campaign {
        format!(
            "made by build {build} of sidehill, not by build {own_build}: a changed program may drive otherwise, so their \
             rows are not mixed; name another --out, or repeat all runs with one build"
        )
    } else {
        format!(
            "made by a campaign with fingerprint {campaign}, not {own_campaign}: seed, draws, scenario, vehicles or version \
             are others"
        )
    }
}

fn guard_fields(guard: Option<&GuardSummary>) -> [String; GUARD.len()] {
    let Some(g) = guard else {
        return Default::default();
    };
    [
        g.rollover_margin_min.to_string(),
        g.friction_use_max.to_string(),
        g.tilt_max_deg.to_string(),
        g.speed_share_min.to_string(),
        g.warned_s.map_or_else(String::new, |s| s.to_string()),
    ]
}

/// Returns fields as a CSV line.
///
/// # Errors
/// None that can happen; those of the CSV writer.
pub(super) fn line<'a>(fields: impl Iterator<Item = &'a str>) -> Result<Vec<u8>> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    writer.write_record(fields)?;
    Ok(writer.into_inner()?)
}
