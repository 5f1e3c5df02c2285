//! Quantiles, in the one definition that all figures use.

/// Returns the quantile of ascending values by the nearest rank: the `ceil(share n)`-th of `n`
/// values, so always one of them. The median of an even number of values is the lower of the two in
/// the middle. `None` without values.
///
/// ```
/// use sidehill_plant::statistics::quantile;
///
/// let ascending = [1.0, 2.0, 3.0, 4.0];
/// assert_eq!(quantile(&ascending, 0.5), Some(2.0));
/// assert_eq!(quantile(&ascending, 0.95), Some(4.0));
/// assert_eq!(quantile(&[], 0.5), None);
/// ```
pub fn quantile(ascending: &[f64], share: f64) -> Option<f64> {
    let rank = (share * ascending.len() as f64).ceil() as usize;
    ascending.get(rank.max(1) - 1).copied()
}

/// Returns the median as [`quantile`] defines it. `None` without values.
pub fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_unstable_by(f64::total_cmp);
    quantile(&values, 0.5)
}
