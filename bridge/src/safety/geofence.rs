//! The area that the vehicle may not leave.

use serde::{Deserialize, Serialize};
use sidehill_controller::estimator::Estimate;
use sidehill_controller::trajectory::Trajectory;

/// Time from a decision until the drives brake, s: a cycle and the delay of a command.
const REACTION_S: f64 = 0.15;
/// Share of the deceleration that is counted on: a slope takes the rest.
const BRAKING: f64 = 0.6;
/// Least distance that is kept from the edge, m, and standard deviations of the position beyond that.
const MARGIN_M: f64 = 0.1;
const SIGMAS: f64 = 2.0;
/// Distance of places at which a path is checked, m.
const STEP_M: f64 = 0.05;

/// A polygon in the frame of the poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<[f64; 2]>", into = "Vec<[f64; 2]>")]
pub struct Geofence(Vec<[f64; 2]>);

/// Why a polygon is no geofence.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum GeofenceError {
    /// Too few corners.
    #[error("geofence: a polygon has at least 3 corners, as [[0, 0], [20, 0], [20, 10], [0, 10]]")]
    Corners,
    /// A corner is no place.
    #[error("geofence: corner {index} is not finite")]
    NotFinite {
        /// Its number, from 1.
        index: usize,
    },
    /// Two edges cross or touch.
    #[error("geofence: the edges from corner {a} and from corner {b} meet: which side is inside?")]
    Crossing {
        /// Number of the first edge's first corner, from 1.
        a: usize,
        /// That of the other's.
        b: usize,
    },
}

impl TryFrom<Vec<[f64; 2]>> for Geofence {
    type Error = GeofenceError;

    fn try_from(corners: Vec<[f64; 2]>) -> Result<Self, GeofenceError> {
        let finite = |corner: &[f64; 2]| corner.iter().all(|value| value.is_finite());
        if let Some(index) = corners.iter().position(|corner| !finite(corner)) {
            return Err(GeofenceError::NotFinite { index: index + 1 });
        }
        let count = corners.len();
        if count < 3 {
            return Err(GeofenceError::Corners);
        }
        let fence = Self(corners);
        for a in 0..count {
            for b in a + 1..count {
                let neighbours = b == a + 1 || (a == 0 && b == count - 1);
                let (first, second) = (fence.edge(a), fence.edge(b));
                if !neighbours && meet(first, second) || first[0] == second[0] {
                    return Err(GeofenceError::Crossing { a: a + 1, b: b + 1 });
                }
            }
        }
        Ok(fence)
    }
}

impl From<Geofence> for Vec<[f64; 2]> {
    fn from(fence: Geofence) -> Self {
        fence.0
    }
}

impl Geofence {
    fn edge(&self, index: usize) -> [[f64; 2]; 2] {
        [self.0[index], self.0[(index + 1) % self.0.len()]]
    }

