//! Logs from CSV.

use super::columns::{AttitudeColumns, ColumnMap, HeadingColumns, PoseColumns};
use super::sources::{Sources, TimedValues};
use super::{DriveLog, LogError, LogRow, Note, ROWS_MAX};
use crate::frames::{Attitude, Pose, RosAttitude, paper_attitude};
use crate::speeds::MeasuredTreadSpeeds;
use csv::{ReaderBuilder, StringRecord, Trim};
use nalgebra::{Quaternion, UnitQuaternion};
use std::io::Read;

impl DriveLog {
    /// Returns the log in CSV with the columns of `map`.
    ///
    /// Columns of the pose may be absent together, where `map` is the contract's, and empty together
    /// in rows without a pose. Where rows lack speeds or attitude, as with a row for each sensor, these are interpolated. Poses
    /// that are not finite and rows that repeat a time are left out, as [`DriveLog::notes`] says.
    ///
    /// # Errors
    /// Names the row and column at fault.
    pub fn read(source: impl Read, map: &ColumnMap) -> Result<Self, LogError> {
        Self::read_rows(source, map, ROWS_MAX)
    }

    pub(super) fn read_rows(
        source: impl Read,
        map: &ColumnMap,
        rows_max: usize,
    ) -> Result<Self, LogError> {
        let mut reader = ReaderBuilder::new()
            .trim(Trim::All)
            .comment(Some(b'#'))
            .from_reader(source);
        let header = without_byte_order_mark(reader.headers().map_err(csv_error)?);
        check_header(&header)?;
        let columns = LogColumns::find(&header, map)?;
        let mut rows: Vec<PartRow> = Vec::new();
        let mut newest: Option<Pose> = None;
        let mut not_finite = 0;
        for (index, record) in reader.records().enumerate() {
            let record = record.map_err(csv_error)?;
            // Spreadsheets write rows that were emptied.
            if record.iter().all(str::is_empty) {
                continue;
            }
            let mut row = columns.row(&Fields {
                record: &record,
                header: &header,
                row_number: index + 1,
            })?;
            if columns.pose_repeats && row.pose == newest {
                row.pose = None;
            } else {
                newest = row.pose.or(newest);
            }
            let finite = |pose: &Pose| {
                [pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad]
                    .iter()
                    .all(|value| value.is_finite())
            };
            if row.pose.is_some_and(|pose| !finite(&pose)) {
                row.pose = None;
                not_finite += 1;
            }
            if index >= rows_max {
                return Err(LogError::TooLong { rows_max });
            }
            rows.push(row);
        }
        let mut log = whole(rows)?;
        if not_finite > 0 {
            log.notes.push(Note::PosesLeftOut { count: not_finite });
        }
        Ok(log)
    }
}

/// A row in which the values of some sensors may be missing.
#[derive(Clone, Copy)]
struct PartRow {
    time_s: f64,
    speeds: Option<MeasuredTreadSpeeds>,
    attitude: Option<Attitude>,
    pose: Option<Pose>,
}

/// Returns the log of rows of which each has all values, or some sensors'.
fn whole(rows: Vec<PartRow>) -> Result<DriveLog, LogError> {
    if let Some(index) = rows.windows(2).position(|w| w[1].time_s < w[0].time_s) {
        return Err(LogError::TimeNotRising {
            row_number: index + 2,
            time_s: rows[index + 1].time_s,
            before_s: rows[index].time_s,
        });
    }
    let dense = |row: &PartRow| {
        Some(LogRow {
            time_s: row.time_s,
            speeds: row.speeds?,
            attitude: row.attitude?,
            pose: row.pose,
        })
    };
    if rows.iter().any(|row| dense(row).is_none()) {
        return resampled(&rows);
    }
    // In place: a log may be as large as the memory allows.
    let mut dense: Vec<LogRow> = rows.into_iter().filter_map(|row| dense(&row)).collect();
    let all = dense.len();
    dense.dedup_by(|row, before| row.time_s == before.time_s);
    let count = all - dense.len();
    if count > 0 && 2 * count >= all {
        return Err(LogError::CoarseTime { count, rows: all });
    }
    let mut log = DriveLog::new(dense)?;
    if count > 0 {
        log.notes.push(Note::RepeatedTimes { count, rows: all });
    }
    Ok(log)
}

fn resampled(rows: &[PartRow]) -> Result<DriveLog, LogError> {
    fn series<T>(rows: &[PartRow], value: impl Fn(&PartRow) -> Option<T>) -> TimedValues<f64, T> {
        let known = rows
            .iter()
            .filter_map(|row| Some((row.time_s, value(row)?)));
        let mut known: TimedValues<f64, T> = known.collect();
        known.dedup_by(|next, before| next.0 == before.0);
        known
    }
    let lacks = |row: &&PartRow| row.speeds.is_none() || row.attitude.is_none();
    let without = rows.iter().filter(lacks).count();
    let sources = Sources {
        tread_speeds: series(rows, |row| row.speeds),
        attitudes: Some(series(rows, |row| row.attitude)),
        poses: series(rows, |row| row.pose),
    };
    let (found, left_out) = sources.rows(|from_s, to_s| to_s - from_s);
    let rows: Vec<LogRow> = found
        .into_iter()
        .map(|(time_s, row)| LogRow { time_s, ..row })
        .collect();
    let note = Note::Resampled {
        without,
        rows: rows.len() + left_out,
        left_out,
    };
    let mut log = DriveLog::new(rows)?;
    log.notes.push(note);
    Ok(log)
}

