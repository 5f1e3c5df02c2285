//! Rows of a log from sources with different times.

use super::Chosen;
use super::interpolation::at;
use super::series::{self, Series};
use crate::bag::Bag;
use anyhow::{Context, Result, bail};
use sidehill_plant::frames::Attitude;
use sidehill_plant::log::{DriveLog, GAP_MAX_S, LogRow};
use sidehill_plant::speeds::MeasuredTreadSpeeds;

/// Returns the log of a bag and notes about what was left out.
///
/// There is a row at each time of a tread speed and of a pose; the other sources are interpolated to it. Times
/// count from the first row, so that they keep their nanoseconds.
pub(super) fn log(bag: &Bag, chosen: &Chosen) -> Result<(DriveLog, Vec<String>)> {
    let series = series::read(bag, chosen)?;
    let name = || bag.path().display().to_string();
    let (rows, left_out) = merge(&series);
    let mut notes = series.notes;
    if rows.len() < 2 {
        let spans = [
            ("tread speeds", span(&series.tread_speeds)),
            ("attitude", series.attitudes.as_deref().and_then(span)),
            ("poses", span(&series.poses)),
        ];
        let spans: Vec<String> = spans
            .into_iter()
            .filter_map(|(source, span)| {
                let (from_s, to_s) = span?;
                Some(format!("{source} from {from_s:.3} to {to_s:.3} s"))
            })
            .collect();
        bail!(
            "{}: tread speeds and attitude have no times in common ({}); with `time: received` in the topic map \
             (--topics) the time of recording counts instead of the stamps",
            name(),
            spans.join(", ")
        );
    }
    if left_out > 0 {
        notes.push(format!(
            "{left_out} of {} rows are left out: another source is silent there for more than {GAP_MAX_S} s",
            left_out + rows.len()
        ));
    }
    let log = DriveLog::new(rows).with_context(name)?;
    Ok((log, notes))
}

fn merge(series: &Series) -> (Vec<LogRow>, usize) {
    let speed_times = series.tread_speeds.iter().map(|(time_ns, _)| *time_ns);
    let pose_times = series.poses.iter().map(|(time_ns, _)| *time_ns);
    let mut times: Vec<i64> = speed_times.chain(pose_times).collect();
    times.sort_unstable();
    times.dedup();
    let mut rows: Vec<LogRow> = Vec::with_capacity(times.len());
    let mut start_ns = None;
    for &time_ns in &times {
        let speeds = at(&series.tread_speeds, time_ns, between_speeds);
        let attitude = match &series.attitudes {
            Some(attitudes) => at(attitudes, time_ns, between_attitudes),
            None => Some(Attitude::LEVEL),
        };
        let (Some(speeds), Some(attitude)) = (speeds, attitude) else {
            continue;
        };
        let start_ns = *start_ns.get_or_insert(time_ns);
        let pose = series.poses.binary_search_by_key(&time_ns, |(at, _)| *at);
        rows.push(LogRow {
            time_s: (time_ns - start_ns) as f64 * 1e-9,
            speeds,
            attitude,
            pose: pose.ok().map(|index| series.poses[index].1),
        });
    }
    let left_out = times.len() - rows.len();
    (rows, left_out)
}

fn between_speeds(
    a: &MeasuredTreadSpeeds,
    b: &MeasuredTreadSpeeds,
    share: f64,
) -> MeasuredTreadSpeeds {
    MeasuredTreadSpeeds {
        left_m_s: a.left_m_s + share * (b.left_m_s - a.left_m_s),
        right_m_s: a.right_m_s + share * (b.right_m_s - a.right_m_s),
    }
}

fn between_attitudes(a: &Attitude, b: &Attitude, share: f64) -> Attitude {
    Attitude {
        roll_rad: a.roll_rad + share * (b.roll_rad - a.roll_rad),
        pitch_rad: a.pitch_rad + share * (b.pitch_rad - a.pitch_rad),
    }
}

fn span<T>(values: &[(i64, T)]) -> Option<(f64, f64)> {
    let seconds = |(time_ns, _): &(i64, T)| *time_ns as f64 * 1e-9;
    Some((seconds(values.first()?), seconds(values.last()?)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_plant::frames::Pose;

    const S: i64 = 1_000_000_000;

    fn speed(left_m_s: f64) -> MeasuredTreadSpeeds {
        MeasuredTreadSpeeds {
            left_m_s,
            right_m_s: -left_m_s,
        }
    }

    #[test]
    fn rows_stand_at_speeds_and_poses_and_nothing_is_invented_in_gaps() {
        let series = Series {
            tread_speeds: vec![
                (100 * S, speed(1.0)),
                (100 * S + S / 5, speed(2.0)),
                // Silent for ten seconds.
                (110 * S, speed(3.0)),
            ],
            attitudes: Some(vec![
                (100 * S, Attitude::LEVEL),
                (
                    100 * S + S / 4,
                    Attitude {
                        roll_rad: 0.25,
                        pitch_rad: 0.0,
                    },
                ),
                (110 * S, Attitude::LEVEL),
            ]),
            poses: vec![
                (100 * S + S / 10, Pose::default()),
                (105 * S, Pose::default()),
                (110 * S, Pose::default()),
            ],
            notes: Vec::new(),
        };
        let (rows, left_out) = merge(&series);
        assert_eq!(left_out, 1, "the pose at 105 s");
        let times: Vec<f64> = rows.iter().map(|row| row.time_s).collect();
        assert_eq!(times, [0.0, 0.1, 0.2, 10.0]);
        assert!((rows[1].speeds.left_m_s - 1.5).abs() < 1e-12);
        assert!((rows[1].attitude.roll_rad - 0.1).abs() < 1e-12);
        let posed: Vec<bool> = rows.iter().map(|row| row.pose.is_some()).collect();
        assert_eq!(posed, [false, true, false, true]);
    }
}
