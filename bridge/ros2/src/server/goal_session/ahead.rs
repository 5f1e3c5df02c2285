//! The poses that the vehicle will drive through, as a session knows them.

use super::PlacedRoute;
use crate::server::obstacles::{Ahead, Clearance};
use crate::server::path_frame::pose_in;
use nalgebra::Vector3;
use sidehill_controller::tracked_point::TrackedPoint;
use sidehill_plant::frames::PlanarPose;

/// Distance between the poses of the reference that are looked up, m.
pub(super) const REFERENCE_STEP_M: f64 = 0.1;

/// Where the origin of a vehicle is whose point is on its path.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mount {
    pub(super) point: TrackedPoint,
    pub(super) normal_in_world: Vector3<f64>,
}

impl PlacedRoute {
    /// Returns the poses of the vehicle on the route from an arc length on, over `look_m` or until the end.
    pub(super) fn poses_ahead(
        &self,
        from_m: f64,
        look_m: f64,
        mount: Mount,
    ) -> impl Iterator<Item = Ahead> {
        let trajectory = &self.route.trajectory;
        let count = (look_m / REFERENCE_STEP_M).ceil() as usize;
        let left_m = trajectory.length_m() - from_m;
        (0..=count)
            .map(move |index| (index as f64 * REFERENCE_STEP_M).min(left_m))
            .map(move |distance_m| {
                let time_s = trajectory.time_at(from_m + distance_m);
                Ahead {
                    pose: self.pose(&trajectory.at(time_s).pose(), mount),
                    distance_m,
                }
            })
    }

    /// Returns the pose of the vehicle, in the frame of the odometry, whose point is at a pose of the path's
    /// frame.
    pub(super) fn pose(&self, at: &PlanarPose, mount: Mount) -> PlanarPose {
        let tracked = pose_in(at, &self.frame);
        mount.point.origin_of(&tracked, &mount.normal_in_world)
    }
}

/// Returns the pose of the vehicle and those predicted, with the way to each.
pub(super) fn along<'a>(
    pose: &PlanarPose,
    plan: impl Iterator<Item = &'a PlanarPose>,
) -> impl Iterator<Item = Ahead> {
    let start = Ahead {
        pose: *pose,
        distance_m: 0.0,
    };
    let next = plan.scan(start, |last, pose| {
        let step_m = (pose.x_m - last.pose.x_m).hypot(pose.y_m - last.pose.y_m);
        *last = Ahead {
            pose: *pose,
            distance_m: last.distance_m + step_m,
        };
        Some(*last)
    });
    std::iter::once(start).chain(next)
}

/// Returns the clearance that ends first.
pub(super) fn nearer(a: Clearance, b: Clearance) -> Clearance {
    match (a.blockage, b.blockage) {
        (None, _) => b,
        (_, None) => a,
        _ if a.free_m <= b.free_m => a,
        _ => b,
    }
}
