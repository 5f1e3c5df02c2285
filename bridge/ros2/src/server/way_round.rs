//! A path led round places that the vehicle must not drive over, by the detours that pass obstacles.

use super::obstacles::{Detour, Passing};
use super::outcome::Outcome;
use super::requested_path::RequestedPath;
use super::route::raw_points;
use sidehill_controller::path::{MovedPath, Path, PathPoint, Point2, Smoothing, smooth};

/// Distance between two places of a path that are looked at, m.
const STEP_M: f64 = 0.05;
/// Farthest ahead of a place that a detour leaves the path, m.
const AHEAD_MAX_M: f64 = 6.0;
/// How much farther than stated a detour may lie, m, in a bend.
const BEYOND_M: f64 = 0.3;
/// Error of a distance, m.
const ROUNDING_M: f64 = 1e-3;
/// How much nearer than stated a path that stays as it is may pass a place, m: more than a detour does between two of
/// the poses at which it is looked at.
const NEARER_M: f64 = 0.05;

/// How places are passed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct WayRound {
    /// Distance at which the origin of the vehicle passes a place, m: to the left of travel, negative to the right.
    pub aside_m: f64,
    /// Distance ahead of the vehicle and behind it within which a place has to be so far aside, m.
    pub along_m: f64,
    /// How poses become a curve, and the largest curvature of a detour.
    pub smoothing: Smoothing,
}

impl WayRound {
    /// Returns the curve of a path, moved so that a vehicle which is at `from_m` along it passes these places; none where
    /// it does so anyhow. Up to `from_m` it is as before.
    ///
    /// # Errors
    /// The place without a way round it within the curvature of the paths, or a path that is no curve.
    pub fn lead(
        &self,
        path: &RequestedPath,
        from_m: f64,
        places: &[Point2],
    ) -> Result<Option<MovedPath>, Outcome> {
        let points = raw_points(path, 0, true);
        let smoothed = smooth(&points, &self.smoothing).map_err(Outcome::invalid_path)?;
        let path = smoothed.path;
        let mut detour = Detour::default();
        // A detour past one place may lead over another.
        for _ in places {
            let Some((blocked_m, place)) = self.first_met(&path, &detour, from_m, places) else {
                break;
            };
            detour = self
                .detour(&path, &detour, (from_m, blocked_m), places)
                .ok_or_else(|| no_way(place))?;
        }
        if let Some((_, place)) = self.first_met(&path, &detour, from_m, places) {
            return Err(no_way(place));
        }
        if detour == Detour::default() {
            return Ok(None);
        }
        let moved = path.moved_aside(|at_m| detour.at(at_m));
        let bend = "the way round leads into the centre of a bend";
        moved.map(Some).ok_or_else(|| Outcome::invalid_path(bend))
    }

    /// Returns the first place that a vehicle on a detour meets from an arc length on, and where, m.
    fn first_met(
        &self,
        path: &Path,
        detour: &Detour,
        from_m: f64,
        places: &[Point2],
    ) -> Option<(f64, Point2)> {
        let steps = ((path.length_m() - from_m) / STEP_M).ceil().max(0.0) as usize;
        (0..=steps).find_map(|step| {
            let at_m = (from_m + STEP_M * step as f64).min(path.length_m());
            let point = path.beside(at_m, &detour.at(at_m));
            let met = places.iter().find(|place| self.meets(&point, place));
            met.map(|place| (at_m, *place))
        })
    }

    /// Returns the detour past places of which one is met at an arc length, for a vehicle at another.
    fn detour(
        &self,
        path: &Path,
        detour: &Detour,
        (from_m, blocked_m): (f64, f64),
        places: &[Point2],
    ) -> Option<Detour> {
        let passing = Passing {
            path,
            detour,
            from_m: from_m.max(blocked_m - AHEAD_MAX_M),
            blocked_m,
            // A place may lie beside the path on the side on which it is passed.
            corridor_m: 2.0 * self.aside_m.abs() + BEYOND_M,
            max_curvature_per_m: (self.smoothing.max_curvature_per_m)
                .max(path.max_curvature_per_m()),
        };
        passing.detour(|point| places.iter().all(|place| self.passes(point, place)))
    }

