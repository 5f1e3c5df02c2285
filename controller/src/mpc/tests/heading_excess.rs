//! What follows from settings alone.

use super::*;

#[test]
fn headings_far_from_the_path_count_more_up_to_three_times_the_free_error() {
    let excess = HeadingExcess {
        free_rad: 0.4,
        per_rad2: 7.0,
    };
    for (error_rad, weight) in [
        (0.0, 0.0),
        (0.4, 0.0),
        (0.6, 7.0 / 4.0),
        (-0.8, 7.0),
        (1.0, 7.0 * 2.25),
        (1.2, 28.0),
        (-3.0, 28.0),
    ] {
        let found = excess.weight(error_rad);
        assert!((found - weight).abs() < 1e-9, "{error_rad}: {found}");
    }
}
