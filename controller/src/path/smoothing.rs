//! Raw points to a path of bounded curvature.

use super::options::Smoothing;
use super::raw::{RawPiece, split, without_repetitions};
use super::speeds::stretches;
use super::spline::{Spline, smooth_nodes};
use super::{
    ArcLength, Direction, Path, PathError, PathSample, Piece, Point2, RawPoint, Window, accuracy,
    first_irregular,
};
use std::f64::consts::{FRAC_PI_2, PI};

/// A path and how far it is from the points it was made of.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothed {
    /// The path.
    pub path: Path,
    /// Largest distance of a raw point from the path, m.
    pub deviation_max_m: f64,
    /// Standard deviation of the raw points in each direction, as stated or estimated, m; 0 for exact ones.
    pub accuracy_m: f64,
    /// Root of the mean squared distance of the raw points from the path, m.
    pub deviation_rms_m: f64,
    /// Arc length at which each raw point is nearest to the path, m, never decreasing; one for
    /// each point given, so that what else was recorded with a point can be placed on the path.
    pub arc_lengths_m: Vec<f64>,
}

/// Least and largest factor by which the reach of the smoothing grows in a round where the curvature is too large.
const GROWTH: (f64, f64) = (1.05, 2.0);
/// Exponent of the curvature over its bound in that factor. The curvature falls with the power 1 of the reach at a lone
/// corner and with the power 2.5 where it is noise (see `noise_reach_m`), so that neither is smoothed more than it needs.
const GROWTH_EXPONENT: f64 = 0.4;
/// Largest change of the reach from node to node, in nodes.
const GRADE: f64 = 0.2;
/// Largest reach, in nodes: its fourth power is still small beside what doubles resolve.
const REACH_MAX: f64 = 2000.0;
const ROUNDS: usize = 80;
/// Beyond this a route holds a stray point: half a day's drive, which takes up to 2 s to smooth.
const LENGTH_MAX_M: f64 = 2e4;
/// Distance between two places within which they are made corners one after the other, in smallest radii: with one of
/// them a corner, the other may be rounded.
const APART: f64 = 4.0;
/// Share of the curvature bound the smoothing aims at.
const MARGIN: f64 = 0.97;

/// Returns a path of bounded curvature that passes all points within the allowed deviation.
///
/// Points that were recorded while standing count as one place, within four standard deviations of the points'
/// accuracy, which is stated or estimated from them.
///
/// Each piece between cusps and corners is a smoothing spline: the nodes minimise the squared distance to the
/// polyline plus lambda times the squared second derivative. Lambda is as large as the points' noise
/// asks for, and grows, only where the curvature is still too large, until the bound holds. Both ends, all cusps and all corners are met exactly.
/// A cusp is where [`RawPoint::direction`] changes or, where no point has one, where the polyline
/// turns by more than 120 deg, seen over half the smallest radius; the first piece is then driven
/// forward. A corner, where the vehicle stops and turns on the spot, is where travel turns by 30 deg or more and the
/// curvature bound cannot be met within the deviation.
///
/// The speeds of the points hold on the path from where each point is nearest to it.
///
/// # Errors
/// [`PathError::Range`] for a speed outside [`ROUTE_SPEEDS`](super::ROUTE_SPEEDS);
/// [`PathError::Empty`], [`PathError::SinglePoint`], [`PathError::ZeroLength`] or
/// [`PathError::NotFinite`] for unusable points; [`PathError::TooLong`] above 20 km;
/// [`PathError::TooSharp`] where the curvature bound cannot be met within the deviation and there is no corner, and
/// [`PathError::TurnsBack`] where that is because travel turns back on the spot.
pub fn smooth(points: &[RawPoint], options: &Smoothing) -> Result<Smoothed, PathError> {
    let raw = split(points, options)?;
    let length_m: f64 = raw.pieces.iter().map(RawPiece::length_m).sum();
    if length_m > LENGTH_MAX_M {
        return Err(PathError::TooLong {
            length_m,
            limit_m: LENGTH_MAX_M,
        });
    }
    let mut pieces = Vec::with_capacity(raw.pieces.len());
    let mut offsets: Vec<Offset> = Vec::with_capacity(points.len());
    let mut start_m = 0.0;
    // The next one last.
    let mut to_come = raw.pieces;
    to_come.reverse();
    while let Some(piece) = to_come.pop() {
        let direction = piece.direction;
        let piece = match smooth_piece(&piece, raw.accuracy_m, options) {
            Ok(piece) => piece,
            Err(refused) => {
                let parted = |at: &[usize]| piece.parted_at_corners(at, raw.chord_m);
                let parts = match parted(&refused.beyond) {
                    Some(parts) => parts,
                    // Where none of the places is a corner, the sharpest one may be.
                    None => {
                        let error = refused.error(options);
                        let sharpest = error.sharp_at().and_then(|at| parted(&[at]));
                        sharpest
                            .ok_or_else(|| with_remedies(error, &piece, raw.accuracy_m, options))?
                    }
                };
                to_come.extend(parts.into_iter().rev());
                continue;
            }
        };
        // The first point of a later piece is the cusp, counted with the piece before.
        let counted = usize::from(!offsets.is_empty());
        offsets.extend(piece.offsets.iter().skip(counted).map(|offset| Offset {
            arc_length_m: offset.arc_length_m + start_m,
            ..*offset
        }));
        start_m += piece.length_m;
        let samples = match direction {
            Direction::Forward => piece.samples,
            Direction::Reverse => turned_back(piece.samples),
        };
        pieces.push((direction, piece.length_m, samples));
    }
    let arc_lengths_m = spread(&offsets, points.len());
    let path = Path::from_pieces(pieces, false)?.with_speeds(stretches(points, &arc_lengths_m))?;
    let squares: f64 = offsets.iter().map(|o| o.distance_m * o.distance_m).sum();
    Ok(Smoothed {
        path,
        accuracy_m: raw.accuracy_m,
        deviation_max_m: offsets.iter().fold(0.0, |max, o| o.distance_m.max(max)),
        deviation_rms_m: (squares / offsets.len() as f64).sqrt(),
        arc_lengths_m,
    })
}

