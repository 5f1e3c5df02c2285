//! The path seen by a vehicle that lags behind its reference.

use crate::path::Point2;
use crate::reference::{PROJECTION_WINDOW, Progress, Reference};
use crate::trajectory::{Motion, ReferencePoint};
use sidehill_plant::frames::{PlanarPose, wrap_angle};

/// Targets for a vehicle that may lag behind its reference, stage by stage.
///
/// Where errors along the path weigh less than those across it, the plan may be far behind the reference.
/// The distance from the tangent of the reference is then not that from the path: near a bend the vehicle
/// can be on the tangent of a point that it never reaches. So the path is rolled out straight, along its tangent
/// at the point nearest to where the plan has the vehicle: across that is the distance from the path, along
/// it the arc length by which the vehicle is behind. The heading stays that of the reference, where the vehicle
/// has to get to: with the heading where the plan is, the QP would take a bend for a straight line and weave.
/// Beyond a cusp the targets stay where they are: the way
/// back leads past a vehicle that is short of the cusp, which would turn back there.
pub(super) struct Unrolling<'a> {
    reference: &'a Reference,
    /// Arc length nearest to the plan at the stage before, m.
    nearest_m: f64,
    /// Arc length of the reference at the stage before, m.
    before_m: f64,
    /// Arc length of the next cusp or of the end, m.
    until_m: f64,
}

impl<'a> Unrolling<'a> {
    pub(super) fn new(reference: &'a Reference, progress: &Progress) -> Self {
        Self {
            reference,
            nearest_m: progress.arc_length_m,
            before_m: progress.point.arc_length_m,
            until_m: reference.stop_at_m(),
        }
    }

    /// Returns the pose that `point` has on the path rolled out for a vehicle at `place`, and the heading of that
    /// path, rad.
    pub(super) fn target(&mut self, point: &ReferencePoint, place: &Point2) -> (PlanarPose, f64) {
        let guess_m = self.nearest_m + point.arc_length_m - self.before_m;
        self.before_m = point.arc_length_m;
        self.nearest_m = guess_m;
        let as_it_is = (point.pose(), point.heading_rad);
        if point.arc_length_m >= self.until_m {
            return as_it_is;
        }
        let (Some(path), Motion::Drive) = (self.reference.path(), point.motion) else {
            return as_it_is;
        };
        let nearest = path.nearest_from(place, guess_m, point.arc_length_m, &PROJECTION_WINDOW);
        self.nearest_m = nearest.arc_length_m;
        let ahead_m = nearest.direction.sign() * (point.arc_length_m - nearest.arc_length_m);
        let (sin, cos) = nearest.heading_rad.sin_cos();
        let pose = PlanarPose {
            x_m: nearest.position.x_m - sin * ahead_m,
            y_m: nearest.position.y_m + cos * ahead_m,
            yaw_rad: point.heading_rad,
        };
        // In the lap of the reference, from whose headings others are counted on.
        let turned_rad = wrap_angle(nearest.heading_rad - point.heading_rad);
        (pose, point.heading_rad + turned_rad)
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::course::Circle;
    use crate::reference::Tracking;
    use std::f64::consts::TAU;

    #[test]
    fn beside_a_bend_the_distance_across_is_that_from_the_path() {
        let course = Circle::default();
        let radius_m = course.radius_m;
        let mut reference = Reference::new(
            course.trajectory().unwrap(),
            Tracking::Path { lead_max_m: 1.0 },
        );
        let ahead = reference.ahead(6.0);
        let centre = {
            let (sin, cos) = ahead.heading_rad.sin_cos();
            let side = ahead.yaw_rate_rad_s.signum() * radius_m;
            (
                ahead.position.x_m - side * cos,
                ahead.position.y_m - side * sin,
            )
        };
        for (behind_m, out_m) in [(0.0, 0.3), (0.7, 0.4), (1.2, -0.3)] {
            let there = reference.path().unwrap().at(ahead.arc_length_m - behind_m);
            let out = (there.position.x_m - centre.0, there.position.y_m - centre.1);
            let place = Point2 {
                x_m: there.position.x_m + out_m * out.0 / radius_m,
                y_m: there.position.y_m + out_m * out.1 / radius_m,
            };
            let progress = reference.advance(0.0, &ahead.pose());
            let (target, along_rad) = Unrolling::new(&reference, &progress).target(&ahead, &place);
            assert_eq!(target.yaw_rad, ahead.heading_rad);
            let next_lap = ReferencePoint {
                heading_rad: ahead.heading_rad + TAU,
                ..ahead
            };
            let (_, again_rad) = Unrolling::new(&reference, &progress).target(&next_lap, &place);
            assert!((again_rad - along_rad - TAU).abs() < 1e-9, "{again_rad}");
            let (sin, cos) = along_rad.sin_cos();
            let (dx, dy) = (place.x_m - target.x_m, place.y_m - target.y_m);
            let (across_m, along_m) = (cos * dx + sin * dy, -sin * dx + cos * dy);
            assert!(
                (across_m.abs() - out_m.abs()).abs() < 1e-3,
                "{across_m}, {out_m}"
            );
            assert!((along_m + behind_m).abs() < 1e-3, "{along_m}, {behind_m}");
        }
    }
}
