//! Reduces recorded positions to a few points that a controller can follow.

use anyhow::{Result, bail};
use sidehill_controller::path::{Point2, RawPoint, Smoothing, estimated_accuracy_m, smooth};

/// Positions nearer than this to the one before are the same place: the vehicle stands.
const STEP_M: f64 = 0.05;
/// Largest distance of two points of the path, m, so that heights and curves are kept.
const SPACING_MAX_M: f64 = 1.0;
/// Least reach of a drive, m.
const LENGTH_MIN_M: f64 = 0.5;
/// Reach of the Gaussian in standard deviations.
const REACH: f64 = 3.0;

/// Standard deviation of the Gaussian along the path that smooths heights, m, where none is given.
const HEIGHT_SMOOTHING_M: f64 = 0.3;
/// Distance from the line between neighbours below which a point is left out, m, where none is given.
pub(crate) const TOLERANCE_M: f64 = 0.02;

/// A path from positions.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Thinned {
    pub(crate) points_m: Vec<[f64; 3]>,
    pub(crate) length_m: f64,
    /// Largest horizontal distance of a recorded position from the path, m.
    pub(crate) deviation_m: f64,
}

/// What the path of a recording is made with.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Making {
    /// Standard deviation of the positions in each direction, m; none to estimate it from them.
    pub(crate) accuracy_m: Option<f64>,
    /// Standard deviation of a Gaussian along the path that smooths it beforehand, m.
    pub(crate) smoothing_m: Option<f64>,
    /// Distance from the line between neighbours below which a point is left out, m.
    pub(crate) tolerance_m: f64,
    /// Largest curvature of the path, 1/m.
    pub(crate) max_curvature_per_m: f64,
}

/// A path that can be driven, from a recording.
#[derive(Debug, Clone)]
pub(crate) struct Made {
    pub(crate) thinned: Thinned,
    /// Standard deviation of the positions, as stated or estimated, m.
    pub(crate) accuracy_m: f64,
    /// The one that the path was smoothed for, m: larger where that alone makes it drivable.
    pub(crate) taken_m: f64,
    /// Where travel turns back.
    pub(crate) cusps: Vec<Point2>,
    /// Where the vehicle turns on the spot.
    pub(crate) corners: Vec<Point2>,
}

/// Distance between positions that cannot have been driven, m, and in usual distances.
const LEAP_M: f64 = 100.0;
const LEAP_TIMES: f64 = 50.0;
/// Distance from the positions that the path may have, m, and in standard deviations of them.
const DEVIATION_M: f64 = 0.5;
const DEVIATION_SIGMAS: f64 = 5.0;
/// Accuracies that are tried where the positions are too rough: from this, m, by this factor, so often.
const ROUGHER_FROM_M: f64 = 0.02;
const ROUGHER: f64 = 1.5;
const ROUGHER_STEPS: i32 = 10;
/// Largest of them that is taken without being stated, m, and in estimated ones.
const ROUGHER_MAX_M: f64 = 0.3;
const ROUGHER_TIMES: f64 = 3.0;
/// Distance between the points of the path before it is thinned, m.
const SAMPLE_M: f64 = 0.1;

