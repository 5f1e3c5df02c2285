//! Values between two times.

use sidehill_plant::log::GAP_MAX_S;

/// Values by their times, ns.
pub(super) type Timed<T> = Vec<(i64, T)>;

/// Returns the value at a time, between its neighbours where they are at most [`GAP_MAX_S`] apart.
pub(super) fn at<T: Copy>(
    values: &[(i64, T)],
    time_ns: i64,
    between: impl Fn(&T, &T, f64) -> T,
) -> Option<T> {
    let after = values.partition_point(|(at, _)| *at < time_ns);
    let (next_ns, next) = values.get(after)?;
    if *next_ns == time_ns {
        return Some(*next);
    }
    let (before_ns, before) = values.get(after.checked_sub(1)?)?;
    let (part, whole) = (time_ns - before_ns, next_ns - before_ns);
    let near = whole as f64 * 1e-9 <= GAP_MAX_S;
    near.then(|| between(before, next, part as f64 / whole as f64))
}