    fn edges(&self) -> impl Iterator<Item = [[f64; 2]; 2]> + '_ {
        (0..self.0.len()).map(|index| self.edge(index))
    }

    /// Returns whether a place, m, is inside: a ray from it crosses the edges an odd number of times.
    pub fn contains(&self, [x_m, y_m]: [f64; 2]) -> bool {
        let crossed = self.edges().filter(|[a, b]| {
            (a[1] > y_m) != (b[1] > y_m)
                && x_m < a[0] + (y_m - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
        });
        crossed.count() % 2 == 1
    }

    /// Returns the first place of a trajectory that is outside, m.
    pub fn first_outside(&self, trajectory: &Trajectory) -> Option<[f64; 2]> {
        let (length_m, end_s) = (trajectory.length_m(), trajectory.duration_s());
        let steps = (length_m / STEP_M).ceil().clamp(1.0, 1e7) as usize;
        (0..=steps)
            .map(|step| match step == steps {
                true => end_s,
                false => trajectory.time_at(length_m * step as f64 / steps as f64),
            })
            .map(|time_s| trajectory.at(time_s).position)
            .map(|at| [at.x_m, at.y_m])
            .find(|at| !self.contains(*at))
    }

    /// Returns whether a vehicle that brakes by `deceleration_m_s2` from now on would stop too close to the edge, or
    /// outside.
    ///
    /// It stops after v T + v^2 / (2 share a), straight on, and keeps a margin that grows with the doubt of its position.
    pub(crate) fn is_left_by(&self, estimate: &Estimate, deceleration_m_s2: f64) -> bool {
        let pose = &estimate.pose;
        let here = [pose.x_m, pose.y_m];
        let (sin, cos) = pose.yaw_rad.sin_cos();
        let (right, forward) = (estimate.velocity.right_m_s, estimate.velocity.forward_m_s);
        let velocity = [cos * right - sin * forward, sin * right + cos * forward];
        let speed_m_s = velocity[0].hypot(velocity[1]);
        if !self.contains(here) {
            return true;
        }
        if speed_m_s < 1e-3 {
            return false;
        }
        let doubt_m = SIGMAS
            * estimate.covariance[(0, 0)]
                .max(estimate.covariance[(1, 1)])
                .sqrt();
        let way_m = speed_m_s * REACTION_S
            + speed_m_s.powi(2) / (2.0 * BRAKING * deceleration_m_s2)
            + MARGIN_M
            + doubt_m;
        let there = [
            here[0] + way_m * velocity[0] / speed_m_s,
            here[1] + way_m * velocity[1] / speed_m_s,
        ];
        // What is not a number meets nothing.
        !way_m.is_finite() || self.edges().any(|edge| meet(edge, [here, there]))
    }
}