/// Returns a path of bounded curvature: as smooth as the accuracy of the positions asks for, and thinned.
///
/// # Errors
/// A position that is not finite or far from the one before, a drive that goes nowhere, or one whose bends are too
/// sharp.
pub(crate) fn drivable(recorded: &[[f64; 3]], making: &Making) -> Result<Made> {
    check_leaps(recorded)?;
    let from_first_m = recorded.iter().map(|at| horizontal(&recorded[0], at));
    let reach_m = from_first_m.fold(0.0, f64::max);
    if reach_m < LENGTH_MIN_M && !recorded.is_empty() {
        bail!(
            "it holds no drive: its positions are within {reach_m:.2} m of the first, at least {LENGTH_MIN_M} m are needed"
        );
    }
    let positions = match making.smoothing_m {
        Some(std_m) => {
            let moving = without_standstill(recorded);
            smoothed(&moving, &distances(&moving), std_m)
        }
        None => recorded.to_vec(),
    };
    let raw: Vec<RawPoint> = positions
        .iter()
        .map(|&[x_m, y_m, _]| RawPoint {
            position: Point2 { x_m, y_m },
            ..RawPoint::default()
        })
        .collect();
    let accuracy_m = match making.accuracy_m {
        Some(accuracy_m) => accuracy_m,
        None => estimated_accuracy_m(&raw)?,
    };
    let with_accuracy = |accuracy_m: f64| {
        let options = Smoothing {
            max_curvature_per_m: making.max_curvature_per_m,
            max_deviation_m: DEVIATION_M.max(DEVIATION_SIGMAS * accuracy_m),
            accuracy_m: Some(accuracy_m),
            ..Smoothing::default()
        };
        smooth(&raw, &options)
    };
    // Noise that drifts looks smaller than it is.
    let rougher = || {
        let accuracies = (1..=ROUGHER_STEPS).map(|step| {
            let rougher_m = accuracy_m.max(ROUGHER_FROM_M) * ROUGHER.powi(step);
            (100.0 * rougher_m).ceil() / 100.0
        });
        accuracies.into_iter().find_map(|rougher_m| {
            let path = with_accuracy(rougher_m).ok()?;
            let is_round = path.path.corners().next().is_none();
            is_round.then_some((rougher_m, path))
        })
    };
    let allowed_m = match making.accuracy_m {
        Some(accuracy_m) => accuracy_m,
        None => ROUGHER_MAX_M.max(ROUGHER_TIMES * accuracy_m),
    };
    let as_stated = with_accuracy(accuracy_m);
    let (taken_m, path) = match as_stated {
        Ok(path) if path.path.corners().next().is_none() => (accuracy_m, path),
        as_stated => match (rougher(), as_stated) {
            // What looks like a corner is noise.
            (Some((taken_m, path)), _) if taken_m <= allowed_m => (taken_m, path),
            (_, Ok(path)) => (accuracy_m, path),
            (Some((needed_m, _)), Err(error)) => {
                bail!("{error}. In `route` --accuracy-m {needed_m} would do")
            }
            (None, Err(error)) => bail!("{error}"),
        },
    };
    let length_m = path.path.length_m();
    let heights = heights(&positions, &path.arc_lengths_m, making.smoothing_m);
    let steps = (length_m / SAMPLE_M).ceil() as usize;
    let mut along_m: Vec<f64> = (0..=steps)
        .map(|i| length_m * i as f64 / steps as f64)
        .collect();
    along_m.extend(path.path.stops_m());
    along_m.sort_by(f64::total_cmp);
    let points: Vec<[f64; 3]> = along_m
        .iter()
        .map(|&at_m| {
            let Point2 { x_m, y_m } = path.path.at(at_m).position;
            [x_m, y_m, height_at(&heights, at_m)]
        })
        .collect();
    let mut kept = vec![0];
    let last = points.len() - 1;
    thin(&points, &along_m, 0, last, making.tolerance_m, &mut kept);
    let points_m: Vec<[f64; 3]> = kept.iter().map(|index| points[*index]).collect();
    let at = |at_m: f64| path.path.at(at_m).position;
    Ok(Made {
        thinned: Thinned {
            length_m,
            deviation_m: deviation(recorded, &points_m),
            points_m,
        },
        accuracy_m,
        taken_m,
        cusps: path.path.cusps_m().map(at).collect(),
        corners: path.path.corners().map(|corner| corner.position).collect(),
    })
}

/// Refuses positions between which nothing can have driven.
fn check_leaps(recorded: &[[f64; 3]]) -> Result<()> {
    let on_earth = |[x_m, y_m, _]: &[f64; 3]| x_m.abs() <= 1e8 && y_m.abs() <= 1e8;
    if let Some(index) = recorded.iter().position(|position| !on_earth(position)) {
        let [x_m, y_m, _] = recorded[index];
        bail!(
            "position {} (x = {x_m:e} m, y = {y_m:e} m) is no place on earth; leave it out of the recording",
            index + 1
        );
    }
    let legs_m = || {
        recorded
            .windows(2)
            .map(|pair| horizontal(&pair[0], &pair[1]))
    };
    let mut sorted: Vec<f64> = legs_m().filter(|leg_m| *leg_m > 0.0).collect();
    sorted.sort_by(f64::total_cmp);
    let usual_m = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
    let leap = legs_m().position(|leg_m| leg_m > LEAP_M.max(LEAP_TIMES * usual_m));
    if let Some(before) = leap {
        let leg_m = horizontal(&recorded[before], &recorded[before + 1]);
        let [x_m, y_m, _] = recorded[before + 1];
        bail!(
            "positions {} and {} are {leg_m:.0} m apart, where {usual_m:.2} m are usual: the fix was lost, is 0, 0, or \
             belongs to another drive; leave position {} (x = {x_m:.1} m, y = {y_m:.1} m) or what follows it out of the \
             recording",
            before + 1,
            before + 2,
            before + 2
        );
    }
    Ok(())
}

