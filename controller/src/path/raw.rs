//! Points as they are given, before they are a path.

use super::options::Smoothing;
use super::{Direction, PathError, Point2, RawPoint, accuracy};

/// Points in pieces of one driving direction, and their standard deviation in each direction, m.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Raw {
    pub(super) pieces: Vec<RawPiece>,
    pub(super) accuracy_m: f64,
    /// Length over which a direction of travel is seen, m.
    pub(super) chord_m: f64,
}

/// A run of points driven one way.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RawPiece {
    pub(super) direction: Direction,
    /// Points with the index they were given at.
    pub(super) points: Vec<(usize, Point2)>,
    /// Unit direction of travel that a cusp prescribes at the start.
    pub(super) start_tangent: Option<[f64; 2]>,
    /// Unit direction of travel that a cusp prescribes at the end.
    pub(super) end_tangent: Option<[f64; 2]>,
}

impl RawPiece {
    /// Returns the length of the polyline, m.
    pub(super) fn length_m(&self) -> f64 {
        along_m(&self.points, 0, self.points.len() - 1)
    }

    /// Returns this piece in parts that meet in corners: where travel turns enough beside one of the points that were
    /// given as the `indices`th, at the point where it turns most. None where it does so beside none of them, or turns
    /// back.
    pub(super) fn parted_at_corners(&self, indices: &[usize], chord_m: f64) -> Option<Vec<Self>> {
        let corners = indices
            .iter()
            .filter_map(|&index| self.corner_beside(index, chord_m));
        let mut ends: Vec<usize> = corners.collect();
        if ends.is_empty() {
            return None;
        }
        ends.push(self.points.len() - 1);
        ends.sort_unstable();
        ends.dedup();
        let last = ends.len() - 1;
        let starts = [0].into_iter().chain(ends.iter().copied());
        let parts = starts
            .zip(&ends)
            .enumerate()
            .map(|(i, (start, &end))| Self {
                direction: self.direction,
                points: self.points[start..=end].to_vec(),
                start_tangent: self.start_tangent.filter(|_| i == 0),
                end_tangent: self.end_tangent.filter(|_| i == last),
            });
        Some(parts.collect())
    }

    /// Returns the place of the point where travel turns most beside the one given as the `index`th, if that is a corner.
    fn corner_beside(&self, index: usize, chord_m: f64) -> Option<usize> {
        let points = &self.points;
        let place = points.binary_search_by_key(&index, |(given, _)| *given);
        let place = place.ok()?;
        let turn_cos = |at: usize| {
            let (before, after) = (
                chord_before(points, at, chord_m),
                chord_after(points, at, chord_m),
            );
            before[0] * after[0] + before[1] * after[1]
        };
        let beside = |at: &usize| {
            let (from, to) = (place.min(*at), place.max(*at));
            from + 1 >= to || along_m(points, from, to) <= chord_m
        };
        let places = 1..points.len() - 1;
        let before = (1..=place)
            .rev()
            .filter(|at| places.contains(at))
            .take_while(beside);
        let after = (place + 1..points.len() - 1).take_while(beside);
        let (corner, cos) = before
            .chain(after)
            .map(|at| (at, turn_cos(at)))
            .min_by(|a, b| a.1.total_cmp(&b.1))?;
        (FOLD_COS..CORNER_COS).contains(&cos).then_some(corner)
    }
}

/// Cosine of the angle by which travel must turn at a point to make it a corner, 30 deg, and of that from which on it
/// turns back, 170 deg.
const CORNER_COS: f64 = 0.866;
const FOLD_COS: f64 = -0.985;

/// Cosine of the angle by which travel must turn at a point to make it a cusp: 120 deg.
const CUSP_COS: f64 = -0.5;

