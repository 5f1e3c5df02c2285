//! Logs of drives: tread speeds and attitude, and poses where there are any.

mod columns;
mod commands;
mod frozen;
mod plausibility;
mod read;
pub mod sources;
#[cfg(test)]
mod tests;

pub use columns::{
    AttitudeColumns, ColumnMap, CommandColumns, HeadingColumns, PoseColumns, Reversed,
};
pub use commands::{DriveRecord, TimedSpeeds, as_counted, read_commands};
pub use plausibility::Suspicion;

use crate::bounds::{Bounds, RangeError};
use crate::frames::{Attitude, Pose};
use crate::number::likely_mistake;
use crate::speeds::{MeasuredTreadSpeeds, MotorSpeeds};

/// Rows further apart than this, s, are not connected: nothing is known of the motion between them.
pub const GAP_MAX_S: f64 = 0.5;

/// Rows of a log, or messages of a topic, that are kept in memory: a hundred a second for 27 hours.
pub const ROWS_MAX: usize = 10_000_000;

/// One row of a log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogRow {
    /// Instant, s.
    pub time_s: f64,
    /// Tread speeds as measured, before c_l and c_r.
    pub speeds: MeasuredTreadSpeeds,
    /// Roll and pitch.
    pub attitude: Attitude,
    /// Pose, in rows with a new one.
    pub pose: Option<Pose>,
}

/// A drive, row by row, with time rising.
#[derive(Debug, Clone, PartialEq)]
pub struct DriveLog {
    rows: Vec<LogRow>,
    notes: Vec<Note>,
}

/// What reading a log changed or left out.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Note {
    /// Rows have the values of some sensors only.
    #[error(
        "{without} of its rows lack speeds or attitude, which are interpolated to those with speeds or a pose; {left_out} of \
         these {rows} are left out, where another sensor is silent for more than {GAP_MAX_S} s"
    )]
    Resampled {
        /// Rows without speeds or without an attitude.
        without: usize,
        /// Rows with tread speeds or a pose.
        rows: usize,
        /// Those left out.
        left_out: usize,
    },
    /// Rows repeat the time of the row before.
    #[error("{count} of {rows} rows repeat the time of the row before and are left out")]
    RepeatedTimes {
        /// How many.
        count: usize,
        /// All rows.
        rows: usize,
    },
    /// Nothing was recorded for a while.
    #[error(
        "{count} times no row follows within {GAP_MAX_S} s, the longest time for {longest_s:.1} s, {from_s:.1} s after the first: \
         the motion between does not count"
    )]
    Gaps {
        /// How many.
        count: usize,
        /// Duration of the longest, s.
        longest_s: f64,
        /// Its beginning after the first row, s.
        from_s: f64,
    },
    /// Poses are not numbers.
    #[error("{count} poses that are not finite are left out")]
    PosesLeftOut {
        /// How many.
        count: usize,
    },
}

impl DriveLog {
    /// Returns the log of these rows.
    ///
    /// # Errors
    /// Names the row, counted from 1, whose time does not rise or in which a number is not finite or
    /// an angle or speed is out of its range; there have to be two rows.
    pub fn new(rows: Vec<LogRow>) -> Result<Self, LogError> {
        if rows.len() < 2 {
            return Err(LogError::TooShort { rows: rows.len() });
        }
        for (index, row) in rows.iter().enumerate() {
            let row_number = index + 1;
            check_row(row).map_err(|reason| LogError::OutOfRange { row_number, reason })?;
            if index > 0 && row.time_s <= rows[index - 1].time_s {
                return Err(LogError::TimeNotRising {
                    row_number,
                    time_s: row.time_s,
                    before_s: rows[index - 1].time_s,
                });
            }
        }
        let notes = gaps(&rows).into_iter().collect();
        Ok(Self { rows, notes })
    }

    /// Returns the rows.
    pub fn rows(&self) -> &[LogRow] {
        &self.rows
    }

    /// Returns what reading it changed or left out.
    pub fn notes(&self) -> &[Note] {
        &self.notes
    }

    /// Returns the rows between gaps: pieces in which no two rows are further apart than `gap_max_s`.
    pub fn pieces(&self, gap_max_s: f64) -> impl Iterator<Item = &[LogRow]> {
        self.rows
            .chunk_by(move |row, next| next.time_s - row.time_s <= gap_max_s)
    }