/// Returns the standard deviation of points in each direction, m, as they show it themselves; 0 for points that are
/// exact, too few or too far apart to say.
///
/// # Errors
/// As [`smooth`] for unusable points.
pub fn estimated_accuracy_m(points: &[RawPoint]) -> Result<f64, PathError> {
    Ok(accuracy::estimate(&without_repetitions(points)?))
}

/// Where a raw point is against its piece of the path.
#[derive(Debug, Clone, Copy)]
struct Offset {
    index: usize,
    position: Point2,
    arc_length_m: f64,
    distance_m: f64,
}

/// A smoothed piece; the headings are of the direction of travel.
struct SmoothPiece {
    length_m: f64,
    samples: Vec<PathSample>,
    offsets: Vec<Offset>,
}

impl SmoothPiece {
    /// Returns the raw point farthest from it; there are two at least.
    fn farthest(&self) -> Offset {
        let farther = |far: Offset, next: &Offset| match next.distance_m > far.distance_m {
            true => *next,
            false => far,
        };
        self.offsets.iter().fold(self.offsets[0], farther)
    }
}

/// Returns the indices of the farthest of these raw points, of those closer to each other than `apart_m` along the
/// piece one.
fn peaks(offsets: &[Offset], apart_m: f64) -> Vec<usize> {
    let mut peaks: Vec<&Offset> = Vec::new();
    for offset in offsets {
        match peaks.last_mut() {
            Some(last) if offset.arc_length_m - last.arc_length_m < apart_m => {
                if offset.distance_m > last.distance_m {
                    *last = offset;
                }
            }
            _ => peaks.push(offset),
        }
    }
    peaks.into_iter().map(|offset| offset.index).collect()
}

/// Returns the error of a piece that cannot be smoothed with what would do.
fn with_remedies(
    mut error: PathError,
    raw: &RawPiece,
    accuracy_m: f64,
    options: &Smoothing,
) -> PathError {
    /// Factor between the curvatures that are tried, and their number.
    const STEP: f64 = 1.2;
    const STEPS: i32 = 12;
    /// Longer pieces take too long to try, m.
    const LENGTH_MAX_M: f64 = 1000.0;
    if raw.length_m() > LENGTH_MAX_M {
        return error;
    }
    let deviation_would_do_m = || deviation_needed_m(raw, accuracy_m, options);
    match &mut error {
        PathError::TooSharp {
            curvature_per_m,
            deviation_needed_m,
            curvature_needed_per_m,
            ..
        } => {
            *deviation_needed_m = deviation_would_do_m();
            *curvature_needed_per_m = (0..STEPS)
                .map(|step| (100.0 * *curvature_per_m * STEP.powi(step)).ceil() / 100.0)
                .find(|&max_curvature_per_m| {
                    let would_do = Smoothing {
                        max_curvature_per_m,
                        ..*options
                    };
                    smooth_piece(raw, accuracy_m, &would_do).is_ok()
                });
        }
        PathError::TooFar {
            deviation_needed_m, ..
        } => *deviation_needed_m = deviation_would_do_m(),
        _ => {}
    }
    error
}