    /// Returns whether a vehicle at a point is at a place, or too near to it.
    fn meets(&self, point: &PathPoint, place: &Point2) -> bool {
        let seen = seen_from(point, place);
        seen.ahead_m.abs() < self.along_m && seen.left_m.abs() < self.aside_m.abs() - NEARER_M
    }

    /// Returns whether a vehicle at a point passes a place on the stated side, or is far from it.
    fn passes(&self, point: &PathPoint, place: &Point2) -> bool {
        let seen = seen_from(point, place);
        let clear_m = -seen.left_m * self.aside_m.signum();
        let far_m = 4.0 * self.aside_m.abs();
        seen.ahead_m.abs() >= self.along_m
            || clear_m >= self.aside_m.abs() - ROUNDING_M
            || seen.left_m.abs() >= far_m
    }
}

/// Where a place is, seen by a vehicle in its direction of travel, m.
struct SeenPlace {
    ahead_m: f64,
    left_m: f64,
}

fn seen_from(point: &PathPoint, place: &Point2) -> SeenPlace {
    let (x_m, y_m) = (
        place.x_m - point.position.x_m,
        place.y_m - point.position.y_m,
    );
    let (sin, cos) = point.travel_heading_rad().sin_cos();
    SeenPlace {
        ahead_m: -sin * x_m + cos * y_m,
        left_m: -cos * x_m - sin * y_m,
    }
}

