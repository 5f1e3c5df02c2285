//! Rows of a log from sources with different times.

use super::{GAP_MAX_S, LogRow};
use crate::frames::{Attitude, Pose};
use crate::speeds::MeasuredTreadSpeeds;

/// Values by their times, which are seconds or a count of ticks.
pub type TimedValues<K, T> = Vec<(K, T)>;

/// The sources of a log, each in the order of its times, without two values at one time.
#[derive(Debug, Clone, PartialEq)]
pub struct Sources<K> {
    /// Tread speeds as measured.
    pub tread_speeds: TimedValues<K, MeasuredTreadSpeeds>,
    /// Roll and pitch; none if the ground was level.
    pub attitudes: Option<TimedValues<K, Attitude>>,
    /// Poses.
    pub poses: TimedValues<K, Pose>,
}

impl<K: Copy + PartialOrd> Sources<K> {
    /// Returns a row at each time of a tread speed and of a pose, with the time itself, and how many such times are
    /// left out because another source is silent there for more than [`GAP_MAX_S`].
    ///
    /// Other sources are interpolated. Times of the rows count from the first one; `seconds` is from its first time
    /// to its second, s.
    pub fn rows(&self, seconds: impl Fn(K, K) -> f64) -> (Vec<(K, LogRow)>, usize) {
        let speed_times = self.tread_speeds.iter().map(|(time, _)| *time);
        let pose_times = self.poses.iter().map(|(time, _)| *time);
        let mut times: Vec<K> = speed_times.chain(pose_times).collect();
        times.sort_by(|a, b| a.partial_cmp(b).unwrap_or(std::cmp::Ordering::Equal));
        times.dedup_by(|a, b| a == b);
        let mut rows: Vec<(K, LogRow)> = Vec::with_capacity(times.len());
        let mut start = None;
        for &time in &times {
            let speeds = at(&self.tread_speeds, time, &seconds, between_speeds);
            let attitude = match &self.attitudes {
                Some(attitudes) => at(attitudes, time, &seconds, between_attitudes),
                None => Some(Attitude::LEVEL),
            };
            let (Some(speeds), Some(attitude)) = (speeds, attitude) else {
                continue;
            };
            let pose = self.poses.partition_point(|(at, _)| *at < time);
            let pose = self.poses.get(pose).filter(|(at, _)| *at == time);
            let row = LogRow {
                time_s: seconds(*start.get_or_insert(time), time),
                speeds,
                attitude,
                pose: pose.map(|(_, pose)| *pose),
            };
            rows.push((time, row));
        }
        let left_out = times.len() - rows.len();
        (rows, left_out)
    }
}

/// Returns the value at a time, `between` its neighbours where they are at most [`GAP_MAX_S`] apart.
pub fn at<K: Copy + PartialOrd, T: Copy>(
    values: &[(K, T)],
    time: K,
    seconds: impl Fn(K, K) -> f64,
    between: impl Fn(&T, &T, f64) -> T,
) -> Option<T> {
    let after = values.partition_point(|(at, _)| *at < time);
    let (next_time, next) = values.get(after)?;
    if *next_time == time {
        return Some(*next);
    }
    let (before_time, before) = values.get(after.checked_sub(1)?)?;
    let (part_s, whole_s) = (
        seconds(*before_time, time),
        seconds(*before_time, *next_time),
    );
    (whole_s <= GAP_MAX_S).then(|| between(before, next, part_s / whole_s))
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

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    fn speed(left_m_s: f64) -> MeasuredTreadSpeeds {
        MeasuredTreadSpeeds {
            left_m_s,
            right_m_s: -left_m_s,
        }
    }

    #[test]
    fn rows_stand_at_speeds_and_poses_and_nothing_is_invented_in_gaps() {
        let sources = Sources {
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
        };
        let (rows, left_out) = sources.rows(|from: i64, to| (to - from) as f64 * 1e-9);
        assert_eq!(left_out, 1, "the pose at 105 s");
        let rows: Vec<LogRow> = rows.into_iter().map(|(_, row)| row).collect();
        let times: Vec<f64> = rows.iter().map(|row| row.time_s).collect();
        assert_eq!(times, [0.0, 0.1, 0.2, 10.0]);
        assert!((rows[1].speeds.left_m_s - 1.5).abs() < 1e-12);
        assert!((rows[1].attitude.roll_rad - 0.1).abs() < 1e-12);
        let posed: Vec<bool> = rows.iter().map(|row| row.pose.is_some()).collect();
        assert_eq!(posed, [false, true, false, true]);
    }
}