    /// Returns how many rows have a pose.
    pub fn pose_count(&self) -> usize {
        self.rows.iter().filter(|row| row.pose.is_some()).count()
    }

    /// Returns the log with roll and pitch smoothed without delay by a Gaussian of `std_s`, s; 0
    /// keeps them.
    ///
    /// Noise of the attitude biases lambda_2, whose equations (9) and (10) have a kink in it; the
    /// vehicle itself turns slowly against a quarter of a second.
    pub fn with_smooth_attitude(&self, std_s: f64) -> Self {
        if std_s <= 0.0 {
            return self.clone();
        }
        // The margin keeps rounding from taking a row on one side only.
        let reach_s = 3.0 * std_s + 1e-6;
        let mut first = 0;
        let rows = self.rows.iter().map(|row| {
            while row.time_s - self.rows[first].time_s > reach_s {
                first += 1;
            }
            let (mut total, mut roll_rad, mut pitch_rad) = (0.0, 0.0, 0.0);
            for near in self.rows[first..]
                .iter()
                .take_while(|near| near.time_s - row.time_s <= reach_s)
            {
                let distance = (near.time_s - row.time_s) / std_s;
                let weight = (-0.5 * distance * distance).exp();
                total += weight;
                roll_rad += weight * near.attitude.roll_rad;
                pitch_rad += weight * near.attitude.pitch_rad;
            }
            LogRow {
                attitude: Attitude {
                    roll_rad: roll_rad / total,
                    pitch_rad: pitch_rad / total,
                },
                ..*row
            }
        });
        Self {
            rows: rows.collect(),
            notes: self.notes.clone(),
        }
    }
}

/// Returns the note about gaps between rows, if there are any.
fn gaps(rows: &[LogRow]) -> Option<Note> {
    let start_s = rows.first()?.time_s;
    let steps = rows.windows(2);
    let steps = steps.map(|pair| (pair[1].time_s - pair[0].time_s, pair[0].time_s - start_s));
    let (mut count, mut longest) = (0, (0.0, 0.0));
    for gap in steps.filter(|(step_s, _)| *step_s > GAP_MAX_S) {
        count += 1;
        if gap.0 > longest.0 {
            longest = gap;
        }
    }
    let (longest_s, from_s) = longest;
    (count > 0).then_some(Note::Gaps {
        count,
        longest_s,
        from_s,
    })
}

fn check_row(row: &LogRow) -> Result<(), RangeError> {
    let angle = |key, value| Bounds::new(-1.5, 1.5, "rad").check(key, value);
    let speed = |key, value| Bounds::new(-50.0, 50.0, "m/s").check(key, value);
    let finite = |key, value| Bounds::new(-1e12, 1e12, "").check(key, value);
    finite("time_s", row.time_s)?;
    speed("v_left_m_s", row.speeds.left_m_s)?;
    speed("v_right_m_s", row.speeds.right_m_s)?;
    angle("roll_rad", row.attitude.roll_rad)?;
    angle("pitch_rad", row.attitude.pitch_rad)?;
    if let Some(pose) = row.pose {
        finite("x_m", pose.x_m)?;
        finite("y_m", pose.y_m)?;
        finite("z_m", pose.z_m)?;
        finite("yaw_rad", pose.yaw_rad)?;
    }
    Ok(())
}

fn check_command(speeds: &MotorSpeeds, time_s: f64) -> Result<(), RangeError> {
    Bounds::new(-1e12, 1e12, "").check("time_s", time_s)?;
    let speed = Bounds::new(-50.0, 50.0, "m/s");
    speed.check("traction of a row", speeds.traction_m_s)?;
    speed.check("steer of a row", speeds.steer_m_s).map(drop)
}

