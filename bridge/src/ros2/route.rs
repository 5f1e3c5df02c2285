//! From a nav_msgs/Path to what the controller follows.

use super::convert::{from_pose, pose_and_attitude};
use super::goals::Outcome;
use super::message::{self, action::code};
use sidehill_controller::path::{Direction, Path, Point2, RawPoint, Smoothing, smooth};
use sidehill_controller::speed_profile::{SpeedLimits, speed_profile};
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::PlanarPose;
use std::sync::Arc;

/// A path as it came, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// Frame of its poses.
    pub frame: String,
    /// Its poses.
    pub poses: Vec<PlanarPose>,
}

/// Poses a path may have; a longer one would fill the memory.
const POSES_MAX: usize = 200_000;
/// How much farther than the nearest pose of all a pose may be to be taken for where the vehicle is:
/// a path that crosses itself is begun at its first passage, m.
const PASSAGE_M: f64 = 0.3;

impl Plan {
    /// Checks a message.
    ///
    /// # Errors
    /// [`code::INVALID_PATH`] with what is wrong.
    pub fn of(path: &message::Path) -> Result<Self, Outcome> {
        let wrong = |what: String| Outcome::new(code::INVALID_PATH, what);
        let frame = path.header.frame_id.trim_start_matches('/');
        if path.poses.is_empty() {
            return Err(wrong("the path has no poses".to_owned()));
        }
        if frame.is_empty() {
            return Err(wrong("the path names no frame".to_owned()));
        }
        if path.poses.len() > POSES_MAX {
            let count = path.poses.len();
            return Err(wrong(format!(
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
                    return Err(wrong(format!(
                        "pose {index} is in {other}, the path in {frame}"
                    )));
                }
                let isometry = from_pose(&stamped.pose)
                    .map_err(|fault| wrong(format!("pose {index} of the path: {fault}")))?;
                Ok(pose_and_attitude(&isometry).0.planar())
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Self {
            frame: frame.to_owned(),
            poses,
        })
    }

    /// Returns the goal: the last pose.
    pub fn goal(&self) -> PlanarPose {
        self.poses.last().copied().unwrap_or_default()
    }

    /// Returns the index of the pose at which a vehicle at `pose` takes the path up.
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
                // Past the first place that is near enough.
                Some((_, best_m)) if here_m > best_m + PASSAGE_M => break,
                None if here_m <= nearest_m + PASSAGE_M => best = Some((index, here_m)),
                _ => {}
            }
        }
        best.map_or(0, |(index, _)| index)
    }

    /// Returns whether what is left of it for a vehicle at `pose` is within `radius_m` of it.
    pub fn stays_within(&self, pose: &PlanarPose, radius_m: f64) -> bool {
        self.poses[self.first_passage(pose)..]
            .iter()
            .all(|at| (at.x_m - pose.x_m).hypot(at.y_m - pose.y_m) <= radius_m)
    }
}

/// How a path is made into what is followed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RouteSettings {
    /// How its points become a curve.
    pub smoothing: Smoothing,
    /// Bounds on the speed.
    pub limits: SpeedLimits,
    /// Whether the orientations tell the direction of driving.
    pub use_orientations: bool,
}

/// What is followed, in the frame of its path.
#[derive(Debug, Clone)]
pub struct Route {
    /// Frame.
    pub frame: String,
    /// The curve.
    pub path: Arc<Path>,
    /// The curve in time.
    pub trajectory: Trajectory,
    /// The goal's pose.
    pub goal: PlanarPose,
}

impl Route {
    /// Returns the route of a plan for a vehicle at `pose`, in the plan's frame, that drives at
    /// `speed_m_s`.
    ///
    /// # Errors
    /// [`code::INVALID_PATH`] with what is wrong.
    pub fn build(
        plan: &Plan,
        pose: &PlanarPose,
        speed_m_s: f64,
        settings: &RouteSettings,
    ) -> Result<Self, Outcome> {
        let poses = &plan.poses[plan
            .first_passage(pose)
            .min(plan.poses.len().saturating_sub(2))..];
        let points: Vec<RawPoint> = (0..poses.len())
            .map(|index| RawPoint {
                position: Point2 {
                    x_m: poses[index].x_m,
                    y_m: poses[index].y_m,
                },
                elevation_m: None,
                direction: settings.use_orientations.then(|| direction(poses, index)),
            })
            .collect();
        let smoothed = smooth(&points, &settings.smoothing)
            .map_err(|error| Outcome::new(code::INVALID_PATH, error.to_string()))?;
        let path = Arc::new(smoothed.path);
        let trajectory = timed(&path, speed_m_s, &settings.limits)?;
        Ok(Self {
            frame: plan.frame.clone(),
            path,
            trajectory,
            goal: plan.goal(),
        })
    }

    /// Returns the same route at other speeds.
    ///
    /// # Errors
    /// [`code::INVALID_PATH`] with what is wrong.
    pub fn at_speeds(&self, limits: &SpeedLimits) -> Result<Self, Outcome> {
        Ok(Self {
            trajectory: timed(&self.path, limits.speed_max_m_s, limits)?,
            ..self.clone()
        })
    }
}

fn timed(path: &Path, speed_m_s: f64, limits: &SpeedLimits) -> Result<Trajectory, Outcome> {
    let limits = SpeedLimits {
        initial_speed_m_s: speed_m_s.clamp(0.0, limits.speed_max_m_s),
        ..*limits
    };
    speed_profile(path, &limits, |_| f64::INFINITY)
        .map_err(|error| Outcome::new(code::INVALID_PATH, error.to_string()))
}

