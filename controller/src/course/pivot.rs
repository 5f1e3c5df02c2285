//! A turn on the spot.

use crate::path::Point2;
use crate::trajectory::{SpotTurn, Trajectory};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// A turn on the spot from heading 0, beginning at the origin.
///
/// A skid-steer vehicle on level ground turns about a point y_ICR ahead of its origin: with that as
/// `centre_forward_m` the reference can be followed, with 0 the origin itself is to keep its place.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Pivot {
    /// Angle, counter-clockwise positive.
    pub angle_deg: f64,
    /// Magnitude of the yaw rate.
    pub yaw_rate_rad_s: f64,
    /// How far forward of the origin the point is that stays in place.
    pub centre_forward_m: f64,
}

impl Default for Pivot {
    fn default() -> Self {
        Self {
            angle_deg: 360.0,
            yaw_rate_rad_s: 0.3,
            centre_forward_m: 0.0,
        }
    }
}

impl Pivot {
    pub(super) fn check(&self) -> Result<(), RangeError> {
        let magnitude = self.angle_deg.abs();
        let bounds = Bounds::new(1.0, 36e3, "deg").with_note("either way");
        bounds
            .check("angle_deg", magnitude)
            .map_err(|error| RangeError {
                value: self.angle_deg,
                ..error
            })?;
        Bounds::new(1e-3, 10.0, "rad/s").check("yaw_rate_rad_s", self.yaw_rate_rad_s)?;
        Bounds::new(-10.0, 10.0, "m").check("centre_forward_m", self.centre_forward_m)?;
        Ok(())
    }

    pub(super) fn trajectory(&self) -> Trajectory {
        let angle_rad = self.angle_deg.to_radians();
        Trajectory::turning(SpotTurn {
            arc_length_m: 0.0,
            centre: Point2 {
                x_m: 0.0,
                y_m: self.centre_forward_m,
            },
            centre_forward_m: self.centre_forward_m,
            from_s: 0.0,
            to_s: angle_rad.abs() / self.yaw_rate_rad_s,
            from_rad: 0.0,
            to_rad: angle_rad,
        })
    }
}
