//! Where a scenario's vehicle starts.

use serde::Deserialize;
use sidehill_controller::path::Point2;
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::terrain::Terrain;

/// Offset of the vehicle's start from the start of the reference.
#[derive(Debug, Clone, Copy, Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(super) struct StartOffset {
    /// To the right.
    right_m: f64,
    /// Forward.
    forward_m: f64,
    /// Heading, counter-clockwise.
    heading_deg: f64,
}

impl StartOffset {
    pub(super) fn validate(&self) -> Result<(), RangeError> {
        let offset = Bounds::new(-100.0, 100.0, "m");
        offset.check("start.right_m", self.right_m)?;
        offset.check("start.forward_m", self.forward_m)?;
        Bounds::new(-180.0, 180.0, "deg")
            .check("start.heading_deg", self.heading_deg)
            .map(drop)
    }

    pub(super) fn from(&self, reference: &PlanarPose) -> PlanarPose {
        let position = Point2 {
            x_m: self.right_m,
            y_m: self.forward_m,
        }
        .seen_from(reference);
        PlanarPose {
            x_m: position.x_m,
            y_m: position.y_m,
            yaw_rad: reference.yaw_rad + self.heading_deg.to_radians(),
        }
    }
}

/// Returns the pose of the origin of a vehicle whose tracked point is at `start`.
pub(super) fn with_point_at(
    point: &TrackedPoint,
    start: &PlanarPose,
    terrain: &Terrain,
) -> PlanarPose {
    if point.is_origin() {
        return *start;
    }
    terrain
        .surface(start.x_m, start.y_m)
        .map_or(*start, |ground| {
            point.origin_of(start, &ground.normal_in_world)
        })
}