/// Drops repetitions, makes points of one place one, and splits the points where the driving direction changes: where the
/// points say so, or, if none says anything, where travel over a chord before and after a point turns by more than
/// 120 deg.
pub(super) fn split(points: &[RawPoint], options: &Smoothing) -> Result<Raw, PathError> {
    let kept = without_repetitions(points)?;
    // What is left of the noise must not turn travel back.
    let estimated = || accuracy::estimate(&kept).min(ESTIMATE_SHARE * options.max_deviation_m);
    let accuracy_m = options.accuracy_m.unwrap_or_else(estimated);
    let kept = accuracy::places(&kept, accuracy_m);
    if kept.len() < 2 {
        return Err(PathError::ZeroLength);
    }
    let chord_m = (0.5 / options.max_curvature_per_m).max(CHORD_SIGMAS * accuracy_m);
    let positions: Vec<(usize, Point2)> = kept.iter().map(|&(i, p)| (i, p.position)).collect();
    let explicit = kept.iter().any(|(_, p)| p.direction.is_some());
    let mut direction = kept[0].1.direction.unwrap_or_default();
    let mut pieces: Vec<RawPiece> = Vec::new();
    let mut start = 0;
    let cusps = if explicit {
        marked_cusps(&kept, &positions, chord_m)?
    } else {
        sharp_cusps(&positions, chord_m)
    };
    let mut tangent = None;
    for cusp in cusps.into_iter().chain([positions.len() - 1]) {
        let last = cusp == positions.len() - 1;
        let next_tangent = if last {
            None
        } else {
            Some(cusp_tangent(&positions, cusp, chord_m))
        };
        pieces.push(RawPiece {
            direction,
            points: positions[start..=cusp].to_vec(),
            start_tangent: tangent.map(|t: [f64; 2]| [-t[0], -t[1]]),
            end_tangent: next_tangent,
        });
        direction = direction.reversed();
        tangent = next_tangent;
        start = cusp;
    }
    Ok(Raw {
        pieces,
        accuracy_m,
        chord_m,
    })
}

/// An estimated accuracy is at most this share of the deviation allowed: more is no noise, or has to be stated.
const ESTIMATE_SHARE: f64 = 1.0 / 3.0;
/// Length over which a direction of travel is seen, in standard deviations of the points.
const CHORD_SIGMAS: f64 = 8.0;

/// Coordinates beyond this are no place on earth, m.
const COORDINATE_MAX_M: f64 = 1e8;
/// Points closer than this to the one before are the same place, m.
const SAME_PLACE_M: f64 = 1e-6;

pub(super) fn without_repetitions(
    points: &[RawPoint],
) -> Result<Vec<(usize, RawPoint)>, PathError> {
    let mut kept: Vec<(usize, RawPoint)> = Vec::with_capacity(points.len());
    for (index, point) in points.iter().enumerate() {
        let Point2 { x_m, y_m } = point.position;
        let on_earth = |m: f64| m.abs() <= COORDINATE_MAX_M;
        if !on_earth(x_m) || !on_earth(y_m) || point.elevation_m.is_some_and(|z_m| !z_m.is_finite())
        {
            return Err(PathError::NotFinite {
                index,
                position: point.position,
            });
        }
        match kept.last_mut() {
            // The later point says which way to go on.
            Some((_, before)) if before.position.distance_m(&point.position) < SAME_PLACE_M => {
                before.direction = point.direction.or(before.direction);
            }
            _ => kept.push((index, *point)),
        }
    }
    match (points.len(), kept.len()) {
        (0, _) => Err(PathError::Empty),
        (1, _) => Err(PathError::SinglePoint),
        (_, 1) => Err(PathError::ZeroLength),
        _ => Ok(kept),
    }
}

