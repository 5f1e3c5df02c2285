//! Values between two times of a bag.

use sidehill_plant::log::sources;

/// Values by their times, ns.
pub(super) type Timed<T> = sources::TimedValues<i64, T>;

/// Returns the time from one to another, s.
pub(super) fn seconds(from_ns: i64, to_ns: i64) -> f64 {
    // Damaged times may be farther apart than their type counts.
    (i128::from(to_ns) - i128::from(from_ns)) as f64 * 1e-9
}

/// Orders values by time; of two at one time the later in the bag stays.
pub(super) fn order<T>(values: &mut Timed<T>) {
    values.reverse();
    values.sort_by_key(|(time_ns, _)| *time_ns);
    values.dedup_by_key(|(time_ns, _)| *time_ns);
}

/// Returns the values ordered by time; of two at the same time, the later in the bag.
pub(super) fn in_order<T>(mut values: Timed<T>) -> Timed<T> {
    order(&mut values);
    values
}

/// Returns the value at a time, as [`sources::at`] does.
pub(super) fn at<T: Copy>(
    values: &[(i64, T)],
    time_ns: i64,
    between: impl Fn(&T, &T, f64) -> T,
) -> Option<T> {
    sources::at(values, time_ns, seconds, between)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_of_a_damaged_bag_may_be_far_apart() {
        assert!((seconds(i64::MIN, i64::MAX) - 1.844_674_407e10).abs() < 100.0);
        assert_eq!(seconds(2_000_000_000, 1_500_000_000), -0.5);
    }
}
