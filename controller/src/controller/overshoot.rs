//! A plan that drives past a cusp of the path.

use crate::mpc::StageWeights;
use crate::path::Point2;
use crate::reference::Reference;
use crate::trajectory::{Motion, ReferencePoint};
use sidehill_plant::frames::PlanarPose;

/// Distance past a cusp from which on it weighs as much as one from the path, m.
const WHOLE_M: f64 = 0.05;
/// Length of the way back from a cusp on which a vehicle may still be past it, m; also the distance from the cusp within
/// which it is looked for.
const WAY_BACK_M: f64 = 1.0;

/// How far past a cusp a vehicle is.
///
/// Past a cusp the path has turned back, so a vehicle that drives on leaves the path in the direction of its tangent. An
/// error along the path weighs little with contact-mpc, and a late vehicle would drive up to half a metre past the
/// cusp. So there the distance from the cusp weighs as one across the path.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Overshoot {
    cusp: Point2,
    by_m: f64,
}

impl Overshoot {
    /// Returns how far `place` is past the cusp that `point` of the reference is to pass next or has just passed; none
    /// where it is not.
    pub(super) fn of(
        reference: &Reference,
        point: &ReferencePoint,
        place: &Point2,
    ) -> Option<Self> {
        if point.motion != Motion::Drive {
            return None;
        }
        let end = reference.cusp_after(point.arc_length_m - WAY_BACK_M)?;
        let (by_m, left_m) = end.offsets_to(place);
        (by_m > 0.0 && by_m.hypot(left_m) < WAY_BACK_M).then_some(Self {
            cusp: end.position,
            by_m,
        })
    }

    /// Adds the distance from the cusp to the error along the path of a stage: target and weight become those of the sum
    /// of both squares.
    pub(super) fn weigh(
        &self,
        pose: &mut PlanarPose,
        along_heading_rad: f64,
        weights: &mut StageWeights,
    ) {
        let share = (self.by_m / WHOLE_M).min(1.0);
        let added = share * (weights.cross_per_m2 - weights.along_per_m2).max(0.0);
        if added <= 0.0 {
            return;
        }
        weights.along_per_m2 += added;
        let (sin, cos) = along_heading_rad.sin_cos();
        let to_cusp_m = -sin * (self.cusp.x_m - pose.x_m) + cos * (self.cusp.y_m - pose.y_m);
        let moved_m = added / weights.along_per_m2 * to_cusp_m;
        pose.x_m -= sin * moved_m;
        pose.y_m += cos * moved_m;
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;
    use crate::config::ControllerConfig;
    use crate::course::{Course, Cusp};
    use crate::reference::Tracking;
    use crate::speed_profile::SpeedConfig;
    use sidehill_plant::vehicle::Vehicle;

    /// Returns a reference with a cusp, the cusp's arc length, and a place so far past it.
    fn past(by_m: f64) -> (Reference, f64, Point2) {
        let limits =
            SpeedConfig::default().limits(&ControllerConfig::default().limits, &Vehicle::j8());
        let trajectory = Course::Cusp(Cusp::default()).trajectory(&limits).unwrap();
        let reference = Reference::new(trajectory, Tracking::Path { lead_max_m: 0.3 });
        let path = reference.path().unwrap();
        let cusp_m = path.cusps_m().next().unwrap();
        let end = path.at(cusp_m.next_down());
        let (sin, cos) = end.travel_heading_rad().sin_cos();
        let place = Point2 {
            x_m: end.position.x_m - by_m * sin,
            y_m: end.position.y_m + by_m * cos,
        };
        (reference, cusp_m, place)
    }

    /// Returns the reference's point at an arc length.
    fn point(reference: &Reference, arc_length_m: f64) -> ReferencePoint {
        let trajectory = reference.trajectory();
        trajectory.at(trajectory.time_at(arc_length_m))
    }

    #[test]
    fn a_vehicle_is_past_a_cusp_that_comes_and_one_just_passed_only() {
        let (reference, cusp_m, place) = past(0.2);
        for (arc_m, is_past) in [(-0.5, true), (0.6, true), (1.5, false)] {
            let found = Overshoot::of(&reference, &point(&reference, cusp_m + arc_m), &place);
            assert_eq!(found.is_some(), is_past, "{arc_m}");
            if let Some(found) = found {
                assert!((found.by_m - 0.2).abs() < 1e-6, "{found:?}");
            }
        }
        let (reference, cusp_m, short) = past(-0.1);
        let before = point(&reference, cusp_m - 0.5);
        assert_eq!(Overshoot::of(&reference, &before, &short), None);
    }

    #[test]
    fn on_the_way_back_it_is_not_past() {
        let (reference, cusp_m, _) = past(0.0);
        for back_m in [0.05, 0.4, 0.9] {
            let there = point(&reference, cusp_m + back_m);
            assert_eq!(Overshoot::of(&reference, &there, &there.position), None);
        }
    }

    /// With J = along a^2 and K = added (a - c)^2 the sum has its least value at the moved target.
    #[test]
    fn the_target_lies_between_the_reference_and_the_cusp_by_their_weights() {
        let (reference, cusp_m, place) = past(0.2);
        let back = point(&reference, cusp_m + 0.6);
        let overshoot = Overshoot::of(&reference, &back, &place).unwrap();
        let mut pose = back.pose();
        let mut weights = StageWeights {
            along_per_m2: 1.0,
            cross_per_m2: 50.0,
            heading_per_rad2: 0.0,
        };
        overshoot.weigh(&mut pose, back.heading_rad, &mut weights);
        assert_eq!(weights.along_per_m2, 50.0);
        let from = |x_m: f64, y_m: f64| (pose.x_m - x_m).hypot(pose.y_m - y_m);
        let moved_m = from(back.position.x_m, back.position.y_m);
        assert!((0.5..0.6).contains(&moved_m), "{moved_m}");
        // Errors along the path that weigh as much as those across it are left as they are.
        let mut same = back.pose();
        overshoot.weigh(&mut same, back.heading_rad, &mut weights);
        assert_eq!(same, back.pose());
    }
}
