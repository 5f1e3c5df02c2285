//! The reference: a course or a recorded route, and its speed.

use super::{ConfigError, ConfigFile};
use crate::progress::Notice;
use serde::Deserialize;
use sidehill_controller::course::Course;
use sidehill_controller::path::{Route, Smoothing, read_csv, read_gpx, smooth};
use sidehill_controller::speed_profile::{SpeedLimits, speed_profile};
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::terrain::{RoutePoint, RouteSmoothing, RouteTerrain, Terrain};
use std::path::{Path, PathBuf};

/// A recorded route as a reference.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RouteConfig {
    /// CSV or GPX file, relative to the file that names it.
    pub file: PathBuf,
    /// How its points become a path.
    #[serde(default)]
    pub smoothing: Smoothing,
}

/// The source of a reference, as a configuration file names it.
pub enum Source<'a> {
    /// A course by its shape.
    Course(&'a Course),
    /// The points of a file, smoothed.
    Route(ConfigFile, Smoothing),
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
        path: Option<&Path>,
    ) -> Result<Self, ConfigError> {
        let smoothing = route.map_or_else(Smoothing::default, |route| route.smoothing);
        match (path, course, route) {
            (Some(path), _, _) => Ok(Self::Route(file.beside(path)?, smoothing)),
            (None, None, Some(route)) => Ok(Self::Route(file.sibling(&route.file)?, smoothing)),
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
    /// How recorded points were processed, as text; empty for a course.
    pub note: String,
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
        let smoothing = RouteSmoothing::new(SMOOTHING_M, ASIDE_M);
        let ground = smoothing
            .map_err(|error| file.error(error))
            .and_then(|smoothing| {
                RouteTerrain::new(points, smoothing).map_err(|error| file.error(error))
            })?;
        Ok(Some(Terrain::Route(ground)))
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
        let (route, smoothing) = match source {
            Source::Course(course) => {
                let trajectory = course
                    .trajectory(limits)
                    .map_err(|error| file.error(format!("course: {error}")))?;
                return Ok(Self {
                    trajectory,
                    route: None,
                    note: String::new(),
                });
            }
            Source::Route(route, smoothing) => (route, smoothing),
        };
        let points = read_route(&route)?;
        let notice = Notice::begin(format!(
            "{}: smooths {} points",
            route.name(),
            points.points.len()
        ));
        let smoothed = smooth(&points.points, &smoothing).map_err(|error| route.error(error))?;
        drop(notice);
        let trajectory = speed_profile(&smoothed.path, limits, |_| f64::INFINITY)
            .map_err(|error| route.error(error))?;
        let note = format!(
            "{}: {} points, path of {:.1} m within {:.3} m of them ({:.3} m RMS), curvature up to {:.2} 1/m, {:.0} s",
            route.name(),
            points.points.len(),
            smoothed.path.length_m(),
            smoothed.deviation_max_m,
            smoothed.deviation_rms_m,
            smoothed.path.max_curvature_per_m(),
            trajectory.duration_s(),
        );
        let elevations = points
            .points
            .iter()
            .map(|point| {
                point.elevation_m.map(|z_m| RoutePoint {
                    x_m: point.position.x_m,
                    y_m: point.position.y_m,
                    z_m,
                })
            })
            .collect();
        Ok(Self {
            trajectory,
            route: Some((route, elevations)),
            note,
        })
    }
}

/// Returns the points of a route file, CSV or GPX.
///
/// # Errors
/// [`ConfigError`] with the file and line at fault.
pub fn read_route(file: &ConfigFile) -> Result<Route, ConfigError> {
    let route = match file.ending().as_deref() {
        Some("gpx") => read_gpx(file.text().as_bytes()),
        Some("csv") => read_csv(file.text().as_bytes()),
        _ => return Err(file.error("a path must be a .csv or .gpx file")),
    };
    route.map_err(|error| file.error(error))
}