/// Returns whether two stretches have a point in common.
fn meet([a, b]: [[f64; 2]; 2], [c, d]: [[f64; 2]; 2]) -> bool {
    // Twice the area of a triangle, positive where its corners are counter-clockwise.
    let area = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])
    };
    let within = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| {
        (0..2).all(|i| r[i] >= p[i].min(q[i]) && r[i] <= p[i].max(q[i]))
    };
    let (abc, abd, cda, cdb) = (area(a, b, c), area(a, b, d), area(c, d, a), area(c, d, b));
    let apart =
        |first: f64, second: f64| (first > 0.0 && second < 0.0) || (first < 0.0 && second > 0.0);
    (apart(abc, abd) && apart(cda, cdb))
        || (abc == 0.0 && within(a, b, c))
        || (abd == 0.0 && within(a, b, d))
        || (cda == 0.0 && within(c, d, a))
        || (cdb == 0.0 && within(c, d, b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Vector3};
    use proptest::prelude::*;
    use sidehill_controller::course::Course;
    use sidehill_controller::speed_profile::SpeedLimits;
    use sidehill_plant::frames::{BodyVelocity, PlanarPose};
    use std::f64::consts::PI;

    fn fence(corners: &[[f64; 2]]) -> Result<Geofence, GeofenceError> {
        Geofence::try_from(corners.to_vec())
    }

    /// An L of two squares of 10 m.
    fn ell() -> Geofence {
        fence(&[
            [0.0, 0.0],
            [20.0, 0.0],
            [20.0, 10.0],
            [10.0, 10.0],
            [10.0, 20.0],
            [0.0, 20.0],
        ])
        .unwrap()
    }

    proptest! {
        #[test]
        fn an_l_contains_what_is_in_one_of_its_rectangles(x in -5.0..25.0f64, y in -5.0..25.0f64) {
            let within = |x_max, y_max| (0.0..x_max).contains(&x) && (0.0..y_max).contains(&y);
            prop_assert_eq!(ell().contains([x, y]), within(20.0, 10.0) || within(10.0, 20.0));
        }

        #[test]
        fn a_triangle_contains_what_is_left_of_all_its_edges(x in -5.0..25.0f64, y in -5.0..25.0f64) {
            let triangle = fence(&[[0.0, 0.0], [20.0, 5.0], [5.0, 20.0]]).unwrap();
            let left = [20.0 * y - 5.0 * x, -15.0 * (y - 5.0) - 15.0 * (x - 20.0), 20.0 * x - 5.0 * y];
            prop_assert_eq!(triangle.contains([x, y]), left.iter().all(|area| *area > 0.0));
        }
    }

    #[test]
    fn a_fence_is_written_as_it_was_read() {
        let corners = Vec::from(ell());
        assert_eq!(corners.len(), 6);
        assert_eq!(fence(&corners).unwrap(), ell());
    }

    #[test]
    fn a_polygon_without_an_inside_is_refused() {
        for (corners, reason) in [
            (&[[0.0, 0.0], [1.0, 0.0]][..], "at least 3 corners"),
            (
                &[[0.0, 0.0], [1.0, f64::NAN], [1.0, 1.0]],
                "corner 2 is not finite",
            ),
            (
                &[[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]],
                "from corner 1 and from corner 3",
            ),
            (&[[0.0, 0.0], [5.0, 0.0], [5.0, 0.0], [0.0, 5.0]], "meet"),
            // The last corner is on the first edge.
            (
                &[[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [5.0, 0.0], [0.0, 9.0]],
                "from corner 1 and from corner 3",
            ),
        ] {
            let error = fence(corners).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }

    #[test]
    fn stretches_meet_where_they_cross_touch_or_lie_on_each_other() {
        let long = [[0.0, 0.0], [8.0, 4.0]];
        for (other, meets) in [
            ([[0.0, 3.0], [6.0, 0.0]], true),
            ([[4.0, 2.0], [3.0, 5.0]], true),
            ([[0.0, 0.0], [-3.0, 5.0]], true),
            ([[2.0, 1.0], [6.0, 3.0]], true),
            ([[6.0, 3.0], [12.0, 6.0]], true),
            // On one line, apart.
            ([[10.0, 5.0], [12.0, 6.0]], false),
            ([[-2.0, -1.0], [-4.0, -2.0]], false),
            // Towards it, not as far.
            ([[0.0, 3.0], [3.0, 1.75]], false),
            // Across its line, beyond its end.
            ([[9.0, 0.0], [9.0, 9.0]], false),
            ([[-1.0, -2.0], [-1.0, 2.0]], false),
            ([[10.0, 5.0], [10.0, 9.0]], false),
            ([[0.0, 1.0], [8.0, 5.0]], false),
        ] {
            // Whichever way they run, whichever comes first, along whichever axes.
            let back = |[a, b]: [[f64; 2]; 2]| [b, a];
            let turned = |stretch: [[f64; 2]; 2]| stretch.map(|[x, y]| [-y, x]);
            let (mut first, mut second) = (long, other);
            for _ in 0..4 {
                for (first, second) in [(first, second), (second, first)] {
                    for first in [first, back(first)] {
                        for second in [second, back(second)] {
                            assert_eq!(meet(first, second), meets, "{first:?} {second:?}");
                        }
                    }
                }
                (first, second) = (turned(first), turned(second));
            }
        }
    }

    /// A vehicle at a place, with the covariance of its position, m^2.
    fn vehicle(pose: PlanarPose, velocity: BodyVelocity, [xx, yy]: [f64; 2]) -> Estimate {
        Estimate {
            covariance: Matrix3::from_diagonal(&Vector3::new(xx, yy, 0.0)),
            velocity,
            ..Estimate::standing(0.0, pose)
        }
    }

    #[test]
    fn the_vehicle_brakes_where_it_would_just_stop_before_the_edge() {
        // An edge 5 m from the origin, whatever the direction: a polygon of 60 corners.
        let round: Vec<[f64; 2]> = (0..60)
            .map(|corner| f64::from(corner) * std::f64::consts::TAU / 60.0)
            .map(|angle| [5.0 * angle.cos(), 5.0 * angle.sin()])
            .collect();
        let fence = fence(&round).unwrap();
        // Towards a corner and away from it, forward, backward and sliding to the right.
        for (yaw_rad, forward_m_s, right_m_s) in [
            (0.4 * PI, 1.2, 0.0),
            (0.4 * PI, -1.2, 0.0),
            (-0.9 * PI, 0.72, 0.96),
            (0.0, 0.0, 1.2),
        ] {
            // Heading 0 is along Y_g, with X_g to the right.
            let right = [f64::cos(yaw_rad), f64::sin(yaw_rad)];
            let along = [0, 1].map(|axis| {
                let forward = [-right[1], right[0]];
                (forward_m_s * forward[axis] + right_m_s * right[axis]) / 1.2
            });
            // 1.2 m/s for 0.15 s, 1.2^2 / (2 * 0.6 * 1.5) of braking, 0.1 m and two standard deviations of 0.2 m.
            let way_m = 0.18 + 0.8 + 0.1 + 0.4;
            for variances_m2 in [[0.04, 0.01], [0.01, 0.04]] {
                for (spare_m, leaves) in [(0.02, false), (-0.02, true)] {
                    let from_m = 5.0 - way_m - spare_m;
                    let pose = PlanarPose {
                        x_m: from_m * along[0],
                        y_m: from_m * along[1],
                        yaw_rad,
                    };
                    let velocity = BodyVelocity {
                        right_m_s,
                        forward_m_s,
                        ..BodyVelocity::default()
                    };
                    let vehicle = vehicle(pose, velocity, variances_m2);
                    assert_eq!(
                        fence.is_left_by(&vehicle, 1.5),
                        leaves,
                        "{spare_m} {yaw_rad} {forward_m_s} {right_m_s}"
                    );
                }
            }
        }
    }

    #[test]
    fn the_vehicle_brakes_where_its_speed_or_the_doubt_of_its_place_is_not_a_number() {
        let pose = PlanarPose {
            x_m: 5.0,
            y_m: 5.0,
            yaw_rad: 0.0,
        };
        for (forward_m_s, variances_m2, leaves) in [
            (1.0, [0.01, 0.01], false),
            (f64::NAN, [0.01, 0.01], true),
            (1.0, [f64::NAN, f64::NAN], true),
            (1.0, [-0.01, -0.01], true),
        ] {
            let velocity = BodyVelocity {
                forward_m_s,
                ..BodyVelocity::default()
            };
            let vehicle = vehicle(pose, velocity, variances_m2);
            assert_eq!(ell().is_left_by(&vehicle, 2.0), leaves);
        }
    }

    #[test]
    fn a_vehicle_that_stands_may_be_as_near_to_the_edge_as_it_is_inside() {
        for (x_m, leaves) in [(19.99, false), (20.01, true)] {
            for forward_m_s in [0.0, 5e-4] {
                let pose = PlanarPose {
                    x_m,
                    y_m: 5.0,
                    yaw_rad: -0.5 * PI,
                };
                let velocity = BodyVelocity {
                    forward_m_s,
                    ..BodyVelocity::default()
                };
                let vehicle = vehicle(pose, velocity, [0.01, 0.01]);
                assert_eq!(ell().is_left_by(&vehicle, 2.0), leaves, "{x_m}");
            }
        }
    }

    #[test]
    fn a_path_that_leaves_is_found_where_it_does() {
        let limits = SpeedLimits {
            speed_max_m_s: 1.0,
            traction_max_m_s: 1.0,
            steer_max_m_s: 1.0,
            tread_max_m_s: f64::INFINITY,
            acceleration_m_s2: 1.0,
            deceleration_m_s2: 1.0,
            steer_acceleration_m_s2: f64::INFINITY,
            lateral_acceleration_m_s2: f64::INFINITY,
            track_width_m: 2.0,
        };
        let straight: Course = serde_yaml::from_str("{shape: straight, length_m: 30}").unwrap();
        let trajectory = straight.trajectory(&limits).unwrap();
        // Along Y_g from the origin.
        let wide = fence(&[[-1.0, -1.0], [1.0, -1.0], [1.0, 31.0], [-1.0, 31.0]]).unwrap();
        assert_eq!(wide.first_outside(&trajectory), None);
        let short = fence(&[[-1.0, -1.0], [1.0, -1.0], [1.0, 20.0], [-1.0, 20.0]]).unwrap();
        let [x_m, y_m] = short.first_outside(&trajectory).unwrap();
        assert!(
            x_m.abs() < 1e-9 && (20.0..20.1).contains(&y_m),
            "{x_m} {y_m}"
        );
    }
}
