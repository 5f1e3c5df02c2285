//! Commands and measured speeds of the drives from CSV.

use super::columns::{ColumnMap, CommandColumns};
use super::read::{Fields, check_header, csv_error, position, without_byte_order_mark};
use super::{LogError, Note, ROWS_MAX, check_command};
use crate::speeds::{
    EncoderScale, MeasuredMotorSpeeds, MeasuredTreadSpeeds, MotorSpeeds, TreadSpeeds,
};
use csv::{ReaderBuilder, StringRecord, Trim};
use std::io::Read;

/// Speeds of both motors at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimedSpeeds {
    /// Instant, s.
    pub time_s: f64,
    /// Speeds, m/s.
    pub speeds: MotorSpeeds,
}

/// Commands and measured speeds of a drive, each in the order of time.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct DriveRecord {
    /// Commands; each holds until the next.
    pub commands: Vec<TimedSpeeds>,
    /// Measured speeds.
    pub measured: Vec<TimedSpeeds>,
}

/// Returns commands and measured speeds of a log in CSV with the columns of `map`, both as drives count them, or both
/// effective by `scale` where the map has commands of the motors. Empty fields are no command or no measurement.
///
/// Speeds that repeat a time are left out, which the note says.
///
/// # Errors
/// Names the row and column at fault.
pub fn read_commands(
    source: impl Read,
    map: &ColumnMap,
    scale: &EncoderScale,
) -> Result<(DriveRecord, Option<Note>), LogError> {
    let mut reader = ReaderBuilder::new().trim(Trim::All).from_reader(source);
    let header = without_byte_order_mark(reader.headers().map_err(csv_error)?);
    check_header(&header)?;
    let find = |name: &String| position(&header, name);
    let time = find(&map.time)?;
    let speeds = [find(&map.tread_speed_left)?, find(&map.tread_speed_right)?];
    let commands = command_columns(&header, map);
    let columns = match &commands {
        CommandColumns::Treads { left, right, .. } => [find(left)?, find(right)?],
        CommandColumns::Motors { traction, steer } => [find(traction)?, find(steer)?],
        CommandColumns::Twist {
            forward, yaw_rate, ..
        } => [find(forward)?, find(yaw_rate)?],
    };
    let [left_scale, right_scale] = map
        .reversed
        .signs()
        .map(|sign| sign * map.tread_speed_scale);
    let mut record = DriveRecord::default();
    let mut repeated = 0;
    let mut before_s = f64::NEG_INFINITY;
    for (index, row) in reader.records().enumerate() {
        let row = row.map_err(csv_error)?;
        let row_number = index + 1;
        if row_number > ROWS_MAX {
            return Err(LogError::TooLong { rows_max: ROWS_MAX });
        }
        let fields = Fields {
            record: &row,
            header: &header,
            row_number,
        };
        let time_s = fields.number(time)?;
        if !time_s.is_finite() {
            return Err(fields.not_a_number(time));
        }
        if time_s < before_s {
            return Err(LogError::TimeNotRising {
                row_number,
                time_s,
                before_s,
            });
        }
        before_s = time_s;
        let pair = |columns: [usize; 2]| -> Result<Option<[f64; 2]>, LogError> {
            if columns.iter().any(|column| fields.all_empty(&[*column])) {
                return Ok(None);
            }
            Ok(Some([
                fields.number(columns[0])?,
                fields.number(columns[1])?,
            ]))
        };
        let checked = |speeds: MotorSpeeds| {
            check_command(&speeds, time_s)
                .map_err(|reason| LogError::OutOfRange { row_number, reason })?;
            Ok(TimedSpeeds { time_s, speeds })
        };
        if let Some(pair) = pair(columns)? {
            let command = checked(commands.motors(pair))?;
            if !repeats(&record.commands, time_s) {
                record.commands.push(command);
            }
        }
        if let Some([left, right]) = pair(speeds)? {
            let treads = MeasuredTreadSpeeds {
                left_m_s: left_scale * left,
                right_m_s: right_scale * right,
            };
            let motors = match commands {
                CommandColumns::Motors { .. } => scale.apply(treads).into(),
                _ => as_counted(treads),
            };
            let measured = checked(motors)?;
            if repeats(&record.measured, time_s) {
                repeated += 1;
            } else {
                record.measured.push(measured);
            }
        }
    }
    let (count, rows) = (repeated, repeated + record.measured.len());
    if count > 0 && 2 * count >= rows {
        return Err(LogError::CoarseTime { count, rows });
    }
    let note = (count > 0).then_some(Note::RepeatedTimes { count, rows });
    Ok((record, note))
}

fn repeats(before: &[TimedSpeeds], time_s: f64) -> bool {
    before.last().is_some_and(|last| last.time_s == time_s)
}

/// Returns the speeds of the motors as encoders count them.
pub fn as_counted(treads: MeasuredTreadSpeeds) -> MotorSpeeds {
    let motors = MeasuredMotorSpeeds::from(treads);
    MotorSpeeds {
        traction_m_s: motors.traction_m_s,
        steer_m_s: motors.steer_m_s,
    }
}

