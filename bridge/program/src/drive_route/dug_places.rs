//! Places at which the vehicle has dug in, and legs that lead round them.

use super::legs::RouteLeg;
use anyhow::{Result, ensure};
use sidehill_controller::path::{Point2, RouteAction, Smoothing};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::vehicle::Vehicle;
use sidehill_ros2::server::requested_path::RequestedPath;
use sidehill_ros2::server::way_round::WayRound;
use std::fmt::Write as _;

/// Distance at which a place is passed, m, to either side.
const ASIDE: Bounds = Bounds::new(0.3, 5.0, "m");

/// Where the vehicle has dug in, and how it goes round.
pub(super) struct DugPlaces {
    /// None where it does not.
    way: Option<WayRound>,
    places: Vec<Point2>,
}

impl DugPlaces {
    /// Returns the places that are known at the start, which are passed so far aside, m; none where they are not.
    ///
    /// # Errors
    /// A distance out of range, or one for which a retreat is too short.
    pub(super) fn new(
        (aside_m, places): (Option<f64>, &[Point2]),
        (vehicle, smoothing): (&Vehicle, Smoothing),
        retreat: (Option<f64>, Bounds),
    ) -> Result<Self> {
        let way = aside_m.map(|aside_m| WayRound {
            aside_m,
            along_m: 2.0 * vehicle.base_half_length_m,
            smoothing,
        });
        if let (Some(way), (Some(retreat_m), allowed)) = (&way, retreat) {
            let aside_m = way.aside_m;
            ASIDE.check("--go-round-m", aside_m.abs())?;
            let least_m = least_retreat_m(way, allowed);
            let would = match least_m {
                Some(least_m) => format!("--retreat-m {least_m:.1} would do"),
                None => format!(
                    "{} m would not do either, a smaller distance may",
                    allowed.high
                ),
            };
            ensure!(
                least_m.is_some_and(|least_m| retreat_m >= least_m - 1e-9),
                "--go-round-m {aside_m}: a vehicle of {:.2} m that was driven back by {retreat_m} m has no way round: {would}",
                way.along_m
            );
        }
        Ok(Self {
            way,
            places: places.to_vec(),
        })
    }

    /// Returns whether the vehicle goes round places where it has dug in.
    pub(super) fn are_passed(&self) -> bool {
        self.way.is_some()
    }

    /// Marks a place; returns whether it is another one than those before.
    pub(super) fn mark(&mut self, place: Point2) -> bool {
        let reach_m = self.way.map_or(0.0, |way| way.along_m + way.aside_m.abs());
        let known = self.places.iter().any(|at| at.distance_m(&place) < reach_m);
        if !known {
            self.places.push(place);
        }
        !known
    }

    /// Returns a leg, as it leads round the places for a vehicle that is so far along it, m.
    ///
    /// # Errors
    /// The place without a way round it.
    pub(super) fn lead(&self, leg: &RouteLeg, from_m: f64) -> Result<RouteLeg, String> {
        let same = || Ok(leg.clone());
        let Some(way) = self.way else {
            return same();
        };
        let reach_m = way.along_m.hypot(way.aside_m);
        let is_near = |place: &Point2| {
            let poses = leg.path.poses.iter();
            poses
                .into_iter()
                .any(|pose| at(pose).distance_m(place) < reach_m)
        };
        let near: Vec<Point2> = self.places.iter().copied().filter(is_near).collect();
        if near.is_empty() {
            return same();
        }
        let led = way.lead(&leg.path, from_m, &near);
        let Some(moved) = led.map_err(|outcome| outcome.message)? else {
            return same();
        };
        let actions = leg.actions.iter().map(|action| RouteAction {
            at_m: moved.moved_m(action.at_m),
            text: action.text.clone(),
        });
        Ok(RouteLeg {
            name: leg.name.clone(),
            path: RequestedPath::from_curve("", &moved.path),
            actions: actions.collect(),
            ..*leg
        })
    }

    /// Returns the options by which another drive knows the places.
    pub(super) fn options(&self) -> String {
        let mut options = String::new();
        for Point2 { x_m, y_m } in self.places.iter().filter(|_| self.are_passed()) {
            // Writing to a text does not fail.
            let _ = write!(options, " --stuck-at {x_m:.2},{y_m:.2}");
        }
        options
    }
}

/// Returns the place of a pose.
fn at(pose: &PlanarPose) -> Point2 {
    Point2 {
        x_m: pose.x_m,
        y_m: pose.y_m,
    }
}

