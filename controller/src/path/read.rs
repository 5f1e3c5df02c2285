//! Routes from CSV text.

use super::point::finite;
use super::{Direction, PathError, Point2, ROUTE_SPEEDS, RawPoint, Route};
use sidehill_plant::number::likely_mistake;
use std::io::Read;

/// Length of an action, characters.
const ACTION_MAX: usize = 64;

/// Returns the points of a CSV with the columns `x_m`, `y_m` and, if wanted, these, in any order:
///
/// - `z_m`;
/// - `direction`, `forward` or `reverse`: the way to drive from this point to the next; empty: as before;
/// - `speed_m_s`: the largest speed from this point to the next; empty: as before, and at first none;
/// - `action`: what is to be done where the vehicle passes the point, at most 64 characters; empty: nothing.
///
/// # Errors
/// [`PathError::Csv`] with the line for text that is not such a table, [`PathError::Empty`] where
/// there is no row, [`PathError::Read`] if reading fails.
pub fn read_csv(reader: impl Read) -> Result<Route, PathError> {
    let mut table = csv::ReaderBuilder::new()
        .trim(csv::Trim::All)
        .comment(Some(b'#'))
        .from_reader(reader);
    let header: csv::StringRecord = table
        .headers()
        .map_err(csv_error)?
        .iter()
        // Some programs begin a file with a byte order mark.
        .map(|name| name.trim_start_matches('\u{feff}'))
        .collect();
    let columns = Columns::of(&header)?;
    let mut points: Vec<RawPoint> = Vec::new();
    let mut actions = Vec::new();
    for record in table.records() {
        let record = record.map_err(csv_error)?;
        let mut point = columns.point(&record)?;
        point.speed_m_s = match columns.speed(&record)? {
            None => points.last().and_then(|before| before.speed_m_s),
            given => given,
        };
        if let Some(action) = columns.action(&record)? {
            actions.push((points.len(), action));
        }
        points.push(point);
    }
    if points.is_empty() {
        return Err(PathError::Empty);
    }
    Ok(Route {
        points,
        actions,
        origin: None,
        notes: Vec::new(),
    })
}

/// Returns what may be wrong with a table whose header has such a column.
fn likely_cause(name: &str) -> &'static str {
    let name = name.to_lowercase();
    if name.starts_with("sep=") {
        "; remove this line, which is one for spreadsheets, separate fields by commas and write decimals with a point"
    } else if name.contains(';') || name.contains('\t') {
        "; separate fields by commas and write decimals with a point"
    } else if name.parse::<f64>().is_ok() {
        "; the first line must name the columns"
    } else if name.starts_with("lat") || name.starts_with("lon") {
        "; give latitude and longitude as GPX"
    } else {
        ""
    }
}

/// Where in a record of the table each column is.
struct Columns {
    x: usize,
    y: usize,
    z: Option<usize>,
    direction: Option<usize>,
    speed: Option<usize>,
    action: Option<usize>,
}

impl Columns {
    fn of(headers: &csv::StringRecord) -> Result<Self, PathError> {
        let at_line_1 = |what: String| PathError::Csv { line: 1, what };
        let allowed = ["x_m", "y_m", "z_m", "direction", "speed_m_s", "action"];
        if let Some(name) = headers.iter().find(|name| !allowed.contains(name)) {
            return Err(at_line_1(format!(
                "column `{name}` is unknown, must be one of {}{}",
                allowed.join(", "),
                likely_cause(name)
            )));
        }
        let twice = allowed
            .iter()
            .find(|name| headers.iter().filter(|header| header == *name).count() > 1);
        if let Some(name) = twice {
            return Err(at_line_1(format!("column `{name}` occurs twice")));
        }
        let find = |name: &str| headers.iter().position(|header| header == name);
        let need =
            |name: &str| find(name).ok_or_else(|| at_line_1(format!("column `{name}` is missing")));
        Ok(Self {
            x: need("x_m")?,
            y: need("y_m")?,
            z: find("z_m"),
            direction: find("direction"),
            speed: find("speed_m_s"),
            action: find("action"),
        })
    }

    fn point(&self, record: &csv::StringRecord) -> Result<RawPoint, PathError> {
        let line = line(record);
        let number = |column: usize, name: &str| {
            let text = record.get(column).unwrap_or_default();
            finite(text).ok_or_else(|| PathError::Csv {
                line,
                what: format!(
                    "{name}: `{text}` is not a finite number{}",
                    likely_mistake(text)
                ),
            })
        };
        let direction = match self.direction.and_then(|column| record.get(column)) {
            None | Some("") => None,
            Some("forward") => Some(Direction::Forward),
            Some("reverse") => Some(Direction::Reverse),
            Some(text) => {
                return Err(PathError::Csv {
                    line,
                    what: format!("direction: `{text}` is unknown, must be forward or reverse"),
                });
            }
        };
        Ok(RawPoint {
            position: Point2 {
                x_m: number(self.x, "x_m")?,
                y_m: number(self.y, "y_m")?,
            },
            elevation_m: self.z.map(|column| number(column, "z_m")).transpose()?,
            direction,
            speed_m_s: None,
        })
    }

    /// Returns the speed that a row gives, m/s.
    fn speed(&self, record: &csv::StringRecord) -> Result<Option<f64>, PathError> {
        let Some(text) = field(record, self.speed) else {
            return Ok(None);
        };
        let refused = |why: &str| PathError::Csv {
            line: line(record),
            what: format!(
                "speed_m_s: `{text}` {why}; leave it empty to go on at the speed of the row before"
            ),
        };
        let speed_m_s = finite(text).ok_or_else(|| refused("is not a finite number"))?;
        if speed_m_s == 0.0 {
            return Err(refused(
                "would let the vehicle stand, it must be 0.01 m/s at least",
            ));
        }
        if ROUTE_SPEEDS.check("speed_m_s", speed_m_s).is_err() {
            return Err(refused("must be from 0.01 to 20 m/s"));
        }
        Ok(Some(speed_m_s))
    }

    /// Returns the action that a row gives.
    fn action(&self, record: &csv::StringRecord) -> Result<Option<String>, PathError> {
        let Some(text) = field(record, self.action) else {
            return Ok(None);
        };
        let count = text.chars().count();
        let what = if count > ACTION_MAX {
            format!(
                "action: the text has {count} characters, at most {ACTION_MAX} are allowed; give a name, and what it \
                 means to the program that acts"
            )
        } else if text.chars().any(char::is_control) {
            "action: the text has a line break or another control character; write it on one line"
                .to_owned()
        } else {
            return Ok(Some(text.to_owned()));
        };
        Err(PathError::Csv {
            line: line(record),
            what,
        })
    }
}

/// Returns what a row has in a column, unless that is empty.
fn field(record: &csv::StringRecord, column: Option<usize>) -> Option<&str> {
    record.get(column?).filter(|text| !text.is_empty())
}

fn line(record: &csv::StringRecord) -> u64 {
    record.position().map_or(0, csv::Position::line)
}

fn csv_error(error: csv::Error) -> PathError {
    match error.kind() {
        csv::ErrorKind::Io(io) => PathError::Read(io.to_string()),
        csv::ErrorKind::UnequalLengths {
            pos,
            expected_len,
            len,
        } => PathError::Csv {
            line: pos.as_ref().map_or(0, csv::Position::line),
            what: format!(
                "{len} fields, but the header names {expected_len}; fields are separated by commas, so \
                 write decimals with a point (12.5, not 12,5)"
            ),
        },
        _ => PathError::Csv {
            line: error.position().map_or(1, csv::Position::line),
            what: error.to_string(),
        },
    }
}
