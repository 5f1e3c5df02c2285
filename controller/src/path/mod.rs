//! Planar curves parametrised by arc length, and where a vehicle is along them.
//!
//! Everything is in the world frame: X_g, Y_g horizontal, heading psi counter-clockwise from Y_g.

mod accuracy;
mod actions;
mod aside;
mod curve;
mod error;
mod gpx;
mod options;
mod point;
mod projection;
mod raw;
mod read;
mod smoothing;
mod speeds;
mod spline;

pub use actions::{PendingActions, RouteAction};
pub use aside::{Aside, MovedPath};
pub use error::PathError;
pub use gpx::{GPX_NAMESPACE, GeodeticOrigin, Route, read_gpx};
pub use options::{Smoothing, SmoothingConfig};
pub use point::{Direction, PathPoint, Point2, RawPoint};
pub use projection::{Projected, Window};
pub use read::read_csv;
pub use smoothing::{Smoothed, estimated_accuracy_m, smooth};
pub use speeds::{ROUTE_SPEEDS, SpeedStretch};

pub(crate) use curve::{ArcLength, CurvePoint};

use serde::{Deserialize, Serialize};
use sidehill_plant::frames::PlanarPose;
use std::f64::consts::PI;

/// Distance between the samples a path is stored at, m.
pub(crate) const SAMPLE_STEP_M: f64 = 0.05;

/// A planar curve parametrised by arc length, in pieces of one driving direction each.
///
/// Consecutive pieces meet at a cusp, where position and vehicle heading are continuous and the
/// direction of travel is reversed, or at a corner, where the vehicle turns on the spot.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "RawPath")]
pub struct Path {
    pieces: Vec<Piece>,
    closed: bool,
    length_m: f64,
    /// Stretches with speeds of their own, in the order of travel; none where the settings alone limit the speed.
    /// Recordings do without them: they have the speeds of the trajectory, which follow from these.
    #[serde(skip)]
    speeds: Vec<SpeedStretch>,
}

#[derive(Deserialize)]
struct RawPath {
    pieces: Vec<Piece>,
    closed: bool,
    length_m: f64,
}

/// Returns whether two arc lengths are the same but for rounding.
fn same_length(a_m: f64, b_m: f64) -> bool {
    (a_m - b_m).abs() < 1e-6
}

/// Least distance of consecutive samples over their arc length: less is left where a curve turns back or stands
/// still.
const CHORD_SHARE_MIN: f64 = 0.5;
/// Largest: only a gap leaves more.
const CHORD_SHARE_MAX: f64 = 1.05;

impl TryFrom<RawPath> for Path {
    type Error = PathError;

    fn try_from(raw: RawPath) -> Result<Self, PathError> {
        let RawPath {
            mut pieces,
            closed,
            length_m,
        } = raw;
        let mut end_m = 0.0;
        for piece in &mut pieces {
            piece.check()?;
            piece.find_headings();
            // A text may have rounded them.
            if !same_length(piece.start_m, end_m) {
                return Err(piece.not_regular(0));
            }
            end_m = piece.end_m();
        }
        if pieces.is_empty() || !same_length(length_m, end_m) {
            return Err(PathError::ZeroLength);
        }
        Ok(Self {
            pieces,
            closed,
            length_m,
            speeds: Vec::new(),
        })
    }
}

/// A turn on the spot between two pieces of a path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Distance travelled from the start of the path, m.
    pub arc_length_m: f64,
    /// Position in the world.
    pub position: Point2,
    /// Heading with which the vehicle arrives, rad.
    pub from_rad: f64,
    /// How far it turns, rad, at most half a turn, counter-clockwise positive.
    pub turn_rad: f64,
}

/// Difference between the headings of two pieces from which on the vehicle turns on the spot between them, rad.
const CORNER_MIN_RAD: f64 = 0.05;

/// A part of a path driven one way, sampled uniformly in arc length.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Piece {
    pub(crate) start_m: f64,
    pub(crate) length_m: f64,
    pub(crate) direction: Direction,
    pub(crate) samples: Vec<PathSample>,
    /// Sines and cosines of the samples' headings, which cost most of a point.
    #[serde(skip)]
    headings: Vec<(f64, f64)>,
}

/// What is stored at a sample; the heading is the vehicle's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub(crate) struct PathSample {
    pub(crate) position: Point2,
    pub(crate) heading_rad: f64,
    pub(crate) curvature_per_m: f64,
}

