//! The point of the vehicle that follows the path: the origin, or an implement, antenna or tool.

use crate::path::Path;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::frames::PlanarPose;

/// A point fixed to the body, in the plane of its right and forward axes.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackedPoint {
    /// Distance to the right of the origin.
    pub right_m: f64,
    /// Distance ahead of the origin.
    pub forward_m: f64,
}

/// Where a tracked point is, seen from the origin, in the horizontal axes of the world, m.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Lever {
    /// Point less origin, (x, y), m.
    pub offset_m: (f64, f64),
    /// Derivative of that by the heading, m/rad.
    pub by_yaw_m: (f64, f64),
}

impl TrackedPoint {
    /// The origin.
    pub const ORIGIN: Self = Self {
        right_m: 0.0,
        forward_m: 0.0,
    };

    /// Returns whether it is the origin.
    pub fn is_origin(&self) -> bool {
        *self == Self::ORIGIN
    }

    /// Returns the point that follows a path: this one, without a path, as on a turn on the spot, the origin.
    pub(crate) fn along(self, path: Option<&Path>) -> Self {
        path.map_or(Self::ORIGIN, |_| self)
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let offset = Bounds::new(-5.0, 5.0, "m");
        offset.check("tracked_point.right_m", self.right_m)?;
        offset.check("tracked_point.forward_m", self.forward_m)?;
        Ok(())
    }

    /// Returns where the point is at heading `yaw_rad` on a plane with upward unit normal
    /// `normal_in_world`.
    ///
    /// With n' = Rz(-psi) n, offset (r, f) and the attitude of the plane, the horizontal part of
    /// Ry(alpha) Rx(phi) (r, f, 0) is h = ((r n'_z - f n'_x n'_y) / c, f c), c = sqrt(1 - n'_y^2); the
    /// offset is Rz(psi) h. Valid for any plane that is not vertical.
    pub fn lever(&self, normal_in_world: &Vector3<f64>, yaw_rad: f64) -> Lever {
        if self.is_origin() {
            return Lever::default();
        }
        let (sin, cos) = yaw_rad.sin_cos();
        let right = cos * normal_in_world.x + sin * normal_in_world.y;
        let forward = -sin * normal_in_world.x + cos * normal_in_world.y;
        let c = (1.0 - forward * forward).max(1e-6).sqrt();
        let across = self.right_m * normal_in_world.z - self.forward_m * right * forward;
        let (x, y) = (across / c, self.forward_m * c);
        // d n'_x/d psi = n'_y, d n'_y/d psi = -n'_x, so dc/d psi = n'_x n'_y / c.
        let c_by_yaw = right * forward / c;
        let across_by_yaw = self.forward_m * (right * right - forward * forward);
        let x_by_yaw = (across_by_yaw - across * c_by_yaw / c) / c;
        let y_by_yaw = self.forward_m * c_by_yaw;
        let rotate = |x: f64, y: f64| (cos * x - sin * y, sin * x + cos * y);
        Lever {
            offset_m: rotate(x, y),
            // Rz' h + Rz h', with Rz' h = Rz (-h_y, h_x).
            by_yaw_m: rotate(x_by_yaw - y, y_by_yaw + x),
        }
    }

    /// Returns position and heading of the point of a vehicle whose origin is at `origin`, on a plane with
    /// upward unit normal `normal_in_world`.
    pub fn of(&self, origin: &PlanarPose, normal_in_world: &Vector3<f64>) -> PlanarPose {
        let lever = self.lever(normal_in_world, origin.yaw_rad);
        PlanarPose {
            x_m: origin.x_m + lever.offset_m.0,
            y_m: origin.y_m + lever.offset_m.1,
            yaw_rad: origin.yaw_rad,
        }
    }

    /// Returns where the origin is of a vehicle whose point is at `point`; the inverse of
    /// [`TrackedPoint::of`].
    pub fn origin_of(&self, point: &PlanarPose, normal_in_world: &Vector3<f64>) -> PlanarPose {
        let lever = self.lever(normal_in_world, point.yaw_rad);
        PlanarPose {
            x_m: point.x_m - lever.offset_m.0,
            y_m: point.y_m - lever.offset_m.1,
            yaw_rad: point.yaw_rad,
        }
    }
}

/// Returns the difference between the heading of the body and the direction in which its point travels
/// after `way_m`, where it was `difference_rad` before and the direction stays.
///
/// On level ground the velocity of a point `ahead_m` ahead of the line through the treads' ICRs has the
/// component -ahead omega to the right, so with the direction theta of travel and delta = psi - theta
/// d delta/ds = -sin(delta) / ahead, which tan(delta/2) = tan(delta_0/2) exp(-s / ahead) solves. It decays
/// where `way_m` and `ahead_m` have the same sign.
pub(crate) fn heading_difference_after(difference_rad: f64, way_m: f64, ahead_m: f64) -> f64 {
    2.0 * ((0.5 * difference_rad).tan() * (-way_m / ahead_m).exp()).atan()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use sidehill_plant::frames::Attitude;

    proptest! {
        #[test]
        fn the_lever_is_that_of_the_rotation_and_its_derivative_that_of_differences(
            right_m in -2.0..2.0, forward_m in -2.0..2.0, roll in -0.6..0.6, pitch in -0.6..0.6,
            yaw in -4.0..4.0,
        ) {
            let point = TrackedPoint { right_m, forward_m };
            let attitude = Attitude { roll_rad: roll, pitch_rad: pitch };
            let normal = attitude.plane_normal(yaw);
            let offset = attitude.world_from_body(yaw) * Vector3::new(right_m, forward_m, 0.0);
            let lever = point.lever(&normal, yaw);
            close(lever.offset_m.0, offset.x, 1e-9);
            close(lever.offset_m.1, offset.y, 1e-9);
            let step = 1e-5;
            let (before, after) = (point.lever(&normal, yaw - step), point.lever(&normal, yaw + step));
            let slope = |a: f64, b: f64| (b - a) / (2.0 * step);
            close(lever.by_yaw_m.0, slope(before.offset_m.0, after.offset_m.0), 1e-6);
            close(lever.by_yaw_m.1, slope(before.offset_m.1, after.offset_m.1), 1e-6);
        }
    }

    fn close(a: f64, b: f64, epsilon: f64) {
        assert!((a - b).abs() <= epsilon, "{a} {b}");
    }

    #[test]
    fn the_origin_is_found_back() {
        let point = TrackedPoint {
            right_m: 0.3,
            forward_m: 1.2,
        };
        let normal = Vector3::new(0.1, -0.2, 0.9).normalize();
        let origin = PlanarPose {
            x_m: 3.0,
            y_m: -1.0,
            yaw_rad: 0.7,
        };
        let back = point.origin_of(&point.of(&origin, &normal), &normal);
        close(back.x_m, origin.x_m, 1e-12);
        close(back.y_m, origin.y_m, 1e-12);
    }

    #[test]
    fn a_point_ahead_swings_the_body_into_its_direction() {
        // Euler's method on d delta/ds = -sin(delta)/ahead.
        let (mut difference, steps) = (1.0_f64, 10_000);
        for _ in 0..steps {
            difference -= difference.sin() / 0.8 * (1.5 / f64::from(steps));
        }
        close(heading_difference_after(1.0, 1.5, 0.8), difference, 1e-4);
    }
}
