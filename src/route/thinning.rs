//! Reduces recorded positions to a few points that a controller can follow.

use anyhow::{Result, bail};

/// Positions nearer than this to the one before are the same place: the vehicle stands.
const STEP_M: f64 = 0.05;
/// Largest distance of two points of the path, m, so that heights and curves are kept.
const SPACING_MAX_M: f64 = 1.0;
/// Shortest path, m.
const LENGTH_MIN_M: f64 = 0.5;
/// Reach of the Gaussian in standard deviations.
const REACH: f64 = 3.0;

/// How much positions may be changed.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Settings {
    /// Standard deviation of the Gaussian along the path, m.
    pub(crate) smoothing_m: f64,
    /// Distance from the line between neighbours below which a point is left out, m.
    pub(crate) tolerance_m: f64,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            smoothing_m: 0.3,
            tolerance_m: 0.02,
        }
    }
}

/// A path from positions.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Thinned {
    pub(crate) points_m: Vec<[f64; 3]>,
    pub(crate) length_m: f64,
    /// Largest horizontal distance of a recorded position from the path, m.
    pub(crate) deviation_m: f64,
}

/// Returns the path: places where the vehicle stood are one point, the rest is smoothed along its length and
/// thinned. Start and end stay where they are.
///
/// # Errors
/// A position that is not finite, or a drive that goes nowhere.
pub(crate) fn path(recorded: &[[f64; 3]], settings: &Settings) -> Result<Thinned> {
    if let Some(index) = recorded
        .iter()
        .position(|p| !p.iter().all(|value| value.is_finite()))
    {
        bail!("position {} is not finite", index + 1);
    }
    let moving = without_standstill(recorded);
    let distances_m = distances(&moving);
    let length_m = distances_m.last().copied().unwrap_or(0.0);
    if length_m < LENGTH_MIN_M {
        bail!(
            "it holds no drive: its positions cover {length_m:.2} m, at least {LENGTH_MIN_M} m are needed"
        );
    }
    let smooth = smoothed(&moving, &distances_m, settings.smoothing_m);
    let mut kept = vec![0];
    thin(
        &smooth,
        &distances_m,
        0,
        smooth.len() - 1,
        settings.tolerance_m,
        &mut kept,
    );
    let points_m: Vec<[f64; 3]> = kept.iter().map(|index| smooth[*index]).collect();
    let deviation_m = deviation(recorded, &points_m);
    Ok(Thinned {
        length_m: distances(&points_m).last().copied().unwrap_or(0.0),
        points_m,
        deviation_m,
    })
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
    /// Segments looked ahead.
    const AHEAD: usize = 8;
    let mut at = 0;
    let mut largest = 0.0_f64;
    for point in recorded {
        let ahead = at..(at + AHEAD).min(path.len() - 1);
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
        let path = path(&recorded, &Settings::default()).unwrap();
        assert!(path.points_m.len() < 120, "{}", path.points_m.len());
        for point in &path.points_m[1..path.points_m.len() - 1] {
            let radius = point[0].hypot(point[1]);
            assert!((radius - 10.0).abs() < 0.015, "{point:?}");
        }
        assert!((path.length_m - 49.95).abs() < 0.3, "{}", path.length_m);
        assert_eq!(path.points_m[0], recorded[0]);
        assert!((path.points_m.last().unwrap()[2] - 9.99).abs() < 0.03);
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
            (0.02..0.06).contains(&path.deviation_m),
            "{}",
            path.deviation_m
        );
    }

    #[test]
    fn what_is_no_drive_is_refused() {
        let error =
            |points: &[[f64; 3]]| path(points, &Settings::default()).unwrap_err().to_string();
        assert!(error(&[]).contains("it holds no drive"));
        assert!(error(&[[1.0, 2.0, 3.0]; 50]).contains("cover 0.00 m"));
        assert!(error(&[[0.0, f64::NAN, 0.0]]).contains("position 1 is not finite"));
    }
}