/// Returns the deviation with which a piece keeps its largest curvature, m.
fn deviation_needed_m(raw: &RawPiece, accuracy_m: f64, options: &Smoothing) -> Option<f64> {
    let curve = Curve::new(raw, options.spacing_m);
    let mut reaches = curve.reaches_for_noise(accuracy_m, options);
    let mut window_m = options.max_deviation_m;
    for _ in 0..ROUNDS {
        let spline = curve.spline(&reaches);
        let piece = curve.sampled(&spline, window_m);
        let farthest_m = piece.farthest().distance_m;
        if sharpest(&piece).1 <= options.max_curvature_per_m {
            return Some(farthest_m);
        }
        window_m = window_m.max(2.0 * farthest_m);
        if !widen(
            &mut reaches,
            &excesses(&spline, options.max_curvature_per_m),
        ) {
            break;
        }
    }
    None
}

/// A piece that cannot be smoothed.
struct NotSmoothed<'a> {
    curve: Curve<'a>,
    /// The last curve within the deviation, or the first one where none is.
    last: Spline,
    /// The given points at which the next one is not.
    beyond: Vec<usize>,
}

impl NotSmoothed<'_> {
    fn error(&self, options: &Smoothing) -> PathError {
        let piece = self.curve.sampled(&self.last, options.max_deviation_m);
        let (worst, curvature_per_m) = sharpest(&piece);
        if curvature_per_m > options.max_curvature_per_m {
            return sharp_error(&piece, worst, curvature_per_m, options);
        }
        let farthest = piece.farthest();
        PathError::TooFar {
            index: farthest.index,
            position: farthest.position,
            distance_m: farthest.distance_m,
            deviation_m: options.max_deviation_m,
            deviation_needed_m: None,
        }
    }
}

fn smooth_piece<'a>(
    raw: &'a RawPiece,
    accuracy_m: f64,
    options: &Smoothing,
) -> Result<SmoothPiece, Box<NotSmoothed<'a>>> {
    let curve = Curve::new(raw, options.spacing_m);
    let mut reaches = curve.reaches_for_noise(accuracy_m, options);
    let mut within: Option<Spline> = None;
    for _ in 0..ROUNDS {
        let spline = curve.spline(&reaches);
        let excesses = excesses(&spline, options.max_curvature_per_m);
        let mut beyond = curve.beyond(&spline, options.max_deviation_m);
        let is_too_sharp = excesses.iter().any(|excess| *excess > 1.0 / MARGIN);
        if beyond.is_empty() && !is_too_sharp {
            let piece = curve.sampled(&spline, options.max_deviation_m);
            let farthest = piece.farthest();
            if farthest.distance_m > options.max_deviation_m {
                beyond.push(farthest);
            } else if sharpest(&piece).1 <= options.max_curvature_per_m {
                return Ok(piece);
            }
        }
        if !beyond.is_empty() {
            return Err(Box::new(NotSmoothed {
                last: within.unwrap_or(spline),
                beyond: peaks(&beyond, APART / options.max_curvature_per_m),
                curve,
            }));
        }
        within = Some(spline);
        // Without a sharp node the next round would be the same.
        if !widen(&mut reaches, &excesses) {
            break;
        }
    }
    let last = within.unwrap_or_else(|| curve.spline(&reaches));
    Err(Box::new(NotSmoothed {
        curve,
        last,
        beyond: Vec::new(),
    }))
}

/// Share of the allowed deviation that smoothing for noise may take.
const NOISE_SHARE: f64 = 0.7;
/// Factor by which that smoothing is made less where bends do not allow as much.
const NOISE_STEP: f64 = 1.5;
/// Curvature that noise may leave, root of its mean square, as a share of the largest.
const NOISE_CURVATURE_SHARE: f64 = 0.01;

