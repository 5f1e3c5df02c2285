//! Readings of a log that stay the same to the bit while the vehicle moves.

use super::LogRow;

/// Shortest time that is told, s: poses may come once in a second or two, and a log may repeat them.
const TIME_MIN_S: f64 = 2.5;
/// Least way of the treads while the poses stay, m.
const WAY_MIN_M: f64 = 1.0;
/// Time over which a speed is taken from poses, s.
const WINDOW_S: f64 = 1.0;
/// Speed from which on a vehicle drives, m/s, and share of it below which it stands. What lies between may be the
/// slope, on which a vehicle that turns with constant treads slides now forward and now backward.
const SPEED_MIN_M_S: f64 = 0.3;
const STANDING_SHARE: f64 = 0.1;

/// A time in which readings stay, with what the other readings say of it.
pub(super) struct Frozen<T> {
    pub(super) from_s: f64,
    pub(super) to_s: f64,
    pub(super) meanwhile: T,
}

/// Returns the longest time in which poses stay while the treads turn, with the way of the treads, m.
pub(super) fn poses(rows: &[LogRow]) -> Option<Frozen<f64>> {
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
        (treads_m > WAY_MIN_M).then_some(treads_m)
    };
    longest(stays.filter_map(|run| {
        let (from, to) = (run[0], run[run.len() - 1]);
        lasting(from, to, || treads_turn(from, to))
    }))
}

/// Returns the longest time in which the speeds of both treads stay while the vehicle stops or sets off, with its least and
/// its largest speed by the poses, m/s.
pub(super) fn speeds(rows: &[LogRow]) -> Option<Frozen<(f64, f64)>> {
    let stays = rows.chunk_by(|row, next| row.speeds == next.speeds);
    let changes = |(slowest, fastest): &(f64, f64)| {
        *fastest > SPEED_MIN_M_S && *slowest < STANDING_SHARE * fastest
    };
    longest(stays.filter_map(|run| {
        lasting(&run[0], &run[run.len() - 1], || {
            speed_range(run).filter(changes)
        })
    }))
}

/// Returns the time between two rows if it lasts long enough and there is something to say of it.
fn lasting<T>(
    from: &LogRow,
    to: &LogRow,
    meanwhile: impl FnOnce() -> Option<T>,
) -> Option<Frozen<T>> {
    if to.time_s - from.time_s <= TIME_MIN_S {
        return None;
    }
    Some(Frozen {
        from_s: from.time_s,
        to_s: to.time_s,
        meanwhile: meanwhile()?,
    })
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

fn longest<T>(found: impl Iterator<Item = Frozen<T>>) -> Option<Frozen<T>> {
    found.max_by(|a, b| (a.to_s - a.from_s).total_cmp(&(b.to_s - b.from_s)))
}