/// Returns heights along the path, smoothed: arc length and height, m.
fn heights(positions: &[[f64; 3]], along_m: &[f64], smoothing_m: Option<f64>) -> Vec<[f64; 2]> {
    /// Positions closer than this along the path have one height, m.
    const SAME_M: f64 = 1e-3;
    let mut profile: Vec<[f64; 3]> = Vec::new();
    let mut count = 0.0;
    for (&at_m, position) in along_m.iter().zip(positions) {
        match profile.last_mut() {
            Some(last) if at_m - last[0] < SAME_M => {
                count += 1.0;
                last[2] += (position[2] - last[2]) / count;
            }
            _ => {
                profile.push([at_m, 0.0, position[2]]);
                count = 1.0;
            }
        }
    }
    let at_m: Vec<f64> = profile.iter().map(|point| point[0]).collect();
    let std_m = smoothing_m.unwrap_or(HEIGHT_SMOOTHING_M);
    let smooth = smoothed(&profile, &at_m, std_m);
    at_m.iter()
        .zip(smooth)
        .map(|(at_m, point)| [*at_m, point[2]])
        .collect()
}

fn height_at(heights: &[[f64; 2]], at_m: f64) -> f64 {
    let after = heights.partition_point(|[along_m, _]| *along_m < at_m);
    let [a, b] = [after.saturating_sub(1), after.min(heights.len() - 1)].map(|i| heights[i]);
    let span_m = b[0] - a[0];
    let share = if span_m > 0.0 {
        ((at_m - a[0]) / span_m).clamp(0.0, 1.0)
    } else {
        0.0
    };
    a[1] + share * (b[1] - a[1])
}

fn horizontal(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    (b[0] - a[0]).hypot(b[1] - a[1])
}

fn without_standstill(recorded: &[[f64; 3]]) -> Vec<[f64; 3]> {
    let mut moving: Vec<[f64; 3]> = Vec::new();
    for point in recorded {
        if moving
            .last()
            .is_none_or(|last| horizontal(last, point) >= STEP_M)
        {
            moving.push(*point);
        }
    }
    moving
}

fn distances(points: &[[f64; 3]]) -> Vec<f64> {
    let mut at_m = 0.0;
    let mut distances = vec![0.0];
    for pair in points.windows(2) {
        at_m += horizontal(&pair[0], &pair[1]);
        distances.push(at_m);
    }
    distances
}

/// Returns each point as the weighted mean of its neighbourhood, which is symmetric, so that ends are not pulled
/// inwards.
fn smoothed(points: &[[f64; 3]], distances_m: &[f64], std_m: f64) -> Vec<[f64; 3]> {
    if std_m <= 0.0 {
        return points.to_vec();
    }
    let length_m = distances_m.last().copied().unwrap_or(0.0);
    let mean = |index: usize| {
        let at_m = distances_m[index];
        let reach_m = (REACH * std_m).min(at_m).min(length_m - at_m) + 1e-9;
        let first = distances_m.partition_point(|d| *d < at_m - reach_m);
        let (mut total, mut sum) = (0.0, [0.0; 3]);
        for near in first..points.len() {
            if distances_m[near] > at_m + reach_m {
                break;
            }
            // Each point stands for its stretch of the path.
            let before_m = distances_m[near.saturating_sub(1)];
            let behind_m = distances_m[(near + 1).min(points.len() - 1)];
            let far = (distances_m[near] - at_m) / std_m;
            let weight = (-0.5 * far * far).exp() * (behind_m - before_m);
            total += weight;
            for (sum, value) in sum.iter_mut().zip(points[near]) {
                *sum += weight * value;
            }
        }
        sum.map(|value| value / total)
    };
    (0..points.len()).map(mean).collect()
}