impl Path {
    /// Joins pieces given as samples uniform in arc length, with their lengths and directions.
    ///
    /// Headings are of the vehicle; each piece's are shifted by whole turns so that they continue
    /// those of the piece before.
    ///
    /// # Errors
    /// [`PathError::Empty`] or [`PathError::ZeroLength`] where there is no curve, and
    /// [`PathError::NotRegular`] where one has a gap, stands still or turns back.
    pub(crate) fn from_pieces(
        pieces: impl IntoIterator<Item = (Direction, f64, Vec<PathSample>)>,
        closed: bool,
    ) -> Result<Self, PathError> {
        let mut joined: Vec<Piece> = Vec::new();
        let mut length_m = 0.0;
        for (direction, piece_length_m, mut samples) in pieces {
            if let Some(before) = joined.last().and_then(|p| p.samples.last())
                && let Some(first) = samples.first()
            {
                let turns = ((before.heading_rad - first.heading_rad) / (2.0 * PI)).round();
                for sample in &mut samples {
                    sample.heading_rad += turns * 2.0 * PI;
                }
            }
            let piece = Piece::new(length_m, piece_length_m, direction, samples);
            piece.check()?;
            joined.push(piece);
            length_m += piece_length_m;
        }
        if joined.is_empty() {
            return Err(PathError::Empty);
        }
        Ok(Self {
            pieces: joined,
            closed,
            length_m,
            speeds: Vec::new(),
        })
    }

    /// Returns this path as seen from a frame in which the origin of its own is at `frame`.
    pub(crate) fn seen_from(mut self, frame: &PlanarPose) -> Self {
        for piece in &mut self.pieces {
            for sample in &mut piece.samples {
                sample.position = sample.position.seen_from(frame);
                sample.heading_rad += frame.yaw_rad;
            }
            piece.find_headings();
        }
        self
    }

    /// Returns the length, m; of one lap where the path is closed.
    pub fn length_m(&self) -> f64 {
        self.length_m
    }

    /// Returns the arc lengths at which the vehicle stops on the way, m: those of cusps and corners.
    pub fn stops_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.pieces.iter().skip(1).map(|piece| piece.start_m)
    }

    /// Returns the arc lengths at which the driving direction changes, m.
    pub fn cusps_m(&self) -> impl Iterator<Item = f64> + '_ {
        self.pieces
            .windows(2)
            .filter(|pair| pair[0].direction != pair[1].direction)
            .map(|pair| pair[1].start_m)
    }

    /// Returns where the vehicle turns on the spot, in the order of travel.
    pub fn corners(&self) -> impl Iterator<Item = Corner> + '_ {
        self.pieces.windows(2).filter_map(|pair| {
            let before = pair[0].samples.last()?;
            let after = pair[1].samples.first()?;
            let turn_rad = after.heading_rad - before.heading_rad;
            (turn_rad.abs() > CORNER_MIN_RAD).then_some(Corner {
                arc_length_m: pair[1].start_m,
                position: after.position,
                from_rad: before.heading_rad,
                turn_rad,
            })
        })
    }

    /// Returns the largest magnitude of the curvature at the samples, 1/m.
    pub fn max_curvature_per_m(&self) -> f64 {
        self.pieces
            .iter()
            .flat_map(|piece| &piece.samples)
            .fold(0.0, |max: f64, sample| {
                max.max(sample.curvature_per_m.abs())
            })
    }

    /// Returns the point at `arc_length_m`, by cubic Hermite interpolation of position and heading
    /// and linear interpolation of curvature between samples.
    ///
    /// Arc lengths outside the path are clamped to it, or counted as further laps where it is
    /// closed; the heading then keeps on turning. At a cusp the piece after it is returned.
    pub fn at(&self, arc_length_m: f64) -> PathPoint {
        let (laps, within_m) = self.lap(arc_length_m);
        let mut point = self.pieces[self.piece_index(within_m)].at(within_m);
        point.heading_rad += laps * self.turn_per_lap_rad();
        point.arc_length_m += laps * self.length_m;
        point
    }

    /// Splits an arc length into whole laps and the rest, which is on the path.
    fn lap(&self, arc_length_m: f64) -> (f64, f64) {
        if self.closed {
            let laps = (arc_length_m / self.length_m).floor();
            let within_m = arc_length_m - laps * self.length_m;
            (laps, within_m.clamp(0.0, self.length_m))
        } else {
            (0.0, arc_length_m.clamp(0.0, self.length_m))
        }
    }

    fn piece_index(&self, within_m: f64) -> usize {
        self.pieces
            .partition_point(|piece| piece.start_m <= within_m)
            .saturating_sub(1)
    }

    fn turn_per_lap_rad(&self) -> f64 {
        match (self.pieces.first(), self.pieces.last()) {
            (Some(first), Some(last)) => {
                last.samples[last.samples.len() - 1].heading_rad - first.samples[0].heading_rad
            }
            _ => 0.0,
        }
    }
}

