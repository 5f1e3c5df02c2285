//! From the path of a client to a smooth curve with a speed profile.

use super::obstacles::{ApproachSpeed, Detour, Passing};
use super::outcome::Outcome;
use super::requested_path::RequestedPath;
use crate::node::message::action::code;
use sidehill_controller::course::{Course, Pivot};
use sidehill_controller::path::{
    Direction, MovedPath, Path, PathPoint, Point2, RawPoint, Smoothing, smooth,
};
use sidehill_controller::speed_profile::{SpeedLimits, speed_profile};
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::PlanarPose;
use std::sync::Arc;

/// Yaw rate of a pivot, rad/s.
const PIVOT_RAD_S: f64 = 0.3;

/// How a path becomes a route.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RouteSettings {
    /// How its points become a curve.
    pub smoothing: Smoothing,
    /// Bounds on the speed.
    pub limits: SpeedLimits,
    /// Point of the vehicle that follows paths.
    pub tracked_point: TrackedPoint,
    /// Whether the orientations of the poses say the direction of driving.
    pub use_orientations: bool,
}

/// A place on a route at which the vehicle may have to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Approach {
    /// Arc length of the stop, m.
    pub(crate) stop_at_m: f64,
    /// The speed towards it, and the slowest beyond it.
    pub(crate) speed: ApproachSpeed,
}

/// A detour beside the curve of a route.
#[derive(Debug)]
struct Beside {
    detour: Detour,
    moved: MovedPath,
}

/// A curve with its speed profile, in the frame of its path.
#[derive(Debug, Clone)]
pub struct ProfiledRoute {
    /// The curve.
    path: Arc<Path>,
    /// The curve that is driven instead, to pass an obstacle.
    beside: Option<Arc<Beside>>,
    /// The curve in time, as it is driven.
    pub trajectory: Trajectory,
    /// Its largest speed, m/s.
    pub speed_max_m_s: f64,
    /// Where it slows down for an obstacle.
    approach: Option<Approach>,
}

impl ProfiledRoute {
    /// Returns the route of a path for a vehicle at `pose`, in the path's frame.
    ///
    /// # Errors
    /// `INVALID_PATH` with the reason.
    pub fn build(
        path: &RequestedPath,
        pose: &PlanarPose,
        settings: &RouteSettings,
    ) -> Result<Self, Outcome> {
        let first = path.first_passage(pose);
        let first = first.min(path.poses.len().saturating_sub(2));
        let points = raw_points(path, first, settings.use_orientations);
        let smoothed = smooth(&points, &settings.smoothing).map_err(Outcome::invalid_path)?;
        let path = Arc::new(smoothed.path);
        Ok(Self {
            trajectory: profile(&path, &settings.limits, None)?,
            path,
            beside: None,
            speed_max_m_s: settings.limits.speed_max_m_s,
            approach: None,
        })
    }

    /// Returns the same curve at other speeds.
    ///
    /// # Errors
    /// `INVALID_PATH` with the reason.
    pub fn with_speeds(&self, limits: &SpeedLimits) -> Result<Self, Outcome> {
        let approach = self.approach;
        let driven = self
            .beside
            .as_ref()
            .map_or(&*self.path, |beside| &beside.moved.path);
        Ok(Self {
            path: Arc::clone(&self.path),
            beside: self.beside.clone(),
            trajectory: profile(driven, limits, approach)?,
            speed_max_m_s: limits.speed_max_m_s,
            approach,
        })
    }

    /// Returns the same curve for a vehicle on its way that slows down towards a place, or no longer.
    ///
    /// # Errors
    /// `INVALID_PATH` with the reason.
    pub(crate) fn approaching(
        mut self,
        approach: Option<Approach>,
        limits: &SpeedLimits,
    ) -> Result<Self, Outcome> {
        self.approach = approach;
        self.with_speeds(limits)
    }

    /// Returns the route past an obstacle at an arc length of it, for a vehicle on its way that leaves its course
    /// at an arc length `from_m` at the earliest; none where there is none within `corridor_m` of the curve.
    /// `is_free` says whether a vehicle at a point of the frame of the path leaves room to all that is known.
    ///
    /// Until there the new route is the old one, arc lengths included.
    pub(crate) fn passing(
        &self,
        (from_m, blocked_m): (f64, f64),
        corridor_m: f64,
        settings: &RouteSettings,
        is_free: impl Fn(&PathPoint) -> bool,
    ) -> Option<Self> {
        let on_the_curve = Detour::default();
        let passing = Passing {
            path: &self.path,
            detour: self
                .beside
                .as_ref()
                .map_or(&on_the_curve, |beside| &beside.detour),
            from_m: self.on_the_curve_m(from_m),
            blocked_m: self.on_the_curve_m(blocked_m),
            corridor_m,
            max_curvature_per_m: max_curvature_per_m(&self.path, settings),
        };
        let detour = passing.detour(is_free)?;
        let moved = self.path.moved_aside(|at_m| detour.at(at_m))?;
        let route = Self {
            beside: Some(Arc::new(Beside { detour, moved })),
            approach: None,
            ..self.clone()
        };
        route.with_speeds(&settings.limits).ok()
    }

    /// Returns how far ahead an obstacle has to be seen to be passed, m.
    pub(crate) fn passing_look_m(&self, corridor_m: f64, settings: &RouteSettings) -> f64 {
        Passing::look_m(corridor_m, max_curvature_per_m(&self.path, settings))
    }