pub(super) fn csv_error(error: csv::Error) -> LogError {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            pos,
            expected_len,
            len,
        } => LogError::FieldCount {
            line: pos.as_ref().map_or(0, csv::Position::line),
            found: *len,
            expected: *expected_len,
        },
        csv::ErrorKind::Utf8 { pos, .. } => LogError::NotUtf8 {
            row_number: pos.as_ref().map_or(0, csv::Position::record),
        },
        _ => LogError::Csv {
            reason: error.to_string(),
        },
    }
}

/// Returns the header without the mark that some programs begin a file with.
pub(super) fn without_byte_order_mark(header: &StringRecord) -> StringRecord {
    header
        .iter()
        .map(|name| name.trim_start_matches('\u{feff}'))
        .collect()
}

pub(super) fn check_header(header: &StringRecord) -> Result<(), LogError> {
    if header.iter().all(str::is_empty) {
        return Err(LogError::Empty);
    }
    let mut names: Vec<&str> = header.iter().filter(|name| !name.is_empty()).collect();
    let numbers = names.iter().filter(|name| name.parse::<f64>().is_ok());
    if 2 * numbers.count() > names.len() {
        return Err(LogError::NoHeader);
    }
    names.sort_unstable();
    match names.windows(2).find(|pair| pair[0] == pair[1]) {
        Some(pair) => Err(LogError::DuplicateColumn {
            column: pair[0].to_owned(),
        }),
        None => Ok(()),
    }
}

/// Positions of the columns in a record.
struct LogColumns {
    time: usize,
    speeds: [usize; 2],
    /// Factors for left and right.
    speed_scales: [f64; 2],
    attitude: AttitudeColumn,
    pose: Option<([usize; 3], HeadingSource)>,
    pose_repeats: bool,
    heading_offset_rad: f64,
}

enum AttitudeColumn {
    Paper([usize; 2]),
    Rep103([usize; 2]),
    Quaternion([usize; 4]),
    Level,
}

enum HeadingSource {
    Paper(usize),
    Rep103(usize),
    Quaternion([usize; 4]),
}

impl LogColumns {
    fn find(header: &StringRecord, map: &ColumnMap) -> Result<Self, LogError> {
        let find = |name: &String| position(header, name);
        let attitude = match &map.attitude {
            AttitudeColumns::Paper { roll, pitch } => {
                AttitudeColumn::Paper([find(roll)?, find(pitch)?])
            }
            AttitudeColumns::Rep103 { roll, pitch } => {
                AttitudeColumn::Rep103([find(roll)?, find(pitch)?])
            }
            AttitudeColumns::Quaternion { x, y, z, w } => {
                AttitudeColumn::Quaternion([find(x)?, find(y)?, find(z)?, find(w)?])
            }
            AttitudeColumns::Level {} => AttitudeColumn::Level,
        };
        // In the contract a log without poses is still a log.
        let pose = map.pose.as_ref().filter(|pose| {
            *map != ColumnMap::default()
                || [&pose.x, &pose.y, &pose.z]
                    .into_iter()
                    .any(|name| find(name).is_ok())
        });
        Ok(Self {
            time: find(&map.time)?,
            speeds: [find(&map.tread_speed_left)?, find(&map.tread_speed_right)?],
            speed_scales: map
                .reversed
                .signs()
                .map(|sign| sign * map.tread_speed_scale),
            attitude,
            pose: pose.map(|pose| pose_source(header, pose)).transpose()?,
            pose_repeats: pose.is_some_and(|pose| pose.repeats),
            heading_offset_rad: pose.map_or(0.0, |pose| pose.heading_offset_deg.to_radians()),
        })
    }

    fn row(&self, fields: &Fields) -> Result<PartRow, LogError> {
        let ([left, right], [left_scale, right_scale]) = (self.speeds, self.speed_scales);
        let time_s = fields.number(self.time)?;
        if !time_s.is_finite() {
            return Err(fields.not_a_number(self.time));
        }
        let speeds = if fields.all_empty(&[left, right]) {
            None
        } else {
            Some(MeasuredTreadSpeeds {
                left_m_s: left_scale * fields.number(left)?,
                right_m_s: right_scale * fields.number(right)?,
            })
        };
        let attitude_columns: &[usize] = match &self.attitude {
            AttitudeColumn::Paper(both) | AttitudeColumn::Rep103(both) => both,
            AttitudeColumn::Quaternion(xyzw) => xyzw,
            AttitudeColumn::Level => &[],
        };
        let attitude = if !attitude_columns.is_empty() && fields.all_empty(attitude_columns) {
            None
        } else {
            Some(self.attitude(fields)?)
        };
        Ok(PartRow {
            time_s,
            speeds,
            attitude,
            pose: self.pose(fields)?,
        })
    }