/// Why a log cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LogError {
    /// There is nothing to integrate over.
    #[error("{rows} rows, at least 2 are needed")]
    TooShort {
        /// Rows found.
        rows: usize,
    },
    /// It would not fit the memory.
    #[error("more than {rows_max} rows; cut it, or keep fewer rows a second")]
    TooLong {
        /// Most rows.
        rows_max: usize,
    },
    /// A value is out of its range.
    #[error("row {row_number}: {reason}{}", likely_unit(.reason))]
    OutOfRange {
        /// Data row, counted from 1.
        row_number: usize,
        /// Column, value and range.
        reason: RangeError,
    },
    /// Time stands still or goes back.
    #[error("row {row_number}: time {time_s} s goes back from {before_s} s; sort the rows by time")]
    TimeNotRising {
        /// Data row, counted from 1.
        row_number: usize,
        /// Its time, s.
        time_s: f64,
        /// Time of the row before, s.
        before_s: f64,
    },
    /// Most rows have the time of the row before.
    #[error(
        "{count} of {rows} rows have the time of the row before: write the time with more decimals"
    )]
    CoarseTime {
        /// How many.
        count: usize,
        /// All rows.
        rows: usize,
    },
    /// A column is not there.
    #[error(
        "no column {column}; there are: {present}: {}", likely_separator(.present)
    )]
    NoColumn {
        /// Name looked for.
        column: String,
        /// The columns found.
        present: String,
    },
    /// A field is not a number.
    #[error("row {row_number}, column {column}: {found:?} is not a number{}", likely_mistake(.found))]
    NotANumber {
        /// Data row, counted from 1.
        row_number: usize,
        /// Column.
        column: String,
        /// The text found there.
        found: String,
    },
    /// Two columns have the same name, so that it is not known which one is meant.
    #[error("two columns are named {column}: rename or remove one")]
    DuplicateColumn {
        /// Their name.
        column: String,
    },
    /// The header is missing.
    #[error("the file is empty: its first line must name the columns")]
    Empty,
    /// The first line holds numbers.
    #[error(
        "line 1: holds numbers; the first line must name the columns (`ros2 topic echo --csv` writes none)"
    )]
    NoHeader,
    /// A row has more or fewer fields than the header.
    #[error("line {line}: {found} fields, but the header names {expected}{}", likely_cause(*.found, *.expected))]
    FieldCount {
        /// Line of the file, counted from 1.
        line: u64,
        /// Fields in this row.
        found: u64,
        /// Fields in the header.
        expected: u64,
    },
    /// A pose has some of its columns filled and others empty.
    #[error("row {row_number}: the pose is not complete")]
    HalfAPose {
        /// Data row, counted from 1.
        row_number: usize,
    },
    /// A quaternion has no direction.
    #[error("row {row_number}: the quaternion is zero")]
    ZeroQuaternion {
        /// Data row, counted from 1.
        row_number: usize,
    },
    /// The text has another encoding.
    #[error("{}: is not UTF-8 text; save it as UTF-8", row_name(*.row_number))]
    NotUtf8 {
        /// Data row, counted from 1; 0 is the header.
        row_number: u64,
    },
    /// The text is not CSV.
    #[error("not readable as CSV: {reason}")]
    Csv {
        /// What the reader found.
        reason: String,
    },
}

/// Returns what may be wrong with the unit of a value that is far out of its range.
fn likely_unit(reason: &RangeError) -> &'static str {
    if reason.value.is_nan() {
        return "; leave out rows without a value";
    }
    match reason.key {
        "time_s" => {
            "; is the column in milliseconds, microseconds or nanoseconds? It must be in seconds"
        }
        "roll_rad" | "pitch_rad" => "; is the column in degrees? It must be in radians",
        "v_left_m_s" | "v_right_m_s" => {
            "; is the column in rpm or rad/s? It must be in m/s, tread_speed_scale of --columns converts"
        }
        _ => "",
    }
}

/// Returns what may be wrong with a file that lacks a column.
fn likely_separator(present: &str) -> &'static str {
    if present.starts_with("sep=") {
        "the first line is one for spreadsheets; remove it, separate fields by commas and write decimals with a point"
    } else if present.contains(';') || present.contains('\t') {
        "the fields are separated by semicolons or tabs; separate them by commas and write decimals with a point"
    } else {
        "where the log has other names, units or frames, --columns FILE says which"
    }
}

fn row_name(row_number: u64) -> String {
    match row_number {
        0 => "line 1".to_owned(),
        row_number => format!("row {row_number}"),
    }
}

fn likely_cause(found: u64, expected: u64) -> &'static str {
    if found > expected {
        "; fields are separated by commas, so write decimals with a point (12.5, not 12,5)"
    } else {
        "; if the file was cut off there, remove the line"
    }
}
