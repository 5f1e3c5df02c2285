//! The path of a client.

use super::outcome::Outcome;
use sidehill_bridge::ros2::conversions::from_pose;
use sidehill_bridge::ros2::convert::pose_and_attitude;
use sidehill_bridge::ros2::message;
use sidehill_controller::path::{Path, ROUTE_SPEEDS};
use sidehill_plant::frames::PlanarPose;

/// A path as a client has sent it, checked.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct RequestedPath {
    /// Frame of its poses.
    pub frame: String,
    /// Its poses.
    pub poses: Vec<PlanarPose>,
    /// Largest speed from each pose to the next, m/s, infinite where there is none; empty where there is none at all.
    pub speeds_m_s: Vec<f64>,
    /// Whether the orientations of the poses say the direction of driving, whatever the settings are.
    pub oriented: bool,
}

/// Distance between the poses of a curve, m.
const CURVE_STEP_M: f64 = 0.1;

/// Largest number of poses; a longer path would fill the memory.
const POSES_MAX: usize = 200_000;
/// A path that passes the vehicle more than once is joined at its first passage that is at most so much
/// farther away than the nearest pose, m.
const PASSAGE_M: f64 = 0.3;
/// A vehicle with no more than this left of a path that also begins within so much of it is at the beginning of a lap, m.
const LAP_M: f64 = 1.0;

impl RequestedPath {
    /// Checks a message.
    ///
    /// # Errors
    /// `INVALID_PATH` with the reason.
    pub fn from_message(path: &message::Path) -> Result<Self, Outcome> {
        let frame = path.header.frame_id.trim_start_matches('/');
        if path.poses.is_empty() {
            return Err(Outcome::invalid_path("the path has no poses"));
        }
        if frame.is_empty() {
            return Err(Outcome::invalid_path("the path has no frame"));
        }
        if path.poses.len() > POSES_MAX {
            let count = path.poses.len();
            return Err(Outcome::invalid_path(format!(
                "the path has {count} poses, at most {POSES_MAX} are allowed"
            )));
        }
        let poses = path
            .poses
            .iter()
            .enumerate()
            .map(|(index, stamped)| {
                let other = stamped.header.frame_id.trim_start_matches('/');
                if !other.is_empty() && other != frame {
                    return Err(Outcome::invalid_path(format!(
                        "pose {index} is in {other}, the path in {frame}"
                    )));
                }
                let isometry = from_pose(&stamped.pose).map_err(|error| {
                    Outcome::invalid_path(format!("pose {index} of the path: {error}"))
                })?;
                Ok(pose_and_attitude(&isometry).0.planar())
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            frame: frame.to_owned(),
            speeds_m_s: speeds_of_stamps(path, &poses),
            poses,
            oriented: false,
        })
    }

    /// Returns the poses along a curve in a frame, with the speeds of its stretches.
    pub fn from_curve(frame: &str, curve: &Path) -> Self {
        let length_m = curve.length_m();
        let steps = (length_m / CURVE_STEP_M).ceil().max(1.0) as usize;
        let mut places_m: Vec<f64> = (0..=steps)
            .map(|index| length_m * index as f64 / steps as f64)
            .chain(curve.stops_m())
            .chain(curve.speeds().iter().map(|stretch| stretch.from_m))
            .collect();
        places_m.sort_by(f64::total_cmp);
        let poses = places_m.iter().map(|at_m| curve.at(*at_m).pose());
        let speeds_m_s = match curve.speeds() {
            [] => Vec::new(),
            _ => places_m
                .iter()
                .map(|at_m| curve.speed_m_s(*at_m).unwrap_or(f64::INFINITY))
                .collect(),
        };
        Self {
            frame: frame.trim_start_matches('/').to_owned(),
            poses: poses.collect(),
            speeds_m_s,
            oriented: true,
        }
    }

    /// Returns the largest speed from a pose to the next, m/s, where it has one.
    pub fn speed_m_s(&self, index: usize) -> Option<f64> {
        let speed_m_s = self.speeds_m_s.get(index).copied();
        speed_m_s.filter(|speed_m_s| speed_m_s.is_finite())
    }