/// Adds the points from behind `first` to `last` that the path needs (Douglas and Peucker).
fn thin(
    points: &[[f64; 3]],
    distances_m: &[f64],
    first: usize,
    last: usize,
    tolerance_m: f64,
    kept: &mut Vec<usize>,
) {
    // An explicit stack, because recursion over an hour's recording would be deep.
    let mut open = vec![(first, last)];
    while let Some((first, last)) = open.pop() {
        let far = (first + 1..last)
            .map(|index| {
                (
                    index,
                    from_segment(&points[index], &points[first], &points[last]),
                )
            })
            .max_by(|a, b| a.1.total_cmp(&b.1));
        let split = match far {
            Some((index, distance)) if distance > tolerance_m => Some(index),
            Some(_) if distances_m[last] - distances_m[first] > SPACING_MAX_M => {
                let middle_m = 0.5 * (distances_m[first] + distances_m[last]);
                let middle = distances_m.partition_point(|d| *d < middle_m);
                Some(middle.clamp(first + 1, last - 1))
            }
            _ => None,
        };
        match split {
            Some(index) => {
                open.push((index, last));
                open.push((first, index));
            }
            None => kept.push(last),
        }
    }
}

/// Returns the horizontal distance of a point from the line between two others.
fn from_segment(point: &[f64; 3], a: &[f64; 3], b: &[f64; 3]) -> f64 {
    let along = [b[0] - a[0], b[1] - a[1]];
    let square = along[0] * along[0] + along[1] * along[1];
    let share = if square > 0.0 {
        let dot = (point[0] - a[0]) * along[0] + (point[1] - a[1]) * along[1];
        (dot / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    let foot = [a[0] + share * along[0], a[1] + share * along[1], 0.0];
    horizontal(point, &foot)
}

/// Returns the largest distance of a recorded position from the path, each compared with the part of the path it
/// belongs to by order, so that a crossing does not hide an error.
fn deviation(recorded: &[[f64; 3]], path: &[[f64; 3]]) -> f64 {
    /// Segments looked ahead, beyond the way from the position before.
    const AHEAD: usize = 8;
    let along_m = distances(path);
    let mut at = 0;
    let mut before = recorded.first();
    let mut largest = 0.0_f64;
    for point in recorded {
        let leg_m = before.map_or(0.0, |before| horizontal(before, point));
        before = Some(point);
        let reached = along_m.partition_point(|at_m| *at_m < along_m[at] + leg_m);
        let ahead = at..(reached + AHEAD).min(path.len() - 1);
        let nearest = ahead
            .map(|index| (index, from_segment(point, &path[index], &path[index + 1])))
            .min_by(|a, b| a.1.total_cmp(&b.1));
        if let Some((index, distance)) = nearest {
            at = index;
            largest = largest.max(distance);
        }
    }
    largest
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A circle of 10 m radius that climbs, at 5 cm, with noise of 2 cm to both sides in turn and a stop.
    fn circle() -> Vec<[f64; 3]> {
        let mut points = Vec::new();
        for i in 0..1000 {
            let angle = 0.005 * f64::from(i);
            let radius = 10.0 + if i % 2 == 0 { 0.02 } else { -0.02 };
            let point = [
                radius * angle.cos(),
                radius * angle.sin(),
                0.01 * f64::from(i),
            ];
            points.extend(std::iter::repeat_n(point, if i == 500 { 200 } else { 1 }));
        }
        points
    }

    #[test]
    fn noise_goes_and_the_curve_and_its_height_stay() {
        let recorded = circle();
        let path = drivable(&recorded, &MAKING).unwrap().thinned;
        assert!(path.points_m.len() < 120, "{}", path.points_m.len());
        for point in &path.points_m[1..path.points_m.len() - 1] {
            let radius = point[0].hypot(point[1]);
            // At its ends a path is straight, over little more than the smoothing reaches.
            let from_end_m =
                horizontal(point, &recorded[0]).min(horizontal(point, &recorded[1198]));
            let off_m = if from_end_m < 4.0 { 0.04 } else { 0.015 };
            assert!((radius - 10.0).abs() < off_m, "{point:?}");
        }
        assert!((path.length_m - 49.95).abs() < 0.3, "{}", path.length_m);
        // The first place is the middle of those that the noise cannot tell apart.
        assert!(horizontal(&path.points_m[0], &recorded[0]) < 0.15);
        assert!((path.points_m.last().unwrap()[2] - 9.99).abs() < 0.05);
        let largest = recorded
            .iter()
            .map(|point| {
                let pairs = path.points_m.windows(2);
                let distances = pairs.map(|pair| from_segment(point, &pair[0], &pair[1]));
                distances.fold(f64::INFINITY, f64::min)
            })
            .fold(0.0, f64::max);
        assert!(
            (path.deviation_m - largest).abs() < 1e-9,
            "{} {largest}",
            path.deviation_m
        );
        assert!(
            (0.02..0.1).contains(&path.deviation_m),
            "{}",
            path.deviation_m
        );
    }

    #[test]
    fn fixes_far_apart_are_as_near_to_their_path_as_it_says() {
        let recorded: Vec<[f64; 3]> = (0..6).map(|i| [0.0, 50.0 * f64::from(i), 0.0]).collect();
        let path = drivable(&recorded, &MAKING).unwrap().thinned;
        assert!(path.deviation_m < 1.0, "{}", path.deviation_m);
    }

    const MAKING: Making = Making {
        accuracy_m: None,
        smoothing_m: None,
        tolerance_m: 0.02,
        max_curvature_per_m: 1.0,
    };

    /// A way of 30 m with a bend, a fix each 0.9 m, noise of that many metres to both sides in turn and along.
    fn rough(noise_m: f64) -> Vec<[f64; 3]> {
        let mut random = 7_u32;
        let mut noise = || {
            random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            noise_m * 3.46 * (f64::from(random) / f64::from(u32::MAX) - 0.5)
        };
        (0..34)
            .map(|i| {
                let at_m = 0.9 * f64::from(i);
                let bend_m = 3.0 * (0.1 * at_m).sin();
                [bend_m + noise(), at_m + noise(), 50.0]
            })
            .collect()
    }

    #[test]
    fn what_is_made_of_rough_fixes_can_be_driven_or_the_option_that_helps_is_named() {
        for noise_m in [0.005, 0.05, 0.2, 0.5, 1.0] {
            let recorded = rough(noise_m);
            let made = drivable(&recorded, &MAKING).or_else(|error| {
                let text = error.to_string();
                let (_, rest) = text
                    .split_once("--accuracy-m ")
                    .unwrap_or_else(|| panic!("{noise_m}: {text}"));
                let accuracy_m = Some(rest.split(' ').next().unwrap().parse().unwrap());
                drivable(
                    &recorded,
                    &Making {
                        accuracy_m,
                        ..MAKING
                    },
                )
            });
            let made = made.unwrap();
            let raw: Vec<RawPoint> = made
                .thinned
                .points_m
                .iter()
                .map(|&[x_m, y_m, z_m]| RawPoint {
                    position: Point2 { x_m, y_m },
                    elevation_m: Some(z_m),
                    ..RawPoint::default()
                })
                .collect();
            let driven = smooth(&raw, &Smoothing::default()).unwrap().path;
            assert_eq!(driven.cusps_m().count(), 0, "{noise_m}");
            assert!(
                (driven.length_m() - 31.0).abs() < 3.0 + 2.0 * noise_m,
                "{}",
                driven.length_m()
            );
            assert!(
                made.thinned
                    .points_m
                    .iter()
                    .all(|point| (point[2] - 50.0).abs() < 1e-6)
            );
        }
    }

    #[test]
    fn positions_that_nothing_drove_are_refused() {
        let refusal = |points: &[[f64; 3]]| drivable(points, &MAKING).unwrap_err().to_string();
        let mut lost = rough(0.01);
        lost[9] = [5_200_000.0, 800_000.0, 0.0];
        let text = refusal(&lost);
        assert!(
            text.contains("positions 9 and 10") && text.contains("fix was lost"),
            "{text}"
        );
        let mut broken = rough(0.01);
        broken[9][1] = f64::NAN;
        assert!(refusal(&broken).contains("position 10"));
        broken[9][1] = 1e300;
        assert!(refusal(&broken).contains("position 10 (x = "));
    }

    #[test]
    fn what_is_no_drive_is_refused() {
        let error = |points: &[[f64; 3]]| drivable(points, &MAKING).unwrap_err().to_string();
        assert!(error(&[]).contains("no points"));
        // A receiver that stands still wanders.
        let wandering = |i: u32| {
            [
                0.002 * f64::from(7 * i).sin(),
                0.002 * f64::from(5 * i).cos(),
                0.0,
            ]
        };
        let wanders: Vec<[f64; 3]> = (0..600).map(wandering).collect();
        for stands in [&[[1.0, 2.0, 3.0]; 50][..], &wanders] {
            assert!(error(stands).contains("within 0.00 m of the first"));
        }
    }
}