impl Piece {
    pub(crate) fn new(
        start_m: f64,
        length_m: f64,
        direction: Direction,
        samples: Vec<PathSample>,
    ) -> Self {
        let mut piece = Self {
            start_m,
            length_m,
            direction,
            samples,
            headings: Vec::new(),
        };
        piece.find_headings();
        piece
    }

    fn find_headings(&mut self) {
        self.headings.clear();
        let headings = self.samples.iter().map(|sample| sample.heading_rad);
        self.headings.extend(headings.map(f64::sin_cos));
    }

    /// Checks what every search along a path relies on: a length, finite samples, and a distance between
    /// consecutive ones that is about their arc length.
    fn check(&self) -> Result<(), PathError> {
        if self.samples.len() < 2 || !(self.length_m > 0.0 && self.length_m.is_finite()) {
            return Err(PathError::ZeroLength);
        }
        match first_irregular(&self.samples, self.step_m(), CHORD_SHARE_MIN) {
            Some(index) => Err(self.not_regular(index)),
            None => Ok(()),
        }
    }

    fn not_regular(&self, index: usize) -> PathError {
        PathError::NotRegular {
            position: self.samples[index].position,
        }
    }

    fn step_m(&self) -> f64 {
        self.length_m / (self.samples.len() - 1) as f64
    }

    fn end_m(&self) -> f64 {
        self.start_m + self.length_m
    }

    fn at(&self, arc_length_m: f64) -> PathPoint {
        let step_m = self.step_m();
        let from_start = ((arc_length_m - self.start_m) / step_m).max(0.0);
        let index = (from_start as usize).min(self.samples.len() - 2);
        let (a, b) = (&self.samples[index], &self.samples[index + 1]);
        let hermite = Hermite::at(from_start - index as f64, step_m);
        let sign = self.direction.sign();
        let ((sin_a, cos_a), (sin_b, cos_b)) = (self.headings[index], self.headings[index + 1]);
        PathPoint {
            arc_length_m,
            position: Point2 {
                x_m: hermite.value(a.position.x_m, -sign * sin_a, b.position.x_m, -sign * sin_b),
                y_m: hermite.value(a.position.y_m, sign * cos_a, b.position.y_m, sign * cos_b),
            },
            heading_rad: hermite.value(
                a.heading_rad,
                a.curvature_per_m,
                b.heading_rad,
                b.curvature_per_m,
            ),
            curvature_per_m: hermite.linear(a.curvature_per_m, b.curvature_per_m),
            direction: self.direction,
        }
    }
}

/// Returns the first sample that is not finite, or at which the curve stands still, turns back or has a gap;
/// samples are `step_m` of arc length apart, and `share_min` of it in distance at least.
fn first_irregular(samples: &[PathSample], step_m: f64, share_min: f64) -> Option<usize> {
    let finite = |sample: &PathSample| {
        sample.position.is_finite()
            && sample.heading_rad.is_finite()
            && sample.curvature_per_m.is_finite()
    };
    let irregular = samples.iter().position(|sample| !finite(sample));
    irregular.or_else(|| {
        samples.windows(2).position(|pair| {
            let chord_m = pair[0].position.distance_m(&pair[1].position);
            !(share_min..=CHORD_SHARE_MAX).contains(&(chord_m / step_m))
        })
    })
}

/// Weights of the cubic Hermite interpolation between two nodes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Hermite {
    ratio: f64,
    step: f64,
}

impl Hermite {
    /// Returns the interpolation at `ratio` (0 to 1) of an interval `step` long.
    pub(crate) fn at(ratio: f64, step: f64) -> Self {
        Self { ratio, step }
    }

    /// Returns the value from the values and the slopes at both nodes.
    pub(crate) fn value(&self, a: f64, slope_a: f64, b: f64, slope_b: f64) -> f64 {
        let u = self.ratio;
        let v = 1.0 - u;
        v * v * ((1.0 + 2.0 * u) * a + u * self.step * slope_a)
            + u * u * ((1.0 + 2.0 * v) * b - v * self.step * slope_b)
    }

    /// Returns the linear interpolation of the values at both nodes.
    pub(crate) fn linear(&self, a: f64, b: f64) -> f64 {
        a + self.ratio * (b - a)
    }
}