/// Returns over what length points of this accuracy have to be smoothed, m.
///
/// White noise of the standard deviation s at a spacing d leaves a spline of reach r, whose lambda is r^4, with a
/// root-mean-square curvature of 0.297 s d^0.5 r^-2.5 (the integral of k^4 / (1 + (k r)^4)^2 over all wave numbers k).
fn noise_reach_m(raw: &RawPiece, accuracy_m: f64, options: &Smoothing) -> f64 {
    let spacing_m = raw.length_m() / (raw.points.len() - 1) as f64;
    let curvature_per_m = NOISE_CURVATURE_SHARE * options.max_curvature_per_m;
    (0.297 * accuracy_m * spacing_m.sqrt() / curvature_per_m).powf(0.4)
}

/// A piece to be smoothed.
struct Curve<'a> {
    raw: &'a RawPiece,
    nodes: Vec<Point2>,
    /// Distance between nodes along the polyline, m.
    step_m: f64,
    /// Where each raw point is, in nodes from the start.
    places: Vec<f64>,
}

impl<'a> Curve<'a> {
    fn new(raw: &'a RawPiece, spacing_m: f64) -> Self {
        let mut length_m = 0.0;
        let mut along_m = vec![0.0];
        for pair in raw.points.windows(2) {
            length_m += pair[0].1.distance_m(&pair[1].1);
            along_m.push(length_m);
        }
        let (nodes, step_m) = resampled(raw, &along_m, spacing_m);
        let places = along_m.iter().map(|m| m / step_m).collect();
        Self {
            raw,
            nodes,
            step_m,
            places,
        }
    }

    /// Returns the spline through the nodes, smoothed by `reaches`; those next to a cusp stay.
    fn spline(&self, reaches: &[f64]) -> Spline {
        let (start, end) = (self.raw.start_tangent, self.raw.end_tangent);
        let stiffness: Vec<f64> = reaches.iter().map(|reach| reach.powi(4)).collect();
        let nodes = smooth_nodes(&self.nodes, &stiffness, (start.is_some(), end.is_some()));
        let slope = |tangent: [f64; 2]| [tangent[0] * self.step_m, tangent[1] * self.step_m];
        Spline::through(nodes, start.map(slope), end.map(slope))
    }

    /// Returns the fourth roots of lambda, over how many nodes the smoothing reaches: as much as the noise asks for,
    /// unless bends ask for less.
    fn reaches_for_noise(&self, accuracy_m: f64, options: &Smoothing) -> Vec<f64> {
        let within_m = NOISE_SHARE * options.max_deviation_m;
        let mut reach = noise_reach_m(self.raw, accuracy_m, options) / self.step_m;
        loop {
            let reaches = vec![reach.max(1.0); self.nodes.len()];
            if reach <= 1.0 || self.beyond(&self.spline(&reaches), within_m).is_empty() {
                return reaches;
            }
            reach /= NOISE_STEP;
        }
    }

    /// Returns the raw points farther than this from the curve, seen from their own places on it, with their places along
    /// the polyline.
    fn beyond(&self, spline: &Spline, distance_m: f64) -> Vec<Offset> {
        let points = self.raw.points.iter().zip(&self.places);
        let offset = |(&(index, position), &place): (&(usize, Point2), &f64)| Offset {
            index,
            position,
            arc_length_m: place * self.step_m,
            distance_m: spline.distance_m(&position, place, distance_m),
        };
        let beyond = |offset: &Offset| offset.distance_m > distance_m;
        points.map(offset).filter(beyond).collect()
    }

    fn sampled(&self, spline: &Spline, window_m: f64) -> SmoothPiece {
        let table = ArcLength::new(|u| spline.at(u), spline.end(), self.nodes.len() - 1);
        let piece = SmoothPiece {
            length_m: table.length_m(),
            samples: table.samples(Direction::Forward),
            offsets: Vec::new(),
        };
        with_offsets(piece, self.raw, window_m)
    }
}