/// Returns the columns that the map names, otherwise those of this program's logs that are there.
fn command_columns(header: &StringRecord, map: &ColumnMap) -> CommandColumns {
    if let Some(commands) = &map.commands {
        return commands.clone();
    }
    let motors = CommandColumns::Motors {
        traction: "command_traction_m_s".to_owned(),
        steer: "command_steer_m_s".to_owned(),
    };
    match &motors {
        CommandColumns::Motors { traction, .. } if position(header, traction).is_ok() => motors,
        _ => CommandColumns::Treads {
            left: "command_left_m_s".to_owned(),
            right: "command_right_m_s".to_owned(),
            scale: 1.0,
        },
    }
}

impl CommandColumns {
    /// Returns the motors' speeds of the values of both columns.
    fn motors(&self, [first, second]: [f64; 2]) -> MotorSpeeds {
        match *self {
            Self::Treads { scale, .. } => TreadSpeeds {
                left_m_s: scale * first,
                right_m_s: scale * second,
            }
            .into(),
            Self::Motors { .. } => MotorSpeeds {
                traction_m_s: first,
                steer_m_s: second,
            },
            Self::Twist { track_width_m, .. } => MotorSpeeds {
                traction_m_s: first,
                steer_m_s: 0.5 * track_width_m * second,
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_support::motors;

    const SCALE: EncoderScale = EncoderScale {
        left: 1.1,
        right: 1.1,
    };

    fn read(text: &str, map: &str) -> Result<DriveRecord, LogError> {
        read_with_note(text, map).map(|(record, _)| record)
    }

    fn read_with_note(text: &str, map: &str) -> Result<(DriveRecord, Option<Note>), LogError> {
        let map = if map.is_empty() {
            ColumnMap::default()
        } else {
            serde_yaml::from_str(&format!(
                "time: t\ntread_speed_left: l\ntread_speed_right: r\ntread_speed_scale: 0.5\nattitude: {{kind: level}}\ncommands: {map}"
            ))
            .unwrap()
        };
        read_commands(text.as_bytes(), &map, &SCALE)
    }

    #[test]
    fn columns_of_treads_motors_and_twists_mean_the_same() {
        let treads = read(
            "t,l,r,a,b\n0,0.6,1.0,2,4\n0.1,,,,\n0.2,0.6,1.0,2,4\n",
            "{kind: treads, left: a, right: b, scale: 0.1}",
        )
        .unwrap();
        let close = |a: MotorSpeeds, b: MotorSpeeds| {
            (a.traction_m_s - b.traction_m_s).abs() + (a.steer_m_s - b.steer_m_s).abs() < 1e-12
        };
        assert_eq!((treads.commands.len(), treads.measured.len()), (2, 2));
        assert!(close(treads.commands[1].speeds, motors(0.3, 0.1)));
        assert!(close(treads.measured[1].speeds, motors(0.4, 0.1)));
        assert_eq!(treads.measured[1].time_s, 0.2);
        let twist = read(
            "t,l,r,a,b\n0,0.6,1.0,0.3,0.1\n",
            "{kind: twist, forward: a, yaw_rate: b, track_width_m: 2}",
        )
        .unwrap();
        assert!(close(twist.commands[0].speeds, motors(0.3, 0.1)));
        // Commands of the motors are effective, and so are the speeds then.
        let own = read(
            "time_s,v_left_m_s,v_right_m_s,command_traction_m_s,command_steer_m_s\n0,0.3,0.5,0.3,0.1\n",
            "",
        )
        .unwrap();
        assert!(close(own.commands[0].speeds, motors(0.3, 0.1)));
        assert!(close(own.measured[0].speeds, motors(0.44, 0.11)));
    }

    #[test]
    fn a_log_without_commands_or_with_a_bad_one_is_refused() {
        let message = |text: &str| read(text, "").unwrap_err().to_string();
        let missing = message("time_s,v_left_m_s,v_right_m_s\n0,0,0\n");
        assert!(missing.contains("no column command_left_m_s"), "{missing}");
        let header = "time_s,v_left_m_s,v_right_m_s,command_left_m_s,command_right_m_s\n";
        let far = message(&format!("{header}0,0,0,0,0\n1,0,0,400,0\n"));
        assert!(far.contains("row 2") && far.contains("m/s"), "{far}");
        let back = message(&format!("{header}1,0,0,0,0\n0.5,0,0,0,0\n"));
        assert!(
            back.contains("row 2") && back.contains("goes back"),
            "{back}"
        );
        let coarse = message(&format!("{header}1,0,0,0,0\n1,0,0,0,0\n"));
        assert!(coarse.contains("more decimals"), "{coarse}");
    }

    #[test]
    fn rows_of_one_sensor_each_and_a_side_that_counts_backwards_are_read() {
        let (record, note) = read_with_note(
            "t,l,r,a,b\n0,0.6,-1.0,,\n0,nan,nan,2,4\n0.1,0.6,-1.0,,\n0.1,9,9,,\n0.2,0.6,-1.0,,\n",
            "{kind: treads, left: a, right: b, scale: 0.1}\nreversed: right",
        )
        .unwrap();
        assert_eq!((record.commands.len(), record.measured.len()), (1, 3));
        let speeds = record.measured[1].speeds;
        assert!((speeds.traction_m_s - 0.4).abs() < 1e-12, "{speeds:?}");
        assert!((speeds.steer_m_s - 0.1).abs() < 1e-12, "{speeds:?}");
        assert_eq!(note, Some(Note::RepeatedTimes { count: 1, rows: 4 }));
    }
}