    fn attitude(&self, fields: &Fields) -> Result<Attitude, LogError> {
        Ok(match self.attitude {
            AttitudeColumn::Paper([roll, pitch]) => Attitude {
                roll_rad: fields.number(roll)?,
                pitch_rad: fields.number(pitch)?,
            },
            AttitudeColumn::Rep103([roll, pitch]) => {
                let angles = RosAttitude {
                    roll_rad: fields.number(roll)?,
                    pitch_rad: fields.number(pitch)?,
                    yaw_rad: 0.0,
                };
                angles.to_paper().0
            }
            AttitudeColumn::Quaternion(xyzw) => paper_attitude(&fields.quaternion(xyzw)?).0,
            AttitudeColumn::Level => Attitude::LEVEL,
        })
    }

    fn pose(&self, fields: &Fields) -> Result<Option<Pose>, LogError> {
        let Some(([x, y, z], heading)) = &self.pose else {
            return Ok(None);
        };
        let heading_columns = match heading {
            HeadingSource::Paper(yaw) | HeadingSource::Rep103(yaw) => std::slice::from_ref(yaw),
            HeadingSource::Quaternion(xyzw) => xyzw.as_slice(),
        };
        let all = || [x, y, z].into_iter().chain(heading_columns);
        if all().all(|column| fields.is_empty(*column)) {
            return Ok(None);
        }
        if all().any(|column| fields.is_empty(*column)) {
            return Err(LogError::HalfAPose {
                row_number: fields.row_number,
            });
        }
        let yaw_rad = match *heading {
            HeadingSource::Paper(yaw) => fields.number(yaw)?,
            HeadingSource::Rep103(yaw) => {
                let level = RosAttitude {
                    yaw_rad: fields.number(yaw)?,
                    ..RosAttitude::default()
                };
                level.to_paper().1
            }
            HeadingSource::Quaternion(xyzw) => paper_attitude(&fields.quaternion(xyzw)?).1,
        };
        Ok(Some(Pose {
            x_m: fields.number(*x)?,
            y_m: fields.number(*y)?,
            z_m: fields.number(*z)?,
            yaw_rad: yaw_rad + self.heading_offset_rad,
        }))
    }
}

fn pose_source(
    header: &StringRecord,
    pose: &PoseColumns,
) -> Result<([usize; 3], HeadingSource), LogError> {
    let find = |name: &String| position(header, name);
    let heading = match &pose.heading {
        HeadingColumns::Paper { yaw } => HeadingSource::Paper(find(yaw)?),
        HeadingColumns::Rep103 { yaw } => HeadingSource::Rep103(find(yaw)?),
        HeadingColumns::Quaternion { x, y, z, w } => {
            HeadingSource::Quaternion([find(x)?, find(y)?, find(z)?, find(w)?])
        }
    };
    Ok(([find(&pose.x)?, find(&pose.y)?, find(&pose.z)?], heading))
}

pub(super) fn position(header: &StringRecord, name: &String) -> Result<usize, LogError> {
    header
        .iter()
        .position(|column| column == name)
        .ok_or_else(|| LogError::NoColumn {
            column: name.clone(),
            present: shortened(&header.iter().collect::<Vec<_>>().join(", ")),
        })
}

/// Returns the beginning of a text that a message quotes.
fn shortened(text: &str) -> String {
    const QUOTED: usize = 1000;
    match text.char_indices().nth(QUOTED) {
        Some((end, _)) => format!("{} ...", &text[..end]),
        None => text.to_owned(),
    }
}

/// One record with what an error needs to name it.
pub(super) struct Fields<'a> {
    pub(super) record: &'a StringRecord,
    pub(super) header: &'a StringRecord,
    pub(super) row_number: usize,
}

impl Fields<'_> {
    fn text(&self, column: usize) -> &str {
        self.record.get(column).unwrap_or_default()
    }

    pub(super) fn is_empty(&self, column: usize) -> bool {
        self.text(column).is_empty()
    }

    /// Returns whether none of the columns has a value.
    pub(super) fn all_empty(&self, columns: &[usize]) -> bool {
        columns
            .iter()
            .all(|column| self.is_empty(*column) || self.text(*column).eq_ignore_ascii_case("nan"))
    }

    pub(super) fn number(&self, column: usize) -> Result<f64, LogError> {
        self.text(column)
            .parse()
            .map_err(|_| self.not_a_number(column))
    }

    pub(super) fn not_a_number(&self, column: usize) -> LogError {
        LogError::NotANumber {
            row_number: self.row_number,
            column: self.header.get(column).unwrap_or_default().to_owned(),
            found: self.text(column).to_owned(),
        }
    }

    fn quaternion(&self, [x, y, z, w]: [usize; 4]) -> Result<UnitQuaternion<f64>, LogError> {
        let quaternion = Quaternion::new(
            self.number(w)?,
            self.number(x)?,
            self.number(y)?,
            self.number(z)?,
        );
        UnitQuaternion::try_new(quaternion, 1e-3).ok_or(LogError::ZeroQuaternion {
            row_number: self.row_number,
        })
    }
}
