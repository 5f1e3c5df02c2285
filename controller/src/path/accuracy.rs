//! How accurate recorded points are, and which of them are one place.

use super::{Point2, RawPoint};

/// Points from which an accuracy can be estimated, at least.
const POINTS_MIN: usize = 20;
/// Points farther apart than this on average show the bends of the way rather than their noise, m.
const SPACING_MAX_M: f64 = 1.5;
/// Below this points are exact: their last decimals are rounded.
const EXACT_M: f64 = 5e-4;
/// Standard deviations within which points are one place: fewer than one in a thousand is farther from it.
const PLACE_SIGMAS: f64 = 4.0;
/// Points that may be looked ahead for the place to go on.
const LOOK_AHEAD: usize = 3;

/// Returns the standard deviation of points in each direction, m, as they show it themselves; 0 for points that are
/// exact or too few to say.
///
/// It is the median over all points of the third divided difference across the direction of travel, which is 0 on
/// parabolas, scaled to have the variance of the points' noise where that is white. Slow drift does not count.
pub(super) fn estimate(points: &[(usize, RawPoint)]) -> f64 {
    if points.len() < POINTS_MIN {
        return 0.0;
    }
    let legs_m = points
        .windows(2)
        .map(|pair| pair[0].1.position.distance_m(&pair[1].1.position));
    if legs_m.sum::<f64>() > SPACING_MAX_M * (points.len() - 1) as f64 {
        return 0.0;
    }
    let mut across_m: Vec<f64> = points.windows(4).map(across_m).collect();
    across_m.sort_by(f64::total_cmp);
    // The median of a normal distribution's magnitude is 0.6745 of its standard deviation.
    let accuracy_m = across_m[across_m.len() / 2] / 0.6745;
    if accuracy_m < EXACT_M {
        0.0
    } else {
        accuracy_m
    }
}

/// Returns the magnitude of the scaled third divided difference of four points across their chord, m; their parameter
/// is the length of the polyline.
fn across_m(four: &[(usize, RawPoint)]) -> f64 {
    let at = |i: usize| four[i].1.position;
    let mut along_m = [0.0; 4];
    for i in 1..4 {
        along_m[i] = along_m[i - 1] + at(i - 1).distance_m(&at(i));
    }
    let (mut x, mut y, mut squares) = (0.0, 0.0, 0.0);
    for i in 0..4 {
        let others = (0..4).filter(|&j| j != i);
        // Scaled by the length, so that tiny distances do not overflow.
        let product: f64 = others
            .map(|j| (along_m[i] - along_m[j]) / along_m[3])
            .product();
        let weight = 1.0 / product;
        x += weight * at(i).x_m;
        y += weight * at(i).y_m;
        squares += weight * weight;
    }
    let (chord_x, chord_y) = (at(3).x_m - at(0).x_m, at(3).y_m - at(0).y_m);
    let chord_m = chord_x.hypot(chord_y);
    let off_m = if chord_m > 0.0 {
        (chord_x * y - chord_y * x).abs() / chord_m
    } else {
        x.hypot(y)
    };
    off_m / squares.sqrt()
}

/// Returns the points with those of one place, such as the ones recorded while standing, made one in its middle.
///
/// The last of them says which way to go on. A single point farther away, after which the place goes on, belongs to it.
/// Where points of the first or last place move on, the way begins or ends at its end instead of its middle.
pub(super) fn places(points: &[(usize, RawPoint)], accuracy_m: f64) -> Vec<(usize, RawPoint)> {
    let reach_m = PLACE_SIGMAS * accuracy_m;
    let mut places: Vec<(usize, RawPoint)> = Vec::with_capacity(points.len());
    let mut begins: Vec<usize> = Vec::with_capacity(points.len());
    let mut count = 0.0;
    for (at, (index, point)) in points.iter().enumerate() {
        if let Some((_, place)) = places.last_mut() {
            let off_m = |point: &RawPoint| point.position.distance_m(&place.position);
            let goes_on = |(_, next): &(usize, RawPoint)| off_m(next) < reach_m;
            let here = off_m(point) < reach_m;
            let ahead = points.iter().skip(at + 1).take(LOOK_AHEAD);
            if here || (off_m(point) < 2.0 * reach_m && ahead.clone().any(goes_on)) {
                place.direction = point.direction.or(place.direction);
                if here {
                    count += 1.0;
                    let Point2 { x_m, y_m } = place.position;
                    place.position = Point2 {
                        x_m: x_m + (point.position.x_m - x_m) / count,
                        y_m: y_m + (point.position.y_m - y_m) / count,
                    };
                }
                continue;
            }
        }
        places.push((*index, *point));
        begins.push(at);
        count = 1.0;
    }
    let count = places.len();
    if count > 1 {
        let first = moved_on(&points[..begins[1]], accuracy_m);
        let last = moved_on(&points[begins[count - 1]..], accuracy_m);
        let shift = |point: &mut RawPoint, [x_m, y_m]: [f64; 2]| {
            point.position.x_m += x_m;
            point.position.y_m += y_m;
        };
        shift(&mut places[0].1, first.map(|m| -m));
        shift(&mut places[count - 1].1, last);
    }
    places
}

/// Returns from the middle to the end of points that move on evenly, m, by the means of their first and of their second
/// half; nothing where noise explains their difference.
fn moved_on(points: &[(usize, RawPoint)], accuracy_m: f64) -> [f64; 2] {
    /// Standard deviations of the difference of the means.
    const SIGMAS: f64 = 3.0;
    let half = points.len() / 2;
    let mean = |points: &[(usize, RawPoint)]| {
        let count = points.len() as f64;
        let sum = points.iter().fold([0.0, 0.0], |[x, y], (_, point)| {
            [x + point.position.x_m, y + point.position.y_m]
        });
        sum.map(|sum| sum / count)
    };
    if half == 0 {
        return [0.0, 0.0];
    }
    let (before, after) = (mean(&points[..half]), mean(&points[points.len() - half..]));
    let moved = [after[0] - before[0], after[1] - before[1]];
    let noise_m = accuracy_m * (2.0 / half as f64).sqrt();
    if moved[0].hypot(moved[1]) > SIGMAS * noise_m {
        // So many points are from mean to mean, and from the middle to the end.
        let (apart, to_end) = (points.len() - half, 0.5 * (points.len() - 1) as f64);
        moved.map(|m| to_end / apart as f64 * m)
    } else {
        [0.0, 0.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::Point2;

    #[test]
    fn a_way_of_even_steps_begins_and_ends_at_its_first_and_last_point() {
        for count in 200..240 {
            let points: Vec<_> = (0..count)
                .map(|index| {
                    let position = Point2 {
                        x_m: 0.01 * index as f64,
                        y_m: 0.0,
                    };
                    (
                        index,
                        RawPoint {
                            position,
                            ..RawPoint::default()
                        },
                    )
                })
                .collect();
            let places = places(&points, 0.03);
            assert!(places.len() < count / 2, "{}", places.len());
            let (first, last) = (places[0].1.position, places[places.len() - 1].1.position);
            assert!(first.x_m.abs() < 1e-9, "{count}: {first:?}");
            // Of few points the noise may be as large as their way.
            let end_m = 0.01 * (count - 1) as f64 - last.x_m;
            assert!((-1e-9..0.06).contains(&end_m), "{count}: {end_m}");
        }
    }
}
