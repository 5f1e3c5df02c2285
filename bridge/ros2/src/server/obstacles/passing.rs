//! A detour beside the path, past an obstacle, within a corridor.
//!
//! A detour is a sequence of blends of the distance from the path: aside, and back. Of the places beside the
//! path the one nearest to it is taken at which the footprint is free for as long as the obstacle is beside it.

use sidehill_controller::path::{Aside, Path, PathPoint};

/// Distance between two poses that are looked at, m.
const STEP_M: f64 = 0.1;
/// Distance between two places aside that are looked at, m.
const ASIDE_STEP_M: f64 = 0.05;
/// Distance between two places from which the way back is tried, m.
const BACK_STEP_M: f64 = 0.25;
/// The vehicle is aside by so much before the obstacle, m.
const LEAD_M: f64 = 0.2;
/// Shortest blend, m.
const BLEND_MIN_M: f64 = 1.0;
/// Share of the allowed curvature that a blend of the middle length has.
const BEND_SHARE: f64 = 0.5;
/// Largest second derivative of a blend between parallel detours, times L^2 / distance.
const BLEND_BEND: f64 = 5.774;
/// Blends that are tried, the gentlest first, as shares of the middle length.
const LENGTHS: [f64; 3] = [1.5, 1.0, 0.75];
/// Farthest that is looked ahead, m.
const LOOK_MAX_M: f64 = 12.0;

/// A change of the distance from the path: the polynomial of fifth degree that begins as the detour did before
/// and ends parallel to the path.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Blend {
    from_m: f64,
    length_m: f64,
    before: Aside,
    left_m: f64,
}

impl Blend {
    fn at(&self, arc_length_m: f64) -> Aside {
        let length_m = self.length_m;
        let u = (arc_length_m - self.from_m) / length_m;
        if u >= 1.0 {
            return Aside {
                left_m: self.left_m,
                ..Aside::NONE
            };
        }
        let value = self.before.left_m;
        let slope = self.before.slope * length_m;
        let bend = self.before.bend_per_m * length_m * length_m;
        // What the first three terms lack of value, slope and bend at the end.
        let lacks = [
            self.left_m - value - slope - 0.5 * bend,
            -slope - bend,
            -bend,
        ];
        let cubic = 10.0 * lacks[0] - 4.0 * lacks[1] + 0.5 * lacks[2];
        let quartic = -15.0 * lacks[0] + 7.0 * lacks[1] - lacks[2];
        let quintic = 6.0 * lacks[0] - 3.0 * lacks[1] + 0.5 * lacks[2];
        let terms = [value, slope, 0.5 * bend, cubic, quartic, quintic];
        let (mut left_m, mut first, mut second) = (0.0, 0.0, 0.0);
        for term in terms.into_iter().rev() {
            second = second * u + 2.0 * first;
            first = first * u + left_m;
            left_m = left_m * u + term;
        }
        Aside {
            left_m,
            slope: first / length_m,
            bend_per_m: second / (length_m * length_m),
        }
    }
}

/// How far the vehicle goes beside its path, by the arc length of the path.
#[derive(Debug, Clone, PartialEq, Default)]
pub(crate) struct Detour {
    blends: Vec<Blend>,
}

impl Detour {
    /// Returns the distance from the path at an arc length of it.
    pub(crate) fn at(&self, arc_length_m: f64) -> Aside {
        let begun = self
            .blends
            .iter()
            .rfind(|blend| blend.from_m <= arc_length_m);
        begun.map_or(Aside::NONE, |blend| blend.at(arc_length_m))
    }

    /// Returns this detour up to an arc length, and from there on another distance.
    fn then(&self, from_m: f64, length_m: f64, left_m: f64) -> Self {
        let before = self.at(from_m);
        let kept = self.blends.iter().filter(|blend| blend.from_m < from_m);
        let mut blends: Vec<Blend> = kept.copied().collect();
        blends.push(Blend {
            from_m,
            length_m,
            before,
            left_m,
        });
        Self { blends }
    }
}

/// An obstacle on the detour of a vehicle. Arc lengths are those of the path.
pub(crate) struct Passing<'a> {
    /// The path.
    pub(crate) path: &'a Path,
    /// The detour so far.
    pub(crate) detour: &'a Detour,
    /// From where on it may change, m.
    pub(crate) from_m: f64,
    /// Where it is blocked, m.
    pub(crate) blocked_m: f64,
    /// Farthest from the path, m.
    pub(crate) corridor_m: f64,
    /// Largest curvature of a detour, 1/m.
    pub(crate) max_curvature_per_m: f64,
}