/// Returns the shortest retreat on a straight path after which there is a way round, m, of those allowed.
fn least_retreat_m(way: &WayRound, allowed: Bounds) -> Option<f64> {
    const PLACE_M: f64 = 20.0;
    let poses = (0..=400).map(|step| PlanarPose {
        y_m: 0.1 * f64::from(step),
        ..PlanarPose::default()
    });
    let path = RequestedPath {
        poses: poses.collect(),
        ..RequestedPath::default()
    };
    let place = Point2 {
        x_m: 0.0,
        y_m: PLACE_M,
    };
    let steps = ((allowed.high - allowed.low) / 0.1).round() as usize;
    let retreats = (0..=steps).map(|step| allowed.low + 0.1 * step as f64);
    retreats
        .into_iter()
        .find(|retreat_m| way.lead(&path, PLACE_M - retreat_m, &[place]).is_ok())
}

#[cfg(test)]
mod tests {
    use super::super::RETREAT;
    use super::*;

    fn smoothing() -> Smoothing {
        Smoothing {
            max_curvature_per_m: 2.0,
            ..Smoothing::default()
        }
    }

    fn places(aside_m: Option<f64>, retreat_m: f64, places: &[Point2]) -> Result<DugPlaces> {
        let vehicle = Vehicle::j8();
        DugPlaces::new(
            (aside_m, places),
            (&vehicle, smoothing()),
            (Some(retreat_m), RETREAT),
        )
    }

    fn point(x_m: f64, y_m: f64) -> Point2 {
        Point2 { x_m, y_m }
    }

    /// Along Y_g, with an action at 3 m and one at 15 m.
    fn leg() -> RouteLeg {
        let poses = (0..=200).map(|step| PlanarPose {
            y_m: 0.1 * f64::from(step),
            ..PlanarPose::default()
        });
        let action = |at_m| RouteAction {
            at_m,
            text: format!("at {at_m}"),
        };
        RouteLeg {
            name: "lane 2 of 2".to_owned(),
            path: RequestedPath {
                poses: poses.collect(),
                ..RequestedPath::default()
            },
            actions: [3.0, 15.0].map(action).to_vec(),
            begins_m: 20.0,
            ends_m: 40.0,
        }
    }

    #[test]
    fn a_place_is_marked_once_and_later_legs_lead_round_it() {
        let mut dug = places(Some(0.8), 4.0, &[]).unwrap();
        assert!(dug.mark(point(0.0, 10.0)));
        assert!(
            !dug.mark(point(0.5, 12.0)),
            "within a length of the vehicle"
        );
        assert!(dug.mark(point(0.0, 14.0)));
        assert_eq!(
            dug.options(),
            " --stuck-at 0.00,10.00 --stuck-at 0.00,14.00"
        );
        let round = dug.lead(&leg(), 5.0).unwrap();
        let beside = round
            .path
            .poses
            .iter()
            .filter(|pose| (10.0..14.0).contains(&pose.y_m));
        assert!(beside.clone().count() > 35 && beside.into_iter().all(|pose| pose.x_m < -0.7));
        // Actions keep their places, and all that is driven its length.
        assert_eq!((round.begins_m, round.ends_m), (20.0, 40.0));
        let longer_m = round.length_m() - 20.0;
        assert!((0.1..1.0).contains(&longer_m), "{longer_m}");
        let [before, behind] = [0, 1].map(|index| round.actions[index].at_m);
        assert!((before - 3.0).abs() < 0.01 && behind > 15.05);
        assert!(
            dug.lead(&leg(), 9.5)
                .is_err_and(|reason| reason.contains("y 10.00 m"))
        );
    }

    #[test]
    fn a_retreat_has_to_be_long_enough_for_the_way_round() {
        let refused = |aside_m, retreat_m| {
            let error = places(Some(aside_m), retreat_m, &[]).err();
            error.map_or_else(String::new, |error| error.to_string())
        };
        assert_eq!(refused(0.8, 4.5), "");
        let reason = refused(0.8, 1.0);
        let told = reason.split_once("--retreat-m ").unwrap().1;
        let least_m: f64 = told.strip_suffix(" would do").unwrap().parse().unwrap();
        // A length of the vehicle at least.
        assert!(least_m > 2.1, "{reason}");
        assert_eq!(refused(0.8, least_m), "");
        assert_ne!(refused(0.8, least_m - 0.1), "");
        assert!(refused(4.0, 5.0).contains("a smaller distance may"));
        assert!(refused(-0.1, 5.0).starts_with("--go-round-m"));
    }

    #[test]
    fn without_a_way_round_legs_stay_as_they_are_and_no_option_is_told() {
        let mut dug = places(None, 1.0, &[]).unwrap();
        assert!(dug.mark(point(0.0, 10.0)) && dug.mark(point(0.0, 10.0)));
        assert!(dug.lead(&leg(), 0.0).unwrap().path == leg().path);
        assert_eq!((dug.options(), dug.are_passed()), (String::new(), false));
    }
}