    /// Returns the goal, which is the last pose.
    pub fn goal(&self) -> PlanarPose {
        self.poses.last().copied().unwrap_or_default()
    }

    /// Returns the index of the pose at which a vehicle at `pose` joins the path.
    pub fn first_passage(&self, pose: &PlanarPose) -> usize {
        let distance_m = |at: &PlanarPose| (at.x_m - pose.x_m).hypot(at.y_m - pose.y_m);
        let nearest_m = self
            .poses
            .iter()
            .map(distance_m)
            .fold(f64::INFINITY, f64::min);
        let mut best: Option<(usize, f64)> = None;
        for (index, at) in self.poses.iter().enumerate() {
            let here_m = distance_m(at);
            match best {
                Some((_, best_m)) if here_m < best_m => best = Some((index, here_m)),
                // Past the first passage.
                Some((_, best_m)) if here_m > best_m + PASSAGE_M => break,
                None if here_m <= nearest_m + PASSAGE_M => best = Some((index, here_m)),
                _ => {}
            }
        }
        let joined = best.map_or(0, |(index, _)| index);
        let begins_here = self.poses.first().is_some_and(|at| distance_m(at) <= LAP_M);
        if begins_here && self.length_m(0) > 2.0 * LAP_M && self.length_m(joined) <= LAP_M {
            return self.nearest_from(0, pose);
        }
        joined
    }

    /// Returns the length from a pose to the end, m.
    pub fn length_m(&self, from: usize) -> f64 {
        let steps = self.poses[from..].windows(2);
        steps
            .map(|pair| (pair[1].x_m - pair[0].x_m).hypot(pair[1].y_m - pair[0].y_m))
            .sum()
    }

    /// Returns the index of the pose nearest to the vehicle, from an index on until the path moves away from it.
    pub fn nearest_from(&self, from: usize, pose: &PlanarPose) -> usize {
        let ahead = self.poses.get(from..).unwrap_or_default();
        let mut best = (from, f64::INFINITY);
        for (index, at) in ahead.iter().enumerate() {
            let here_m = (at.x_m - pose.x_m).hypot(at.y_m - pose.y_m);
            if here_m < best.1 {
                best = (from + index, here_m);
            } else if here_m > best.1 + PASSAGE_M {
                break;
            }
        }
        best.0
    }

    /// Returns whether the rest of the path for a vehicle at `pose` is within `radius_m` of the vehicle.
    pub fn stays_within(&self, pose: &PlanarPose, radius_m: f64) -> bool {
        self.poses[self.first_passage(pose)..]
            .iter()
            .all(|at| (at.x_m - pose.x_m).hypot(at.y_m - pose.y_m) <= radius_m)
    }
}

/// Longest time that stamps count from 0, s: clocks show more.
const STAMPS_MAX_S: f64 = 1e6;