impl Passing<'_> {
    /// Returns how far ahead an obstacle has to be seen to be passed gently, m.
    pub(crate) fn look_m(corridor_m: f64, max_curvature_per_m: f64) -> f64 {
        let blend_m = LENGTHS[0] * blend_m(corridor_m, max_curvature_per_m);
        (blend_m + 2.0 * LEAD_M + 1.0).min(LOOK_MAX_M)
    }

    /// Returns a detour past the obstacle, of those that are free the one nearest to the path; none where
    /// there is none. `is_free` says whether a vehicle at a point leaves room to all that is known.
    pub(crate) fn detour(&self, is_free: impl Fn(&PathPoint) -> bool) -> Option<Detour> {
        let left_m = self.detour.at(self.blocked_m).left_m;
        let side = if left_m < 0.0 { -1.0 } else { 1.0 };
        let count = (self.corridor_m / ASIDE_STEP_M + 1e-9) as i32;
        let places = (0..=count).flat_map(|step| {
            let away_m = f64::from(step) * ASIDE_STEP_M;
            let other = (step > 0).then_some(-side * away_m);
            std::iter::once(side * away_m).chain(other)
        });
        places
            .filter(|place_m| (place_m - left_m).abs() >= 0.5 * ASIDE_STEP_M)
            .find_map(|place_m| {
                LENGTHS
                    .into_iter()
                    .find_map(|share| self.detour_at(place_m, share, &is_free))
            })
    }

    /// Returns the detour to a place beside the path and back, where it is free.
    fn detour_at(
        &self,
        left_m: f64,
        share: f64,
        is_free: &impl Fn(&PathPoint) -> bool,
    ) -> Option<Detour> {
        let (begin_m, end_m) = self.piece();
        let before_m = self.detour.at(self.blocked_m).left_m;
        let aside_m = share * blend_m(left_m - before_m, self.max_curvature_per_m);
        let from_m = (self.blocked_m - LEAD_M - aside_m).max(self.from_m.max(begin_m));
        let beside_m = from_m + aside_m;
        let back_m = match left_m {
            0.0 => 0.0,
            _ => share * blend_m(left_m, self.max_curvature_per_m),
        };
        let last_m = end_m - back_m;
        if beside_m > last_m {
            return None;
        }
        let aside = self.detour.then(from_m, aside_m, left_m);
        if !self.is_free(&aside, from_m, beside_m, is_free) {
            return None;
        }
        if left_m == 0.0 {
            return Some(aside);
        }
        let look_m = (self.from_m + LOOK_MAX_M).min(last_m);
        let mut leave_m = beside_m;
        while leave_m <= look_m {
            let detour = aside.then(leave_m, back_m, 0.0);
            if self.is_free(&detour, leave_m, leave_m + back_m, is_free) {
                return Some(detour);
            }
            // Stay beside the path for longer.
            let next_m = leave_m + BACK_STEP_M;
            if !self.is_free(&aside, leave_m, next_m, is_free) {
                return None;
            }
            leave_m = next_m;
        }
        None
    }

    /// Returns the piece of the path on which the obstacle is, m.
    fn piece(&self) -> (f64, f64) {
        let mut piece = (0.0, self.path.length_m());
        for cusp_m in self.path.stops_m() {
            if cusp_m <= self.blocked_m {
                piece.0 = cusp_m;
            } else {
                piece.1 = piece.1.min(cusp_m);
            }
        }
        piece
    }

    /// Returns whether the vehicle can go on a detour from one arc length to another.
    fn is_free(
        &self,
        detour: &Detour,
        from_m: f64,
        to_m: f64,
        is_free: &impl Fn(&PathPoint) -> bool,
    ) -> bool {
        let steps = ((to_m - from_m) / STEP_M).ceil().max(1.0);
        (1..=steps as u32).all(|step| {
            let at_m = from_m + f64::from(step) / steps * (to_m - from_m);
            let aside = detour.at(at_m);
            let point = self.path.beside(at_m, &aside);
            // A blend that begins at an angle overshoots.
            let within = aside.left_m.abs() <= self.corridor_m + 1e-6;
            let gentle = point.curvature_per_m.abs() <= self.max_curvature_per_m;
            within && gentle && is_free(&point)
        })
    }
}

/// Returns the length of a blend between detours at a distance from each other, m.
fn blend_m(distance_m: f64, max_curvature_per_m: f64) -> f64 {
    let bend_per_m = BEND_SHARE * max_curvature_per_m;
    (BLEND_BEND * distance_m.abs() / bend_per_m)
        .sqrt()
        .max(BLEND_MIN_M)
}

#[cfg(test)]
mod tests;