fn no_way(place: Point2) -> Outcome {
    let Point2 { x_m, y_m } = place;
    Outcome::invalid_path(format!("there is no way round x {x_m:.2} m, y {y_m:.2} m"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use sidehill_controller::path::RawPoint;

    const ROUND: WayRound = WayRound {
        aside_m: 0.8,
        along_m: 1.0,
        smoothing: Smoothing {
            max_curvature_per_m: 1.0,
            max_deviation_m: 0.5,
            spacing_m: 0.1,
            accuracy_m: None,
        },
    };

    fn at(x_m: f64, y_m: f64) -> Point2 {
        Point2 { x_m, y_m }
    }

    /// A path through points, forward.
    fn path(points: impl Iterator<Item = (f64, f64)>) -> RequestedPath {
        let points: Vec<RawPoint> = points
            .map(|(x_m, y_m)| RawPoint {
                position: at(x_m, y_m),
                ..RawPoint::default()
            })
            .collect();
        let curve = smooth(&points, &ROUND.smoothing).unwrap().path;
        RequestedPath::from_curve("", &curve)
    }

    /// Along Y_g: left is towards -X_g.
    fn straight() -> RequestedPath {
        path([(0.0, 0.0), (0.0, 40.0)].into_iter())
    }

    /// Returns the least distance of a curve from a place.
    fn nearest_m(moved: &MovedPath, place: Point2) -> f64 {
        let steps = (moved.path.length_m() / 0.02) as usize;
        let distances = (0..steps).map(|step| {
            let point = moved.path.at(0.02 * step as f64);
            point.position.distance_m(&place)
        });
        distances.fold(f64::INFINITY, f64::min)
    }

    #[test]
    fn a_place_is_passed_at_the_stated_distance_on_the_stated_side() {
        for aside_m in [0.8, -0.8, 0.53] {
            let round = WayRound { aside_m, ..ROUND };
            let place = at(0.0, 20.0);
            let moved = round.lead(&straight(), 10.0, &[place]).unwrap().unwrap();
            let away_m = nearest_m(&moved, place);
            assert!(
                (aside_m.abs() - 0.01..aside_m.abs() + 0.06).contains(&away_m),
                "{away_m}"
            );
            let abeam = moved.path.at(moved.moved_m(20.0)).position;
            assert!(-abeam.x_m * aside_m.signum() > aside_m.abs() - 0.01);
            // Nor does what lies ahead and behind of the origin come nearer.
            for step in 0..2000 {
                let point = moved.path.at(0.02 * f64::from(step));
                let (sin, cos) = point.heading_rad.sin_cos();
                for tenth in -9..=9 {
                    let ahead_m = 0.1 * f64::from(tenth);
                    let (x_m, y_m) = (point.position.x_m, point.position.y_m);
                    let part = at(x_m - ahead_m * sin, y_m + ahead_m * cos);
                    let away_m = part.distance_m(&place);
                    assert!(away_m > aside_m.abs() - 0.05, "{part:?}: {away_m}");
                }
            }
            // Before and behind, the path is as it was.
            for at_m in [0.0, 10.0, 30.0, 40.0] {
                let point = moved.path.at(moved.moved_m(at_m)).position;
                assert!(point.distance_m(&at(0.0, at_m)) < 0.02, "{at_m}: {point:?}");
            }
            assert!(moved.path.max_curvature_per_m() < 1.05);
        }
    }

    #[test]
    fn a_path_that_passes_a_place_anyhow_stays_as_it_is() {
        for place in [at(0.85, 20.0), at(-0.85, 20.0), at(0.0, 5.0), at(0.0, -3.0)] {
            assert_eq!(ROUND.lead(&straight(), 10.0, &[place]).unwrap(), None);
        }
        assert_eq!(ROUND.lead(&straight(), 0.0, &[]).unwrap(), None);
    }

    #[test]
    fn a_vehicle_that_stands_too_near_has_no_way_round() {
        let error = ROUND.lead(&straight(), 19.0, &[at(0.0, 20.0)]).unwrap_err();
        assert!(error.message.contains("no way round x 0.00 m, y 20.00 m"));
        // Nor is there one at the end of the path, which stays where it is.
        assert!(ROUND.lead(&straight(), 0.0, &[at(0.0, 39.5)]).is_err());
    }

    #[test]
    fn a_way_round_is_found_wherever_there_is_room() {
        for tenth in 0..40 {
            let place = at(0.0, 8.0 + 0.1 * f64::from(tenth) + 0.03);
            let found = ROUND.lead(&straight(), 0.0, &[place]);
            assert!(found.is_ok_and(|moved| moved.is_some()), "{place:?}");
        }
    }

    #[test]
    fn several_places_are_passed_one_after_the_other() {
        let places = [at(0.0, 10.0), at(-0.5, 12.0), at(0.0, 30.0)];
        let moved = ROUND.lead(&straight(), 0.0, &places).unwrap().unwrap();
        for place in places {
            let away_m = nearest_m(&moved, place);
            assert!(away_m > 0.79, "{place:?}: {away_m}");
        }
    }

    #[test]
    fn a_place_in_a_bend_is_passed_outside_and_inside() {
        let bend = |i: u32| {
            let (sin, cos) = (0.02 * f64::from(i)).sin_cos();
            (6.0 * cos, 6.0 * sin)
        };
        let circle = path((0..=150).map(bend));
        let (sin, cos) = 1.5_f64.sin_cos();
        // Counter-clockwise: the centre is to the left.
        for (aside_m, radius_m) in [(0.8, 5.2), (-0.8, 6.8)] {
            let round = WayRound { aside_m, ..ROUND };
            let place = at(6.0 * cos, 6.0 * sin);
            let moved = round.lead(&circle, 0.0, &[place]).unwrap().unwrap();
            let beside = moved.path.at(moved.moved_m(9.0)).position;
            let away_m = beside.x_m.hypot(beside.y_m) - radius_m;
            assert!(
                -aside_m.signum() * away_m > -0.02 && away_m.abs() < 0.3,
                "{away_m}"
            );
        }
    }
}
