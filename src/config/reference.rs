//! The reference: a course or a recorded route, and its speed.

use super::{ConfigError, ConfigFile};
#[cfg(not(target_family = "wasm"))]
use crate::progress::Notice;
use serde::Deserialize;
use sidehill_controller::course::Course;
use sidehill_controller::path::{
    GeodeticOrigin, Path as SmoothPath, Point2, RawPoint, Route, RouteAction, Smoothed,
    SmoothingConfig, read_csv, read_gpx, smooth,
};
use sidehill_controller::speed_profile::{SpeedLimits, speed_profile};
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::terrain::{RoutePoint, RouteSmoothing, RouteTerrain, Terrain};
use std::path::{Path, PathBuf};

/// A recorded route as a reference.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RouteConfig {
    /// GPX, or CSV with `x_m,y_m` and, optionally, `z_m,direction,speed_m_s,action`.
    pub file: PathBuf,
    /// [How its points become a path](#path-smoothing).
    #[serde(default)]
    pub smoothing: SmoothingConfig,
}

/// The source of a reference, as a configuration file names it.
pub enum Source<'a> {
    /// A course by its shape.
    Course(&'a Course),
    /// The points of a file, smoothed; of a GPX file in the plane at a place, if one is given.
    Route(ConfigFile, SmoothingConfig, Option<GeodeticOrigin>),
}

impl<'a> Source<'a> {
    /// Returns the source that `file` names by its key `course` or `route`, exactly one of which it must have;
    /// `path` replaces both.
    ///
    /// # Errors
    /// [`ConfigError`] where neither or both are named, or a file cannot be read.
    pub fn of(
        file: &ConfigFile,
        course: Option<&'a Course>,
        route: Option<&RouteConfig>,
        datum: Option<GeodeticOrigin>,
        path: Option<&Path>,
    ) -> Result<Self, ConfigError> {
        let smoothing = route.map_or_else(SmoothingConfig::default, |route| route.smoothing);
        match (path, course, route) {
            (Some(path), _, _) => Ok(Self::Route(file.beside(path)?, smoothing, datum)),
            (None, None, Some(route)) => {
                Ok(Self::Route(file.sibling(&route.file)?, smoothing, datum))
            }
            (None, Some(course), None) => Ok(Self::Course(course)),
            (None, Some(_), Some(_)) => {
                Err(file.error("course and route: only one of them can be followed"))
            }
            (None, None, None) => Err(file.error("course or route: one of them is needed")),
        }
    }
}

/// Smoothing length for the elevations of a route that is the only known ground, m.
const SMOOTHING_M: f64 = 8.0;
/// Lateral distance from the route within which its elevations are valid there, m.
const ASIDE_M: f64 = 4.0;

/// A reference and its source.
pub struct LoadedReference {
    /// The trajectory to follow.
    pub trajectory: Trajectory,
    /// For a route: its file, and its points if all of them have elevations.
    pub route: Option<(ConfigFile, Option<Vec<RoutePoint>>)>,
    /// What is to be done along a route.
    pub actions: Vec<RouteAction>,
    /// How recorded points were processed, as text; empty for a course.
    pub note: String,
    /// What changes what is driven without being asked for, a line each.
    pub warnings: Vec<String>,
}

impl LoadedReference {
    /// Returns the ground along the route, where every point has an elevation.
    ///
    /// # Errors
    /// [`ConfigError`] where the elevations do not define a ground.
    pub fn ground(&self) -> Result<Option<Terrain>, ConfigError> {
        let Some((file, Some(points))) = &self.route else {
            return Ok(None);
        };
        ground_along(file, points).map(Some)
    }

    /// Builds the reference that `file` asks for.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault.
    pub fn build(
        file: &ConfigFile,
        source: Source<'_>,
        limits: &SpeedLimits,
    ) -> Result<Self, ConfigError> {
        let (route, smoothing, datum) = match source {
            Source::Course(course) => {
                let trajectory = course
                    .trajectory(limits)
                    .map_err(|error| file.error(format!("course: {error}")))?;
                return Ok(Self {
                    trajectory,
                    route: None,
                    actions: Vec::new(),
                    note: String::new(),
                    warnings: Vec::new(),
                });
            }
            Source::Route(route, smoothing, datum) => (route, smoothing, datum),
        };
        let points = read_route(&route, datum.as_ref())?;
        let smoothed = {
            #[cfg(not(target_family = "wasm"))]
            let _notice = Notice::begin(format!(
                "{}: smooths {} points",
                route.name(),
                points.points.len()
            ));
            smooth(&points.points, &smoothing.recorded(limits.track_width_m))
                .map_err(|error| route.error(error))?
        };
        let trajectory = speed_profile(&smoothed.path, limits, |_| f64::INFINITY)
            .map_err(|error| route.error(error))?;
        let mut note = format!(
            "{}: {} points, path of {:.1} m within {:.3} m of them ({:.3} m RMS), curvature up to {:.2} 1/m, {:.0} s",
            route.name(),
            points.points.len(),
            smoothed.path.length_m(),
            smoothed.deviation_max_m,
            smoothed.deviation_rms_m,
            smoothed.path.max_curvature_per_m(),
            trajectory.duration_s(),
        );
        note += &of_its_own(&points, &smoothed.path).unwrap_or_default();
        if let (Some(origin), None) = (&points.origin, datum) {
            note += &format!(
                ". x = 0, y = 0 is its first point; `datum: {{latitude_deg: {:.9}, longitude_deg: {:.9}, \
                 altitude_m: {:.3}}}` keeps it there",
                origin.latitude_deg, origin.longitude_deg, origin.elevation_m
            );
        }
        let elevations = points.points.iter().map(ground_point).collect();
        Ok(Self {
            trajectory,
            warnings: route_warnings(&route, &points, &smoothed.path),
            route: Some((route, elevations)),
            actions: actions(&points, &smoothed),
            note,
        })
    }
}

