//! Values between two times of a bag.

use sidehill_plant::log::sources;

/// Values by their times, ns.
pub(super) type Timed<T> = sources::Timed<i64, T>;

/// Returns the time from one to another, s.
pub(super) fn seconds(from_ns: i64, to_ns: i64) -> f64 {
    (to_ns - from_ns) as f64 * 1e-9
}

/// Returns the value at a time, as [`sources::at`] does.
pub(super) fn at<T: Copy>(
    values: &[(i64, T)],
    time_ns: i64,
    between: impl Fn(&T, &T, f64) -> T,
) -> Option<T> {
    sources::at(values, time_ns, seconds, between)
}
