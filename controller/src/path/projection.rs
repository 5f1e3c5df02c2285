//! Nearest points of a path, on the branch the vehicle is on.

use super::{Path, PathPoint, Point2};

/// The nearest point of a path and the offset from it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projected {
    /// The point on the path; its arc length counts laps where the path is closed.
    pub point: PathPoint,
    /// Signed distance, m, positive to the left of the direction of travel.
    pub cross_track_m: f64,
}

/// How far from a known arc length the nearest point is looked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Window {
    /// Against the direction of travel, m.
    pub behind_m: f64,
    /// Along the direction of travel, m.
    pub ahead_m: f64,
}

/// Weight of the distance from the expected arc length where branches are about equally near.
const BRANCH_WEIGHT: f64 = 1e-2;
const NEWTON_STEPS: usize = 12;
/// Step of Newton's method that ends it, m.
const TOLERANCE_M: f64 = 1e-12;
/// Two points cannot be farther apart than the path between them, except for interpolation errors.
const STRETCH: f64 = 1.05;

impl Path {
    /// Returns the nearest point within `window` of `around_m`.
    ///
    /// Of places about equally near, the one closer to `around_m` along the path is returned.
    /// `position` must be finite.
    pub fn nearest_within(&self, position: &Point2, around_m: f64, window: &Window) -> Projected {
        let (laps, around_m) = self.lap(around_m);
        let (mut low_m, mut high_m) = (around_m - window.behind_m, around_m + window.ahead_m);
        if !self.closed {
            low_m = low_m.clamp(0.0, self.length_m);
            high_m = high_m.clamp(0.0, self.length_m);
        }
        let cost = |point: &PathPoint| branch_cost(point, position, around_m);
        let mut nearest = self.refine(
            position,
            self.best_sample(position, around_m, (low_m, high_m)),
            (low_m, high_m),
            TOLERANCE_M,
        );
        // The ways to and from a cusp lie on each other: both are refined before they are compared.
        for cusp_m in self.cusps_m() {
            if !(low_m..high_m).contains(&cusp_m) {
                continue;
            }
            for bounds in [(low_m, cusp_m.next_down()), (cusp_m, high_m)] {
                let coarse_m = self.best_sample(position, around_m, bounds);
                let other = self.refine(position, coarse_m, bounds, TOLERANCE_M);
                if cost(&other) < cost(&nearest) {
                    nearest = other;
                }
            }
        }
        let (_, left_m) = nearest.offsets_to(position);
        let sign = if left_m < 0.0 { -1.0 } else { 1.0 };
        let cross_track_m = sign * nearest.position.distance_m(position);
        nearest.arc_length_m += laps * self.length_m;
        nearest.heading_rad += laps * self.turn_per_lap_rad();
        Projected {
            point: nearest,
            cross_track_m,
        }
    }

    /// Returns the point near `from_m` that is nearest to `position`, to a few mm, on the piece of the
    /// path on which `around_m` lies and within `window` of that.
    ///
    /// Newton's method from there: quick where `from_m` is a good guess. `position` must be finite.
    pub fn nearest_from(
        &self,
        position: &Point2,
        from_m: f64,
        around_m: f64,
        window: &Window,
    ) -> PathPoint {
        /// The point moves on the path by the square of this, over the radius of a bend.
        const TOLERANCE_M: f64 = 1e-2;
        let (mut low_m, mut high_m) = (around_m - window.behind_m, around_m + window.ahead_m);
        if !self.closed {
            let within_m = around_m.clamp(0.0, self.length_m);
            let piece = &self.pieces[self.piece_index(within_m)];
            low_m = low_m.max(piece.start_m);
            high_m = high_m.min(piece.end_m().next_down());
        }
        let from_m = from_m.clamp(low_m, high_m.max(low_m));
        self.refine(position, from_m, (low_m, high_m), TOLERANCE_M)
    }

    /// Returns the arc length, of a set no sparser than the samples, with the least cost. The set is that of whole steps,
    /// so that the result does not depend on where the search begins.
    ///
    /// Between two points there is at most as much distance as path: far from the path the samples
    /// that cannot have less than the least known are passed over. Each sample is looked at once at most.
    fn best_sample(&self, position: &Point2, around_m: f64, (low_m, high_m): (f64, f64)) -> f64 {
        let step_m = super::SAMPLE_STEP_M;
        let (first, last) = ((low_m / step_m).ceil(), (high_m / step_m).floor());
        let span = last - first;
        // Also where the bounds are so large that they are no numbers.
        if !(0.0..f64::INFINITY).contains(&span) {
            return low_m;
        }
        let sample = |i: usize| self.at((first + i as f64) * step_m);
        let count = span as usize;
        let expected = ((around_m / step_m).round() - first).clamp(0.0, span);
        let mut least = branch_cost(&sample(expected as usize), position, around_m);
        let mut best = (f64::INFINITY, low_m);
        let mut i = 0;
        while i <= count {
            let point = sample(i);
            let found = branch_cost(&point, position, around_m);
            if found < best.0 {
                best = (found, (first + i as f64) * step_m);
                least = least.min(found);
            }
            let spare_m = point.position.distance_m(position) - least.sqrt();
            i = i.saturating_add(((spare_m / (STRETCH * step_m)) as usize).max(1));
        }
        best.1
    }

    /// Solves (position - p(s)) . t(s) = 0 for s by Newton's method within the bounds and the
    /// piece on which the search starts.
    fn refine(
        &self,
        position: &Point2,
        from_m: f64,
        bounds_m: (f64, f64),
        tolerance_m: f64,
    ) -> PathPoint {
        let (mut low_m, mut high_m) = bounds_m;
        if !self.closed {
            let piece = &self.pieces[self.piece_index(from_m)];
            low_m = low_m.max(piece.start_m);
            // Short of the end, because there the piece after a cusp begins.
            high_m = high_m.min(piece.end_m().next_down());
        }
        let mut arc_length_m = from_m.clamp(low_m, high_m.max(low_m));
        let mut point = self.at(arc_length_m);
        for _ in 0..NEWTON_STEPS {
            let (along_m, left_m) = point.offsets_to(position);
            // d(along)/ds = -(1 - curvature * left); kept away from 0 at the centre of curvature.
            let slope = (1.0 - point.curvature_per_m * left_m).max(0.2);
            let next_m = (arc_length_m + along_m / slope).clamp(low_m, high_m.max(low_m));
            let step_m = (next_m - arc_length_m).abs();
            arc_length_m = next_m;
            point = self.at(arc_length_m);
            if step_m < tolerance_m {
                break;
            }
        }
        point
    }
}

/// Returns the squared distance of a point, and a little for its distance from `around_m` along the path.
fn branch_cost(point: &PathPoint, position: &Point2, around_m: f64) -> f64 {
    let off_m = point.arc_length_m - around_m;
    squared_distance(&point.position, position) + BRANCH_WEIGHT * off_m * off_m
}

fn squared_distance(a: &Point2, b: &Point2) -> f64 {
    (a.x_m - b.x_m).powi(2) + (a.y_m - b.y_m).powi(2)
}