/// Returns the actions of a route at their places on its path.
fn actions(route: &Route, smoothed: &Smoothed) -> Vec<RouteAction> {
    let placed = route.actions.iter().map(|(index, text)| RouteAction {
        at_m: smoothed.arc_lengths_m[*index],
        text: text.clone(),
    });
    placed.collect()
}

/// Returns what a route has beside its points, as text to follow their description; none where it has nothing.
fn of_its_own(route: &Route, path: &SmoothPath) -> Option<String> {
    let speeds = path.speeds().iter().filter_map(|stretch| stretch.speed_m_s);
    let slowest_m_s = speeds
        .reduce(f64::min)
        .map(|slowest_m_s| format!("its slowest stretch at up to {slowest_m_s} m/s"));
    let actions = match route.actions.len() {
        0 => None,
        1 => Some("1 action".to_owned()),
        count => Some(format!("{count} actions")),
    };
    let parts: Vec<String> = slowest_m_s.into_iter().chain(actions).collect();
    (!parts.is_empty()).then(|| format!(", {}", parts.join(", ")))
}

/// Returns the ground along a route's points.
///
/// # Errors
/// [`ConfigError`] where the elevations do not define a ground.
pub fn ground_along(file: &ConfigFile, points: &[RoutePoint]) -> Result<Terrain, ConfigError> {
    RouteSmoothing::new(SMOOTHING_M, ASIDE_M)
        .map_err(|error| file.error(error))
        .and_then(|smoothing| {
            RouteTerrain::new(points, smoothing).map_err(|error| file.error(error))
        })
        .map(Terrain::Route)
}

/// Returns a point of a route as one of the ground, if it has an elevation.
pub fn ground_point(point: &RawPoint) -> Option<RoutePoint> {
    point.elevation_m.map(|z_m| RoutePoint {
        x_m: point.position.x_m,
        y_m: point.position.y_m,
        z_m,
    })
}

/// Returns what changes what is driven without being asked for, a line each.
pub fn route_warnings(file: &ConfigFile, route: &Route, path: &SmoothPath) -> Vec<String> {
    let notes = route.notes.iter();
    let mut warnings: Vec<String> = notes
        .map(|note| format!("{}: {note}", file.name()))
        .collect();
    let marked = route.points.iter().any(|point| point.direction.is_some());
    let at = |arc_length_m: f64| path.at(arc_length_m).position;
    if let (false, Some(cusps)) = (marked, named(path.cusps_m().map(at))) {
        warnings.push(format!(
            "{}: travel turns by more than 120 deg at {cusps}: from there it is driven the other way, in reverse \
             first; a column `direction` of a CSV says otherwise",
            file.name(),
        ));
    }
    if let Some(corners) = named(path.corners().map(|corner| corner.position)) {
        warnings.push(format!(
            "{}: the vehicle stops and turns on the spot at {corners}; a larger smoothing.max_deviation_m or \
             max_curvature_per_m lets it drive round",
            file.name(),
        ));
    }
    warnings
}

/// Returns the first of some places and how many more there are; none of no places.
pub fn named(places: impl Iterator<Item = Point2>) -> Option<String> {
    /// Places that are named.
    const NAMED: usize = 3;
    let places: Vec<Point2> = places.collect();
    let first = places.iter().take(NAMED);
    let first: Vec<String> = first
        .map(|Point2 { x_m, y_m }| format!("x = {x_m:.2} m, y = {y_m:.2} m"))
        .collect();
    match places.len() {
        0 => None,
        count if count > NAMED => Some(format!("{} and {} more", first.join("; "), count - NAMED)),
        _ => Some(first.join("; ")),
    }
}

/// Returns the points of a route file, CSV or GPX; of GPX in the plane at `datum`, or else at the first point.
///
/// # Errors
/// [`ConfigError`] with the file and line at fault.
pub fn read_route(file: &ConfigFile, datum: Option<&GeodeticOrigin>) -> Result<Route, ConfigError> {
    let route = match file.ending().as_deref() {
        Some("gpx") => read_gpx(file.text().as_bytes(), datum),
        Some("csv") => read_csv(file.text().as_bytes()),
        _ => return Err(file.error("a path must be a .csv or .gpx file")),
    };
    route.map_err(|error| file.error(error))
}
