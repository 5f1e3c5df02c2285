//! Ground under the vehicle: height and normal at a place, and so the attitude at a heading.

mod esri;
mod grid;
mod nodes;
mod plane;
mod route;
mod zones;

pub use grid::{GridExtent, GridTerrain};
pub use plane::PlaneTerrain;
pub use route::{RoutePoint, RouteSmoothing, RouteTerrain};
pub use zones::ZonedTerrain;

use crate::bounds::RangeError;
use crate::frames::Attitude;
use nalgebra::Vector3;

/// Ground of one of the known kinds; cheap to clone, queries do not allocate.
#[derive(Debug, Clone)]
pub enum Terrain {
    /// Level ground at height 0.
    Level,
    /// One inclined plane.
    Plane(PlaneTerrain),
    /// Plane zones of different slope along an axis, with smooth transitions.
    Zones(ZonedTerrain),
    /// Heights on a regular grid.
    Grid(GridTerrain),
    /// Heights known along a route only.
    Route(RouteTerrain),
}

/// The ground at a place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Height Z_g, m.
    pub height_m: f64,
    /// Upward unit normal, (-dh/dX_g, -dh/dY_g, 1) normalised.
    pub normal_in_world: Vector3<f64>,
}

impl Surface {
    /// Returns the surface of this height and this gradient (dh/dX_g, dh/dY_g).
    pub fn from_gradient(height_m: f64, gradient_in_world: [f64; 2]) -> Self {
        let [along_x, along_y] = gradient_in_world;
        Self {
            height_m,
            normal_in_world: Vector3::new(-along_x, -along_y, 1.0).normalize(),
        }
    }

    /// Returns (dh/dX_g, dh/dY_g).
    pub fn gradient_in_world(&self) -> [f64; 2] {
        let n = &self.normal_in_world;
        [-n.x / n.z, -n.y / n.z]
    }
}

impl Terrain {
    /// Returns height and normal at (X_g, Y_g), m; the normal belongs to the exact gradient of the
    /// height and is continuous.
    ///
    /// # Errors
    /// Returns why there is no ground known there: the place is outside the terrain's extent, its
    /// cells hold no data, or the coordinates are not finite.
    pub fn surface(&self, x_m: f64, y_m: f64) -> Result<Surface, TerrainError> {
        if !(x_m.is_finite() && y_m.is_finite()) {
            return Err(TerrainError::PlaceNotFinite { x_m, y_m });
        }
        match self {
            Self::Level => Ok(Surface::from_gradient(0.0, [0.0, 0.0])),
            Self::Plane(plane) => Ok(plane.surface(x_m, y_m)),
            Self::Zones(zones) => Ok(zones.surface(x_m, y_m)),
            Self::Grid(grid) => grid.surface(x_m, y_m),
            Self::Route(route) => route.surface(x_m, y_m),
        }
    }

    /// Returns the attitude of a vehicle that stands at (X_g, Y_g), m, with heading `yaw_rad`, on the
    /// ground's tangent plane.
    ///
    /// # Errors
    /// As [`Terrain::surface`].
    pub fn attitude(&self, x_m: f64, y_m: f64, yaw_rad: f64) -> Result<Attitude, TerrainError> {
        let surface = self.surface(x_m, y_m)?;
        Ok(Attitude::on_plane(&surface.normal_in_world, yaw_rad))
    }
}

/// Why there is no terrain, or no ground at a place of it.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TerrainError {
    /// Ground was asked for at coordinates that are not numbers.
    #[error("place x {x_m} m, y {y_m} m is not finite")]
    PlaceNotFinite {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
    },
    /// The place is not between the grid's outermost nodes.
    #[error("place x {x_m} m, y {y_m} m is outside the elevation grid, which spans {extent}")]
    OutsideGrid {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// What the grid spans, in the world.
        extent: GridExtent,
    },
    /// A node around the place holds NODATA.
    #[error(
        "no elevation at x {x_m} m, y {y_m} m: the grid has NODATA in row {row}, column {column} (from 1, northwest)"
    )]
    NoData {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// Row in the file, from 1 in the north.
        row: usize,
        /// Column in the file, from 1 in the west.
        column: usize,
    },
    /// The place is too far from the route for its elevation to say anything.
    #[error("place x {x_m} m, y {y_m} m is more than {distance_max_m} m from the route")]
    OffRoute {
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// Largest distance from the route, m.
        distance_max_m: f64,
    },
    /// The text of an elevation grid could not be read.
    #[error("elevation grid, line {line}: found {found}, expected {expected}")]
    GridSyntax {
        /// Line, from 1.
        line: usize,
        /// The token found, quoted, or "the end".
        found: String,
        /// What should be there.
        expected: &'static str,
    },
    /// A route point is not finite.
    #[error("route point {index} (from 0) is not finite: x {x_m} m, y {y_m} m, z {z_m} m")]
    RoutePointNotFinite {
        /// Index from 0.
        index: usize,
        /// X_g, m.
        x_m: f64,
        /// Y_g, m.
        y_m: f64,
        /// Z_g, m.
        z_m: f64,
    },
    /// The route's horizontal length is too short or too long.
    #[error(
        "route of {points} points is {length_m} m long, must be from {length_min_m} to {length_max_m} m"
    )]
    RouteLength {
        /// Points given.
        points: usize,
        /// Horizontal length, m.
        length_m: f64,
        /// Shortest length allowed, m.
        length_min_m: f64,
        /// Longest length allowed, m.
        length_max_m: f64,
    },
    /// A parameter is out of its range.
    #[error(transparent)]
    Parameter(#[from] RangeError),
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Asserts that the normal is the one of the height's central differences.
    pub(crate) fn assert_normal_is_gradient(terrain: &Terrain, x_m: f64, y_m: f64, tolerance: f64) {
        let step = 1e-5;
        let height = |x, y| terrain.surface(x, y).unwrap().height_m;
        let along_x = (height(x_m + step, y_m) - height(x_m - step, y_m)) / (2.0 * step);
        let along_y = (height(x_m, y_m + step) - height(x_m, y_m - step)) / (2.0 * step);
        let surface = terrain.surface(x_m, y_m).unwrap();
        let [got_x, got_y] = surface.gradient_in_world();
        assert!(
            (got_x - along_x).abs() < tolerance && (got_y - along_y).abs() < tolerance,
            "at {x_m}, {y_m}: gradient {got_x}, {got_y}, differences {along_x}, {along_y}"
        );
        assert!((surface.normal_in_world.norm() - 1.0).abs() < 1e-12);
        assert!(surface.normal_in_world.z > 0.0);
    }

    #[test]
    fn level_ground_is_level_everywhere() {
        let attitude = Terrain::Level.attitude(1e6, -3.0, 0.7).unwrap();
        assert_eq!(attitude, Attitude::LEVEL);
    }

    #[test]
    fn a_place_that_is_no_number_is_named() {
        let error = Terrain::Level.surface(f64::NAN, 1.0).unwrap_err();
        assert!(error.to_string().contains("NaN"), "{error}");
    }
}
