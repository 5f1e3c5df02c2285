//! Ground under the vehicle: height and normal at a place, and so the attitude at a heading.

mod error;
mod esri;
mod grid;
mod nodes;
mod plane;
mod route;
mod surface;
mod zones;

pub use error::{GridExtent, TerrainError};
pub use grid::GridTerrain;
pub use plane::PlaneTerrain;
pub use route::{RoutePoint, RouteSmoothing, RouteTerrain};
pub use surface::Surface;
pub use zones::ZonedTerrain;

use crate::frames::Attitude;

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

impl Terrain {
    /// Returns height and normal at (X_g, Y_g), m; the normal belongs to the exact gradient of the
    /// height and is continuous.
    ///
    /// # Errors
    /// Returns why the ground there is unknown: the place is outside the terrain's extent, its
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

    /// Returns the attitude of a vehicle at (X_g, Y_g), m, with heading `yaw_rad`, on the
    /// ground's tangent plane.
    ///
    /// # Errors
    /// As [`Terrain::surface`].
    pub fn attitude(&self, x_m: f64, y_m: f64, yaw_rad: f64) -> Result<Attitude, TerrainError> {
        let surface = self.surface(x_m, y_m)?;
        Ok(Attitude::on_plane(&surface.normal_in_world, yaw_rad))
    }
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