/// Returns the speeds with which a vehicle would be at each pose at its stamp, where the stamps count from 0 at the first
/// pose and ask for no speed outside [`ROUTE_SPEEDS`]; infinite where the time stands still. Other stamps mean nothing: the
/// result is empty.
fn speeds_of_stamps(path: &message::Path, poses: &[PlanarPose]) -> Vec<f64> {
    let times = path.poses.iter().map(|pose| pose.header.stamp);
    let times_s: Vec<f64> = times
        .map(|stamp| f64::from(stamp.sec) + 1e-9 * f64::from(stamp.nanosec))
        .collect();
    let largest_s = times_s.iter().copied().fold(0.0, f64::max);
    if times_s.first() != Some(&0.0) || largest_s == 0.0 || largest_s > STAMPS_MAX_S {
        return Vec::new();
    }
    let stretches = poses.windows(2).zip(times_s.windows(2));
    let speeds = stretches.map(|(poses, times_s)| {
        let length_m = (poses[1].x_m - poses[0].x_m).hypot(poses[1].y_m - poses[0].y_m);
        let time_s = times_s[1] - times_s[0];
        match length_m / time_s {
            _ if time_s == 0.0 => Some(f64::INFINITY),
            speed_m_s if (ROUTE_SPEEDS.low..=ROUTE_SPEEDS.high).contains(&speed_m_s) => {
                Some(speed_m_s)
            }
            _ => None,
        }
    });
    let end = std::iter::once(Some(f64::INFINITY));
    speeds.chain(end).collect::<Option<_>>().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::node::message::action::code;
    use sidehill_bridge::ros2::conversions::{stamp, to_pose};
    use sidehill_bridge::ros2::convert::world_from_base_link;
    use sidehill_controller::path::{Direction, Point2, RawPoint, SmoothingConfig, smooth};
    use sidehill_plant::frames::{Attitude, Pose};
    use std::f64::consts::{FRAC_PI_2, TAU};

    fn message(poses: &[PlanarPose]) -> message::Path {
        let mut path = message::Path::default();
        path.header.frame_id = "map".to_owned();
        for pose in poses {
            let pose = Pose {
                x_m: pose.x_m,
                y_m: pose.y_m,
                z_m: 0.0,
                yaw_rad: pose.yaw_rad,
            };
            let isometry = world_from_base_link(&pose, &Attitude::LEVEL);
            let mut stamped = message::PoseStamped::default();
            stamped.header.frame_id = "map".to_owned();
            stamped.pose = to_pose(&isometry);
            path.poses.push(stamped);
        }
        path
    }

    /// Poses along X_g, which is a heading of -90 deg.
    fn line(count: usize) -> Vec<PlanarPose> {
        (0..count)
            .map(|i| PlanarPose {
                x_m: 0.1 * i as f64,
                y_m: 0.0,
                yaw_rad: -FRAC_PI_2,
            })
            .collect()
    }

    /// A figure of eight that begins where it crosses itself.
    fn eight() -> Vec<PlanarPose> {
        (0..=400)
            .map(|i| TAU * f64::from(i) / 400.0)
            .map(|u| PlanarPose {
                x_m: 3.0 * (2.0 * u).sin(),
                y_m: 5.0 * u.sin(),
                yaw_rad: 0.0,
            })
            .collect()
    }

    fn code_of(path: &message::Path) -> (u16, String) {
        let outcome = RequestedPath::from_message(path).unwrap_err();
        (outcome.code, outcome.message)
    }

    #[test]
    fn a_message_keeps_its_headings() {
        let path = RequestedPath::from_message(&message(&line(11))).unwrap();
        assert_eq!(path.frame, "map");
        assert!((path.goal().x_m - 1.0).abs() < 1e-12);
        assert!((path.goal().yaw_rad + FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn an_invalid_path_is_refused_with_the_reason() {
        assert_eq!(code_of(&message(&[])).0, code::INVALID_PATH);
        let mut path = message(&line(3));
        path.poses[1].pose.position.x = f64::NAN;
        assert!(code_of(&path).1.contains("pose 1"), "{:?}", code_of(&path));
        let mut path = message(&line(3));
        path.poses[2].pose.orientation = message::Quaternion {
            w: 0.0,
            ..message::Quaternion::default()
        };
        assert!(code_of(&path).1.contains("pose 2"));
        let mut path = message(&line(3));
        path.poses[2].header.frame_id = "odom".to_owned();
        assert!(code_of(&path).1.contains("odom"));
        let mut path = message(&line(3));
        path.header.frame_id.clear();
        assert!(code_of(&path).1.contains("frame"));
    }

    fn stamped(times_s: &[f64]) -> message::Path {
        let mut path = message(&line(times_s.len()));
        for (pose, time_s) in path.poses.iter_mut().zip(times_s) {
            pose.header.stamp = stamp((1e9 * time_s) as i64);
        }
        path
    }

    #[test]
    fn stamps_from_0_on_say_how_fast_the_path_may_be_driven() {
        // Poses are 0.1 m apart.
        let path = stamped(&[0.0, 0.0, 0.5, 1.5, 1.5]);
        let path = RequestedPath::from_message(&path).unwrap();
        let speeds = [0, 1, 2, 3, 4].map(|index| path.speed_m_s(index));
        assert_eq!(speeds[0], None);
        assert!((speeds[1].unwrap() - 0.2).abs() < 1e-6);
        assert!((speeds[2].unwrap() - 0.1).abs() < 1e-6);
        assert_eq!(speeds[3..], [None, None]);
        // A clock's stamps, those of a planner, none at all; stamps that count back, or let the vehicle stand.
        for times_s in [
            [1e9, 1e9 + 1.0, 1e9 + 2.0],
            [7.0; 3],
            [0.0; 3],
            [0.0, 1e9, 1e9],
            [0.0, 2.0, 1.0],
            [0.0, 1.0, 21.0],
        ] {
            let path = RequestedPath::from_message(&stamped(&times_s)).unwrap();
            assert!(path.speeds_m_s.is_empty(), "{times_s:?}");
        }
    }

    #[test]
    fn a_curve_keeps_its_places_headings_and_directions() {
        // 2 m along Y_g, and back in reverse to its half.
        let points: Vec<RawPoint> = (0..=40)
            .map(|i| RawPoint {
                position: Point2 {
                    x_m: 0.0,
                    y_m: 0.05 * f64::from(i),
                },
                direction: Some(Direction::Forward),
                ..RawPoint::default()
            })
            .chain((1..=20).map(|i| RawPoint {
                position: Point2 {
                    x_m: 0.0,
                    y_m: 2.0 - 0.05 * f64::from(i),
                },
                direction: Some(Direction::Reverse),
                ..RawPoint::default()
            }))
            .collect();
        let smoothing = SmoothingConfig::default().planned(2.0);
        let curve = smooth(&points, &smoothing).unwrap().path;
        let path = RequestedPath::from_curve("/odom", &curve);
        assert_eq!((path.frame.as_str(), path.oriented), ("odom", true));
        let highest = path.poses.iter().map(|pose| pose.y_m).fold(0.0, f64::max);
        assert!((highest - 2.0).abs() < 1e-6, "{highest}");
        assert!((path.goal().y_m - 1.0).abs() < 1e-6);
        for (index, pose) in path.poses.iter().enumerate() {
            assert!(
                pose.x_m.abs() < 1e-6 && pose.yaw_rad.abs() < 1e-6,
                "{pose:?}"
            );
            let Some(next) = path.poses.get(index + 1) else {
                break;
            };
            assert!((next.y_m - pose.y_m).abs() < 1.01 * CURVE_STEP_M);
        }
    }

    #[test]
    fn a_vehicle_short_of_its_loop_drives_the_lap() {
        // A loop of 1.5 m radius, whose beginning is ahead of the vehicle on it.
        let poses = |count: u32| {
            (0..=count)
                .map(|i| TAU * f64::from(i) / f64::from(count))
                .map(|u| PlanarPose {
                    x_m: 1.5 * u.sin(),
                    y_m: 1.5 * (1.0 - u.cos()),
                    yaw_rad: 0.0,
                })
                .collect::<Vec<_>>()
        };
        let path = RequestedPath::from_message(&message(&poses(200))).unwrap();
        for short_m in [0.0, 0.3, 0.4, 0.5, 0.9] {
            let index = 200 - (short_m / (TAU * 1.5) * 200.0_f64).round() as usize;
            let at = path.poses[index];
            assert_eq!(path.first_passage(&at), 0, "{short_m}");
            assert!(!path.stays_within(&at, 0.25));
        }
        // Farther from its end, and on a path that begins elsewhere, the rest is driven.
        assert_eq!(path.first_passage(&path.poses[150]), 150);
        let open = RequestedPath::from_message(&message(&line(101))).unwrap();
        assert_eq!(open.first_passage(&open.poses[95]), 95);
    }

    #[test]
    fn a_path_that_crosses_itself_is_joined_at_its_first_passage() {
        let path = RequestedPath::from_message(&message(&eight())).unwrap();
        let near = PlanarPose {
            x_m: 0.01,
            y_m: -0.02,
            yaw_rad: 0.0,
        };
        assert!(path.first_passage(&near) < 5);
        // Elsewhere it is joined at the nearest pose.
        let far = path.poses[130];
        assert_eq!(path.first_passage(&far), 130);
    }
}