    /// Returns how far to the left of the curve the route is at an arc length of it, m.
    pub(crate) fn aside_m(&self, arc_length_m: f64) -> f64 {
        self.beside.as_ref().map_or(0.0, |beside| {
            beside.detour.at(self.on_the_curve_m(arc_length_m)).left_m
        })
    }

    /// Returns how much of the curve is left at an arc length of the route, m.
    pub(crate) fn left_m(&self, arc_length_m: f64) -> f64 {
        (self.path.length_m() - self.on_the_curve_m(arc_length_m)).max(0.0)
    }

    /// Returns the arc length of the curve at an arc length of the route, m.
    fn on_the_curve_m(&self, arc_length_m: f64) -> f64 {
        self.beside
            .as_ref()
            .map_or(arc_length_m, |beside| beside.moved.original_m(arc_length_m))
    }

    /// Returns where it slows down for an obstacle.
    pub(crate) fn approach(&self) -> Option<&Approach> {
        self.approach.as_ref()
    }
}

/// Returns the points of a path from a pose on.
pub(crate) fn raw_points(
    path: &RequestedPath,
    first: usize,
    use_orientations: bool,
) -> Vec<RawPoint> {
    let (poses, indices): (Vec<PlanarPose>, Vec<usize>) =
        places(&path.poses[first..]).into_iter().unzip();
    (0..poses.len())
        .map(|index| RawPoint {
            position: Point2 {
                x_m: poses[index].x_m,
                y_m: poses[index].y_m,
            },
            elevation_m: None,
            direction: (use_orientations || path.oriented).then(|| direction(&poses, index)),
            speed_m_s: path.speed_m_s(first + indices[index]),
        })
        .collect()
}

/// Returns a pivot by an angle, rad, counter-clockwise, from a pose.
///
/// # Errors
/// The reason, where the limits do not allow it.
pub fn pivot(
    from: &PlanarPose,
    angle_rad: f64,
    limits: &SpeedLimits,
) -> Result<Trajectory, Outcome> {
    let course = Course::Pivot(Pivot {
        angle_deg: angle_rad.to_degrees(),
        yaw_rate_rad_s: pivot_rate_rad_s(limits),
        centre_forward_m: 0.0,
    });
    course
        .trajectory(limits)
        .map(|trajectory| trajectory.seen_from(from))
        .map_err(|error| Outcome::new(code::UNKNOWN, error.to_string()))
}

/// Returns the yaw rate of a pivot within the limits, rad/s.
pub fn pivot_rate_rad_s(limits: &SpeedLimits) -> f64 {
    PIVOT_RAD_S.min(2.0 * limits.steer_max_m_s / limits.track_width_m)
}

/// Returns the largest curvature of a course beside a path, 1/m.
fn max_curvature_per_m(path: &Path, settings: &RouteSettings) -> f64 {
    let smoothing = &settings.smoothing;
    smoothing
        .max_curvature_per_m
        .max(path.max_curvature_per_m())
}

fn profile(
    path: &Path,
    limits: &SpeedLimits,
    approach: Option<Approach>,
) -> Result<Trajectory, Outcome> {
    let cap_m_s = |point: &PathPoint| match &approach {
        Some(approach) => approach.speed.at(approach.stop_at_m - point.arc_length_m),
        None => f64::INFINITY,
    };
    speed_profile(path, limits, cap_m_s).map_err(Outcome::invalid_path)
}

/// How far from their middle poses are one place, m: less than the usual 5 cm from pose to pose.
const PLACE_M: f64 = 0.045;
/// Number of poses from which on they are: a vehicle stood there while its path was recorded.
const STANDING: usize = 5;

/// Returns the poses, those of a place at which many are made one in their middle, and the index of each, that of the
/// last one at a place.
fn places(poses: &[PlanarPose]) -> Vec<(PlanarPose, usize)> {
    let each = |range: std::ops::Range<usize>| range.map(|index| (poses[index], index));
    let mut found = Vec::with_capacity(poses.len());
    let mut from = 0;
    while from < poses.len() {
        let mut middle = poses[from];
        let near = |middle: &PlanarPose, at: &PlanarPose| {
            (at.x_m - middle.x_m).hypot(at.y_m - middle.y_m) < PLACE_M
        };
        let mut to = from + 1;
        while to < poses.len() && near(&middle, &poses[to]) {
            let share = 1.0 / (to + 1 - from) as f64;
            middle.x_m += share * (poses[to].x_m - middle.x_m);
            middle.y_m += share * (poses[to].y_m - middle.y_m);
            to += 1;
        }
        if to - from >= STANDING {
            middle.yaw_rad = poses[to - 1].yaw_rad;
            found.push((middle, to - 1));
        } else {
            found.extend(each(from..to));
        }
        from = to;
    }
    // All that is left is where the vehicle stands.
    match found.len() {
        1 => each(0..poses.len()).collect(),
        _ => found,
    }
}

/// Returns the direction of driving from a pose to the next, by its heading.
fn direction(poses: &[PlanarPose], index: usize) -> Direction {
    let from = index.min(poses.len().saturating_sub(2));
    let Some(next) = poses.get(from + 1) else {
        return Direction::Forward;
    };
    let here = &poses[from];
    let (sin, cos) = here.yaw_rad.sin_cos();
    if -sin * (next.x_m - here.x_m) + cos * (next.y_m - here.y_m) < 0.0 {
        Direction::Reverse
    } else {
        Direction::Forward
    }
}

#[cfg(test)]
mod tests;
