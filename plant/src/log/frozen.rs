//! Readings of a log that stay the same to the bit while the vehicle moves.

use super::{LogRow, Suspicion};

/// Shortest time that is told, s: poses may come once in a second or two, and a log may repeat them.
const TIME_MIN_S: f64 = 2.5;
/// Least way of the treads while the poses stay, m.
const WAY_MIN_M: f64 = 1.0;
/// Time over which a speed is taken from poses, s.
const WINDOW_S: f64 = 1.0;
/// Speed by the poses from which on they say something, m/s.
const SPEED_MIN_M_S: f64 = 0.3;

/// Returns the longest time in which poses stay while the treads turn.
pub(super) fn poses(rows: &[LogRow]) -> Option<Suspicion> {
    let posed: Vec<&LogRow> = rows.iter().filter(|row| row.pose.is_some()).collect();
    let stays = posed.chunk_by(|row, next| row.pose == next.pose);
    let treads_turn = |from: &LogRow, to: &LogRow| {
        let after = |time_s: f64| rows.partition_point(|row| row.time_s <= time_s);
        let during = &rows[after(from.time_s)..after(to.time_s)];
        let speeds = during
            .iter()
            .map(|row| 0.5 * (row.speeds.left_m_s + row.speeds.right_m_s));
        let mean_m_s = speeds.map(f64::abs).sum::<f64>() / during.len() as f64;
        let treads_m = mean_m_s * (to.time_s - from.time_s);
        (treads_m > WAY_MIN_M).then_some(Suspicion::PosesFrozen {
            from_s: from.time_s,
            to_s: to.time_s,
            treads_m,
        })
    };
    let found = stays.filter_map(|run| {
        let (from, to) = (run[0], run[run.len() - 1]);
        let time_s = to.time_s - from.time_s;
        let found = (time_s > TIME_MIN_S).then(|| treads_turn(from, to))??;
        Some((time_s, found))
    });
    longest(found)
}

/// Returns the longest time in which the speeds of both treads stay while the vehicle gets much slower or faster.
pub(super) fn speeds(rows: &[LogRow]) -> Option<Suspicion> {
    let stays = rows.chunk_by(|row, next| row.speeds == next.speeds);
    let found = stays.filter_map(|run| {
        let (from_s, to_s) = (run[0].time_s, run[run.len() - 1].time_s);
        if to_s - from_s <= TIME_MIN_S {
            return None;
        }
        let (slowest_m_s, fastest_m_s) = speed_range(run)?;
        let changes = fastest_m_s > SPEED_MIN_M_S && slowest_m_s < 0.5 * fastest_m_s;
        changes.then_some((
            to_s - from_s,
            Suspicion::SpeedsFrozen {
                from_s,
                to_s,
                slowest_m_s,
                fastest_m_s,
            },
        ))
    });
    longest(found)
}

/// Returns the least and the largest speed by the poses.
fn speed_range(rows: &[LogRow]) -> Option<(f64, f64)> {
    let mut posed = rows.iter().filter_map(|row| Some((row.time_s, row.pose?)));
    let (mut from_s, mut from) = posed.next()?;
    let mut range: Option<(f64, f64)> = None;
    for (time_s, pose) in posed {
        let duration_s = time_s - from_s;
        if duration_s >= WINDOW_S {
            let speed_m_s = (pose.x_m - from.x_m).hypot(pose.y_m - from.y_m) / duration_s;
            let (low, high) = range.unwrap_or((speed_m_s, speed_m_s));
            range = Some((low.min(speed_m_s), high.max(speed_m_s)));
            (from_s, from) = (time_s, pose);
        }
    }
    range
}

fn longest(found: impl Iterator<Item = (f64, Suspicion)>) -> Option<Suspicion> {
    found
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, suspicion)| suspicion)
}