/// Returns where the marked direction changes; an unmarked point keeps the one before it. Where travel turns back
/// at the point beside a mark, that is the place.
///
/// # Errors
/// [`PathError::NoCusp`] where travel does not turn back at a mark.
fn marked_cusps(
    points: &[(usize, RawPoint)],
    positions: &[(usize, Point2)],
    chord_m: f64,
) -> Result<Vec<usize>, PathError> {
    let last = points.len() - 1;
    let turn_cos = |at: usize, chord_m: f64| {
        let before = chord_before(positions, at, chord_m);
        let after = chord_after(positions, at, chord_m);
        before[0] * after[0] + before[1] * after[1]
    };
    let mut direction = points[0].1.direction.unwrap_or_default();
    let mut cusps = Vec::new();
    for (at, (_, point)) in points.iter().enumerate().take(points.len() - 1).skip(1) {
        let next = point.direction.unwrap_or(direction);
        if next != direction {
            let free = |place: &usize| cusps.last().is_none_or(|last| last < place);
            let beside = [at, at - 1, at + 1];
            let beside = beside
                .into_iter()
                .filter(|&place| 0 < place && place < last);
            let turned_back = beside
                .filter(free)
                .find(|&place| turn_cos(place, 0.0) < CUSP_COS);
            match turned_back {
                Some(place) => cusps.push(place),
                None if free(&at) && turn_cos(at, chord_m) < 0.0 => cusps.push(at),
                None => {
                    let (index, position) = positions[at];
                    return Err(PathError::NoCusp { index, position });
                }
            }
        }
        direction = next;
    }
    Ok(cusps)
}

/// Returns the tip of each place where travel turns back: the point farthest in the direction in and against the
/// direction out.
fn sharp_cusps(points: &[(usize, Point2)], chord_m: f64) -> Vec<usize> {
    struct Place {
        tip: usize,
        outward: [f64; 2],
    }
    let mut places: Vec<Place> = Vec::new();
    for at in 1..points.len() - 1 {
        let (before, after) = (
            chord_before(points, at, chord_m),
            chord_after(points, at, chord_m),
        );
        if before[0] * after[0] + before[1] * after[1] >= CUSP_COS {
            continue;
        }
        match places.last_mut() {
            Some(place) if along_m(points, place.tip, at) <= 2.0 * chord_m => {
                let [tip, here] = [&points[place.tip].1, &points[at].1];
                let farther_m = place.outward[0] * (here.x_m - tip.x_m)
                    + place.outward[1] * (here.y_m - tip.y_m);
                if farther_m > 0.0 {
                    place.tip = at;
                }
            }
            _ => places.push(Place {
                tip: at,
                outward: [before[0] - after[0], before[1] - after[1]],
            }),
        }
    }
    places.into_iter().map(|place| place.tip).collect()
}

/// Returns the unit direction of travel into a cusp, the mean of that in and the opposite of that
/// out.
fn cusp_tangent(points: &[(usize, Point2)], at: usize, chord_m: f64) -> [f64; 2] {
    let (before, after) = (
        chord_before(points, at, chord_m),
        chord_after(points, at, chord_m),
    );
    let mean = [before[0] - after[0], before[1] - after[1]];
    let norm = mean[0].hypot(mean[1]);
    if norm > 1e-6 {
        [mean[0] / norm, mean[1] / norm]
    } else {
        before
    }
}

fn chord_before(points: &[(usize, Point2)], at: usize, chord_m: f64) -> [f64; 2] {
    let from = (0..at)
        .rev()
        .find(|&i| points[i].1.distance_m(&points[at].1) >= chord_m)
        .unwrap_or(0);
    unit(&points[from].1, &points[at].1)
}

fn chord_after(points: &[(usize, Point2)], at: usize, chord_m: f64) -> [f64; 2] {
    let to = (at + 1..points.len())
        .find(|&i| points[i].1.distance_m(&points[at].1) >= chord_m)
        .unwrap_or(points.len() - 1);
    unit(&points[at].1, &points[to].1)
}

/// Returns the unit vector between two points, zero where they coincide.
fn unit(from: &Point2, to: &Point2) -> [f64; 2] {
    let distance_m = from.distance_m(to);
    if distance_m > 0.0 {
        [
            (to.x_m - from.x_m) / distance_m,
            (to.y_m - from.y_m) / distance_m,
        ]
    } else {
        [0.0, 0.0]
    }
}

fn along_m(points: &[(usize, Point2)], from: usize, to: usize) -> f64 {
    points[from..=to]
        .windows(2)
        .map(|pair| pair[0].1.distance_m(&pair[1].1))
        .sum()
}