/// Returns for each node how many times as much as the smoothing aims at the curve bends around it, infinite where it turns
/// back, and 1 where it is not sharp: by the curvature at the node, or on average over a part of the way to the next one,
/// where the curve may bend sharply or turn back.
fn excesses(spline: &Spline, max_curvature_per_m: f64) -> Vec<f64> {
    /// Parts of the way to the next node.
    const PARTS: u8 = 4;
    let limit = MARGIN * max_curvature_per_m;
    let mut excesses: Vec<f64> = vec![1.0; spline.end() as usize + 1];
    let mut is_sharp = |nodes: &[usize], curvature_per_m: f64| {
        if curvature_per_m <= limit {
            return false;
        }
        let excess = match curvature_per_m.is_nan() {
            true => f64::INFINITY,
            false => curvature_per_m / limit,
        };
        for &node in nodes {
            excesses[node] = excesses[node].max(excess);
        }
        true
    };
    for i in 0..spline.end() as usize {
        if spline.curvature_bound_per_m(i) <= limit {
            continue;
        }
        let point = |part: u8| spline.at(i as f64 + f64::from(part) / f64::from(PARTS));
        let ends = [(i, point(0)), (i + 1, point(PARTS))];
        let sharp_ends = ends.map(|(node, at)| is_sharp(&[node], at.curvature_per_m().abs()));
        if sharp_ends.contains(&true) {
            continue;
        }
        let mut a = ends[0].1;
        for part in 1..=PARTS {
            let b = point(part);
            let [[ax, ay], [bx, by]] = [a.tangent, b.tangent];
            let turned_rad = (ax * by - ay * bx).atan2(ax * bx + ay * by);
            is_sharp(
                &[i, i + 1],
                turned_rad.abs() / a.position.distance_m(&b.position),
            );
            a = b;
        }
    }
    excesses
}

/// Lengthens the reach of the smoothing at sharp nodes, and around them so that the reach changes gradually: curvature
/// would gather where it drops. Returns whether a node is sharp.
fn widen(reaches: &mut [f64], excesses: &[f64]) -> bool {
    let mut is_sharp = false;
    let reached = reaches.iter_mut().zip(excesses);
    for (reach, excess) in reached.filter(|(_, excess)| **excess > 1.0) {
        is_sharp = true;
        *reach *= excess.powf(GROWTH_EXPONENT).clamp(GROWTH.0, GROWTH.1);
        *reach = reach.min(REACH_MAX);
    }
    for i in 1..reaches.len() {
        reaches[i] = reaches[i].max(reaches[i - 1] - GRADE);
    }
    for i in (0..reaches.len() - 1).rev() {
        reaches[i] = reaches[i].max(reaches[i + 1] - GRADE);
    }
    is_sharp
}

/// Returns nodes uniform along the polyline, whose points are `along_m` from its start, and their distance; those next
/// to a cusp are put on the tangent there.
fn resampled(raw: &RawPiece, along_m: &[f64], spacing_m: f64) -> (Vec<Point2>, f64) {
    let points = &raw.points;
    let length_m = along_m[along_m.len() - 1];
    let intervals = (length_m / spacing_m).ceil().max(4.0) as usize;
    let step_m = length_m / intervals as f64;
    let mut nodes = Vec::with_capacity(intervals + 1);
    let mut segment = 0;
    for i in 0..=intervals {
        let at_m = (i as f64 * step_m).min(length_m);
        while segment + 2 < points.len() && along_m[segment + 1] < at_m {
            segment += 1;
        }
        let (a, b) = (&points[segment].1, &points[segment + 1].1);
        let ratio =
            ((at_m - along_m[segment]) / (along_m[segment + 1] - along_m[segment])).min(1.0);
        nodes.push(Point2 {
            x_m: a.x_m + ratio * (b.x_m - a.x_m),
            y_m: a.y_m + ratio * (b.y_m - a.y_m),
        });
    }
    let beside = |end: Point2, tangent: [f64; 2], off_m: f64| Point2 {
        x_m: end.x_m + off_m * tangent[0],
        y_m: end.y_m + off_m * tangent[1],
    };
    if let Some(tangent) = raw.start_tangent {
        nodes[1] = beside(nodes[0], tangent, step_m);
    }
    if let Some(tangent) = raw.end_tangent {
        nodes[intervals - 1] = beside(nodes[intervals], tangent, -step_m);
    }
    (nodes, step_m)
}

/// Finds each raw point's nearest point, in order.
fn with_offsets(mut piece: SmoothPiece, raw: &RawPiece, window_m: f64) -> SmoothPiece {
    // Not checked: it may still turn back.
    let path = Path {
        pieces: vec![Piece::new(
            0.0,
            piece.length_m,
            Direction::Forward,
            std::mem::take(&mut piece.samples),
        )],
        closed: false,
        length_m: piece.length_m,
        speeds: Vec::new(),
    };
    let last = raw.points.len() - 1;
    let mut reached_m = 0.0;
    for (i, &(index, position)) in raw.points.iter().enumerate() {
        let step_m = match i {
            0 => 0.0,
            _ => raw.points[i - 1].1.distance_m(&position),
        };
        let window = Window {
            behind_m: 0.0,
            ahead_m: step_m + 2.0 * window_m,
        };
        let projected = path.nearest_within(&position, reached_m, &window);
        reached_m = match i {
            0 => 0.0,
            _ if i == last => piece.length_m,
            _ => projected.point.arc_length_m,
        };
        piece.offsets.push(Offset {
            index,
            position,
            arc_length_m: reached_m,
            distance_m: path.at(reached_m).position.distance_m(&position),
        });
    }
    piece.samples = path
        .pieces
        .into_iter()
        .flat_map(|piece| piece.samples)
        .collect();
    piece
}

