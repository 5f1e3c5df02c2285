//! The outline of the vehicle on the ground.

use sidehill_plant::vehicle::Vehicle;

/// A polygon around the vehicle in its body axes, right and forward, m.
///
/// On a slope the polygon is not shortened to its level projection, which errs on the safe side.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Footprint {
    corners: Vec<[f64; 2]>,
    padding_m: f64,
}

impl Footprint {
    /// Returns the footprint with these corners in ROS axes (x forward, y left), or the base rectangle of
    /// the vehicle where there are none, with padding on all sides.
    pub(crate) fn new(corners: &[[f64; 2]], padding_m: f64, vehicle: &Vehicle) -> Self {
        let (half_width_m, half_length_m) = (vehicle.base_half_width_m, vehicle.base_half_length_m);
        let corners = if corners.is_empty() {
            vec![
                [half_width_m, half_length_m],
                [-half_width_m, half_length_m],
                [-half_width_m, -half_length_m],
                [half_width_m, -half_length_m],
            ]
        } else {
            corners.iter().map(|[x, y]| [-y, *x]).collect()
        };
        Self { corners, padding_m }
    }

    /// Returns the radius around the body's origin beyond which nothing is covered, m.
    pub(crate) fn reach_m(&self) -> f64 {
        let radii = self.corners.iter().map(|[right, fwd]| right.hypot(*fwd));
        radii.fold(0.0, f64::max) + self.padding_m
    }

    /// Returns whether the padded polygon covers any of the disc of `radius_m` around a point.
    pub(crate) fn covers(&self, point: [f64; 2], radius_m: f64) -> bool {
        let near_m = self.padding_m + radius_m;
        self.edges().any(|(a, b)| distance_m(point, a, b) <= near_m) || self.contains(point)
    }

    /// Returns the corners, right and forward of the body's origin, m, without padding.
    pub(crate) fn corners(&self) -> &[[f64; 2]] {
        &self.corners
    }

    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        let crossings = self.edges().filter(|([ax, ay], [bx, by])| {
            (*ay > y) != (*by > y) && x < ax + (bx - ax) * (y - ay) / (by - ay)
        });
        crossings.count() % 2 == 1
    }

    fn edges(&self) -> impl Iterator<Item = ([f64; 2], [f64; 2])> {
        let next = self.corners.iter().cycle().skip(1);
        self.corners.iter().copied().zip(next.copied())
    }
}

/// Returns the distance of a point from a segment, m.
fn distance_m([x, y]: [f64; 2], [ax, ay]: [f64; 2], [bx, by]: [f64; 2]) -> f64 {
    let (dx, dy) = (bx - ax, by - ay);
    let length_squared = dx * dx + dy * dy;
    let along = if length_squared > 0.0 {
        (((x - ax) * dx + (y - ay) * dy) / length_squared).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (x - ax - along * dx).hypot(y - ay - along * dy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::server::test_data::j8;

    #[test]
    fn the_base_rectangle_is_the_default_and_corners_are_in_the_axes_of_ros() {
        let base = Footprint::new(&[], 0.0, &j8());
        assert!(base.covers([0.59, 1.05], 0.0) && !base.covers([0.61, 0.0], 0.0));
        assert!(base.covers([0.61, 0.0], 0.02) && base.covers([0.0, 0.0], 0.0));
        // 1 m ahead and 0.2 m to the left, with a notch.
        let corners = [
            [1.0, 0.2],
            [0.5, 0.0],
            [1.0, -0.2],
            [-0.3, -0.2],
            [-0.3, 0.2],
        ];
        let notched = Footprint::new(&corners, 0.0, &j8());
        assert!(notched.covers([-0.19, 0.9], 0.0), "left is negative");
        assert!(!notched.covers([0.0, 0.9], 0.0) && notched.covers([0.0, 0.4], 0.0));
        let padded = Footprint::new(&corners, 0.2, &j8());
        assert!(padded.covers([0.0, -0.45], 0.0) && !padded.covers([0.0, -0.55], 0.0));
        assert!((padded.reach_m() - (1.0f64.hypot(0.2) + 0.2)).abs() < 1e-12);
    }
}