/// Returns which way is driven from a pose to the next, as its heading has it.
fn direction(poses: &[PlanarPose], index: usize) -> Direction {
    let from = index.min(poses.len().saturating_sub(2));
    let Some(next) = poses.get(from + 1) else {
        return Direction::Forward;
    };
    let here = &poses[from];
    let (sin, cos) = here.yaw_rad.sin_cos();
    if -sin * (next.x_m - here.x_m) + cos * (next.y_m - here.y_m) < 0.0 {
        Direction::Reverse
    } else {
        Direction::Forward
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::ros2::convert::{to_pose, world_from_base_link};
    use sidehill_plant::frames::{Attitude, Pose};
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    /// Settings of a vehicle that drives 0.5 m/s at most.
    pub fn settings() -> RouteSettings {
        RouteSettings {
            smoothing: Smoothing::default(),
            limits: SpeedLimits {
                speed_max_m_s: 0.5,
                traction_max_m_s: 1.0,
                steer_max_m_s: 1.0,
                tread_max_m_s: 2.0,
                acceleration_m_s2: 1.0,
                deceleration_m_s2: 1.0,
                steer_acceleration_m_s2: 1.0,
                lateral_acceleration_m_s2: 1.0,
                track_width_m: 2.0,
                initial_speed_m_s: 0.0,
            },
            use_orientations: false,
        }
    }

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

    /// Poses along X_g, a heading of -90 deg, and an 8 that begins where it crosses itself.
    fn line(count: usize) -> Vec<PlanarPose> {
        (0..count)
            .map(|i| PlanarPose {
                x_m: 0.1 * i as f64,
                y_m: 0.0,
                yaw_rad: -FRAC_PI_2,
            })
            .collect()
    }

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
        let outcome = Plan::of(path).unwrap_err();
        (outcome.code, outcome.message)
    }

    #[test]
    fn a_message_comes_through_with_its_headings() {
        let plan = Plan::of(&message(&line(11))).unwrap();
        assert_eq!(plan.frame, "map");
        assert!((plan.goal().x_m - 1.0).abs() < 1e-12);
        assert!((plan.goal().yaw_rad + FRAC_PI_2).abs() < 1e-9);
    }

    #[test]
    fn what_is_wrong_with_a_path_is_said() {
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

    #[test]
    fn a_kink_close_to_an_end_is_smoothed_within_the_deviation_or_refused() {
        let at = |places: &[(f64, f64)]| Plan {
            frame: "map".to_owned(),
            poses: places
                .iter()
                .map(|&(x_m, y_m)| PlanarPose {
                    x_m,
                    y_m,
                    yaw_rad: 0.0,
                })
                .collect(),
        };
        let pose = PlanarPose::default();
        let plan = at(&[(0.0, 0.0), (0.1, 0.1), (0.1, 0.2), (0.1, 0.3)]);
        let route = Route::build(&plan, &pose, 0.0, &settings()).unwrap();
        let end = route.trajectory.at(1e3).position;
        assert!((end.x_m - 0.1).hypot(end.y_m - 0.3) < 1e-6, "{end:?}");
        let exact = RouteSettings {
            smoothing: Smoothing {
                max_deviation_m: 0.02,
                ..Smoothing::default()
            },
            ..settings()
        };
        let error = Route::build(&plan, &pose, 0.0, &exact).unwrap_err();
        assert_eq!(error.code, code::INVALID_PATH);
        assert!(error.message.contains("sharp"), "{}", error.message);
    }

    #[test]
    fn a_single_place_is_no_path() {
        let plan = Plan::of(&message(&line(1))).unwrap();
        let error = Route::build(&plan, &PlanarPose::default(), 0.0, &settings()).unwrap_err();
        assert_eq!(error.code, code::INVALID_PATH);
    }

    #[test]
    fn a_path_is_taken_up_where_the_vehicle_is_and_at_its_speed() {
        let plan = Plan::of(&message(&line(101))).unwrap();
        let pose = PlanarPose {
            x_m: 4.02,
            y_m: 0.3,
            yaw_rad: -FRAC_PI_2,
        };
        let route = Route::build(&plan, &pose, 0.3, &settings()).unwrap();
        let start = route.trajectory.at(0.0);
        assert!((start.position.x_m - 4.0).abs() < 0.05, "{start:?}");
        assert!((start.speed_m_s - 0.3).abs() < 1e-6, "{start:?}");
        assert!((route.trajectory.length_m() - 6.0).abs() < 0.05);
        let slow = route.at_speeds(&SpeedLimits {
            speed_max_m_s: 0.2,
            ..settings().limits
        });
        let slow = slow.unwrap().trajectory;
        assert!((slow.at(slow.duration_s() / 2.0).speed_m_s - 0.2).abs() < 1e-6);
    }

    #[test]
    fn a_path_that_crosses_itself_is_begun_at_its_beginning() {
        let plan = Plan::of(&message(&eight())).unwrap();
        let near = PlanarPose {
            x_m: 0.01,
            y_m: -0.02,
            yaw_rad: 0.0,
        };
        assert!(plan.first_passage(&near) < 5);
        // In the middle of the path it is the nearest place that counts.
        let far = plan.poses[130];
        assert_eq!(plan.first_passage(&far), 130);
    }

    #[test]
    fn orientations_can_tell_reverse() {
        let mut poses = line(41);
        for pose in &mut poses {
            pose.yaw_rad += PI;
        }
        let plan = Plan::of(&message(&poses)).unwrap();
        let backward = RouteSettings {
            use_orientations: true,
            ..settings()
        };
        let route = Route::build(&plan, &poses[0], 0.0, &backward).unwrap();
        assert!(route.trajectory.at(2.0).speed_m_s < 0.0);
        let forward = Route::build(&plan, &poses[0], 0.0, &settings()).unwrap();
        assert!(forward.trajectory.at(2.0).speed_m_s > 0.0);
    }
}