/// Returns the sample of the largest curvature, at it or on average to the next, and that curvature, 1/m; infinite
/// where the curve turns back or stands still.
fn sharpest(piece: &SmoothPiece) -> (usize, f64) {
    let step_m = piece.length_m / (piece.samples.len() - 1) as f64;
    if let Some(index) = first_irregular(&piece.samples, step_m, CHORD_SHARE_MIN) {
        return (index, f64::INFINITY);
    }
    let mut worst = (0, 0.0);
    for (i, sample) in piece.samples.iter().enumerate() {
        let turned_rad = match piece.samples.get(i + 1) {
            Some(next) => next.heading_rad - sample.heading_rad,
            None => 0.0,
        };
        let curvature = sample.curvature_per_m.abs().max(turned_rad.abs() / step_m);
        if curvature > worst.1 {
            worst = (i, curvature);
        }
    }
    if worst.1 * step_m > TURNED_BACK_RAD {
        worst.1 = f64::INFINITY;
    }
    worst
}

/// Least distance of consecutive samples over their arc length; the largest curvature allowed, 10 1/m, leaves 0.99.
const CHORD_SHARE_MIN: f64 = 0.95;
/// Turn between two samples beyond which a curve turns back on the spot, rad.
const TURNED_BACK_RAD: f64 = FRAC_PI_2;

fn sharp_error(
    piece: &SmoothPiece,
    sample: usize,
    curvature_per_m: f64,
    options: &Smoothing,
) -> PathError {
    let at_m = piece.length_m * sample as f64 / (piece.samples.len() - 1) as f64;
    let nearest = piece.offsets.iter().min_by(|a, b| {
        (a.arc_length_m - at_m)
            .abs()
            .total_cmp(&(b.arc_length_m - at_m).abs())
    });
    let index = nearest.map_or(0, |offset| offset.index);
    let position = piece.samples[sample].position;
    if curvature_per_m.is_infinite() {
        return PathError::TurnsBack {
            index,
            position: nearest.map_or(position, |offset| offset.position),
        };
    }
    PathError::TooSharp {
        index,
        position,
        curvature_per_m,
        limit_per_m: options.max_curvature_per_m,
        deviation_m: options.max_deviation_m,
        deviation_needed_m: None,
        curvature_needed_per_m: None,
    }
}

fn turned_back(mut samples: Vec<PathSample>) -> Vec<PathSample> {
    for sample in &mut samples {
        sample.heading_rad -= PI;
    }
    samples
}

/// Gives the repeated points that were dropped the arc length of the one kept before them.
fn spread(offsets: &[Offset], count: usize) -> Vec<f64> {
    let mut arc_lengths_m = vec![f64::NAN; count];
    for offset in offsets {
        arc_lengths_m[offset.index] = offset.arc_length_m;
    }
    let mut before_m = 0.0;
    for arc_length_m in &mut arc_lengths_m {
        if arc_length_m.is_nan() {
            *arc_length_m = before_m;
        }
        before_m = *arc_length_m;
    }
    arc_lengths_m
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_places_beside_each_other_the_farthest_is_parted_first() {
        let distances_m = [0.0, 0.3, 0.2, 0.4, 0.0, 0.25, 0.1, 0.5];
        let offset = |(index, &distance_m): (usize, &f64)| Offset {
            index,
            position: Point2 { x_m: 0.0, y_m: 0.0 },
            arc_length_m: index as f64,
            distance_m,
        };
        let offsets: Vec<Offset> = distances_m.iter().enumerate().map(offset).collect();
        let beyond: Vec<Offset> = offsets
            .into_iter()
            .filter(|o| o.distance_m > 0.15)
            .collect();
        assert_eq!(peaks(&beyond, 0.5), [1, 2, 3, 5, 7]);
        assert_eq!(peaks(&beyond, 2.5), [3, 7]);
        assert!(peaks(&[], 1.0).is_empty());
    }
}
