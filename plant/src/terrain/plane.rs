//! One inclined plane through the world's origin.

use super::Surface;
use crate::bounds::{Bounds, RangeError};
use serde::Deserialize;

/// A plane of one slope through the world's origin, unbounded.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "RawPlane")]
pub struct PlaneTerrain {
    gradient_in_world: [f64; 2],
}

impl PlaneTerrain {
    /// Returns the plane that rises by `slope_deg` towards `uphill_heading_deg`, which is counted
    /// counter-clockwise from Y_g as yaw is: uphill is (-sin, cos) of it.
    ///
    /// # Errors
    /// Names the value that is out of range: slope from 0 to 45 deg, heading within +-360 deg.
    pub fn new(slope_deg: f64, uphill_heading_deg: f64) -> Result<Self, RangeError> {
        Self::try_from(RawPlane {
            slope_deg,
            uphill_heading_deg,
        })
    }

    pub(super) fn surface(&self, x_m: f64, y_m: f64) -> Surface {
        let [along_x, along_y] = self.gradient_in_world;
        Surface::from_gradient(along_x * x_m + along_y * y_m, self.gradient_in_world)
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct RawPlane {
    /// Slope.
    slope_deg: f64,
    /// Heading that leads straight up, counter-clockwise from Y_g.
    #[serde(default)]
    uphill_heading_deg: f64,
}

impl TryFrom<RawPlane> for PlaneTerrain {
    type Error = RangeError;

    fn try_from(raw: RawPlane) -> Result<Self, RangeError> {
        let slope_deg = Bounds::new(0.0, 45.0, "deg").check("slope_deg", raw.slope_deg)?;
        let heading_deg = Bounds::new(-360.0, 360.0, "deg")
            .check("uphill_heading_deg", raw.uphill_heading_deg)?;
        let rise = slope_deg.to_radians().tan();
        let (sin, cos) = heading_deg.to_radians().sin_cos();
        Ok(Self {
            gradient_in_world: [-sin * rise, cos * rise],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::frames::Attitude;
    use crate::terrain::{Terrain, tests::assert_normal_is_gradient};
    use proptest::prelude::*;

    #[test]
    fn facing_uphill_pitches_up_by_the_slope_and_across_rolls_by_it() {
        let slope = 10.0_f64.to_radians();
        for heading_deg in [-90.0, 0.0, 37.0, 180.0_f64] {
            let terrain = Terrain::Plane(PlaneTerrain::new(10.0, heading_deg).unwrap());
            let up = terrain
                .attitude(3.0, -2.0, heading_deg.to_radians())
                .unwrap();
            assert!((up.pitch_rad - slope).abs() < 1e-12 && up.roll_rad.abs() < 1e-12);
            let left_of_uphill = heading_deg.to_radians() + std::f64::consts::FRAC_PI_2;
            let across = terrain.attitude(3.0, -2.0, left_of_uphill).unwrap();
            assert!((across.roll_rad + slope).abs() < 1e-12 && across.pitch_rad.abs() < 1e-12);
            let small = Attitude::from_slope(slope, std::f64::consts::FRAC_PI_2);
            assert!((small.roll_rad - across.roll_rad).abs() < 1e-12);
        }
    }

    #[test]
    fn a_cliff_is_refused_by_key() {
        let error = PlaneTerrain::new(50.0, 0.0).unwrap_err();
        assert_eq!((error.key, error.value), ("slope_deg", 50.0));
        assert!(PlaneTerrain::new(f64::NAN, 0.0).is_err());
        assert_eq!(
            PlaneTerrain::new(5.0, 400.0).unwrap_err().key,
            "uphill_heading_deg"
        );
    }

    proptest! {
        #[test]
        fn the_normal_is_the_gradient(slope in 0.0..45.0f64, heading in -180.0..180.0f64,
                                      x in -50.0..50.0f64, y in -50.0..50.0f64) {
            let terrain = Terrain::Plane(PlaneTerrain::new(slope, heading).unwrap());
            assert_normal_is_gradient(&terrain, x, y, 1e-7);
        }
    }
}
