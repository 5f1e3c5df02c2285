//! The ground of a scenario.

use super::{ConfigError, ConfigFile};
use serde::Deserialize;
use sidehill_controller::path::{Aside, Point2};
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::terrain::{
    GridTerrain, PlaneTerrain, RoutePoint, RouteSmoothing, RouteTerrain, Terrain, ZonedTerrain,
};
use std::path::PathBuf;

/// The ground of a scenario.
#[derive(Debug, Clone, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub(super) enum TerrainConfig {
    /// Level ground. With braces, because a unit variant would accept any key.
    Level {},
    /// One plane.
    Plane(PlaneTerrain),
    /// Plane zones along an axis.
    Zones(ZonedTerrain),
    /// An elevation grid.
    Grid {
        /// ESRI ASCII grid or GeoTIFF, relative to the scenario.
        file: PathBuf,
        /// Easting of the world's origin in the grid's coordinates, m.
        #[serde(default)]
        origin_east_m: f64,
        /// Northing of the world's origin in the grid's coordinates, m.
        #[serde(default)]
        origin_north_m: f64,
    },
    /// The elevation recorded with the route.
    Route(RouteSmoothing),
}

impl TerrainConfig {
    /// Returns the ground, from the files that the scenario names and from its route.
    ///
    /// # Errors
    /// [`ConfigError`] with the file at fault.
    pub(super) fn build(
        &self,
        scenario: &ConfigFile,
        route: Option<&(ConfigFile, Option<Vec<RoutePoint>>)>,
        warnings: &mut Vec<String>,
    ) -> Result<Terrain, ConfigError> {
        Ok(match self {
            Self::Level {} => Terrain::Level,
            Self::Plane(plane) => Terrain::Plane(plane.clone()),
            Self::Zones(zones) => Terrain::Zones(zones.clone()),
            Self::Grid {
                file,
                origin_east_m,
                origin_north_m,
            } => {
                let grid = scenario.sibling(file)?;
                let terrain = GridTerrain::parse(grid.text()).map_err(|error| grid.error(error))?;
                warnings.extend(
                    terrain
                        .suspicion()
                        .map(|text| format!("{}: {text}", grid.name())),
                );
                Terrain::Grid(terrain.with_origin_at(*origin_east_m, *origin_north_m))
            }
            Self::Route(smoothing) => match route {
                None => {
                    return Err(scenario
                        .error("terrain.kind: route needs a route with elevations, not a course"));
                }
                Some((file, None)) => {
                    return Err(file.error(
                        "not every point has an elevation, which terrain.kind route needs",
                    ));
                }
                Some((file, Some(points))) => Terrain::Route(
                    RouteTerrain::new(points, *smoothing).map_err(|error| file.error(error))?,
                ),
            },
        })
    }
}

/// Spacing of the points of a path at which the ground is looked up, m.
const GROUND_STEP_M: f64 = 0.5;

/// Slope beyond which ground is a fault of its survey, deg.
const STEEP_DEG: f64 = 60.0;

/// Checks that there is ground under the whole path and as far to its sides as a vehicle is wide, and that it is
/// ground.
pub(super) fn on_the_ground(
    trajectory: &Trajectory,
    terrain: &Terrain,
    half_width_m: f64,
) -> Result<(), String> {
    let Some(path) = trajectory.path() else {
        return Ok(());
    };
    let steps = (path.length_m() / GROUND_STEP_M).ceil().max(1.0) as usize;
    for step in 0..=steps {
        let along_m = path.length_m() * step as f64 / steps as f64;
        let place = path.at(along_m).position;
        let under = terrain.surface(place.x_m, place.y_m).map_err(|error| {
            format!("the path leaves the ground {along_m:.1} m from its start: {error}")
        })?;
        let beside = [-half_width_m, half_width_m].map(|left_m| {
            let aside = Aside {
                left_m,
                ..Aside::NONE
            };
            path.beside(along_m, &aside).position
        });
        let beside = beside.into_iter().filter_map(|place| {
            let ground = terrain.surface(place.x_m, place.y_m).ok()?;
            Some((place, ground))
        });
        for (Point2 { x_m, y_m }, ground) in std::iter::once((place, under)).chain(beside) {
            let [along_x, along_y] = ground.gradient_in_world();
            let slope_deg = along_x.hypot(along_y).atan().to_degrees();
            if slope_deg > STEEP_DEG {
                let cell = match terrain {
                    Terrain::Grid(grid) => {
                        let (row, column) = grid.cell_at(x_m, y_m);
                        format!(", row {row}, column {column} of its grid (from 1, northwest)")
                    }
                    _ => String::new(),
                };
                return Err(format!(
                    "terrain: the ground is {slope_deg:.0} deg steep at x = {x_m:.2} m, y = {y_m:.2} m{cell}, \
                     {along_m:.1} m along the path; above {STEEP_DEG:.0} deg an elevation is wrong: correct it"
                ));
            }
        }
    }
    Ok(())
}
