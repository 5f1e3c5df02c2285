//! From a path that has come to what the controller is given, and what becomes of it when its frame
//! moves or the speed limit changes.

use super::config::Tolerances;
use super::convert::pose_and_attitude;
use super::goals::Outcome;
use super::message::{SpeedLimit, action::code};
use super::route::{Plan, Route, RouteSettings};
use super::transform::Transforms;
use nalgebra::{Isometry3, Point3};
use sidehill_controller::course::{Course, Pivot};
use sidehill_controller::path::Point2;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use std::f64::consts::FRAC_PI_2;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

/// Movement of a frame at the vehicle that is followed, m and rad.
const MOVED_M: f64 = 0.01;
const MOVED_RAD: f64 = 0.002;
/// Slowest drive that a limit asks for, m/s.
const SPEED_MIN_M_S: f64 = 0.01;
/// Yaw rate of a turn on the spot, rad/s.
const TURN_RAD_S: f64 = 0.3;
/// Longest time for smoothing and timing a path, s.
const BUILDING_S: f64 = 20.0;

/// Where the vehicle is, in the frame that is driven in, and how fast it drives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Whereabouts {
    pub(super) pose: PlanarPose,
    pub(super) speed_m_s: f64,
}

/// A path on its way to the controller.
struct Preparing {
    plan: Plan,
    since_s: f64,
    building: Option<Receiver<Result<Route, Outcome>>>,
}

/// A path the controller has.
struct Assigned {
    route: Route,
    /// Where the path's frame is in that of odometry.
    frame: PlanarPose,
}

/// What the controller shall be given.
pub(super) struct Handover {
    pub(super) trajectory: Trajectory,
    /// The goal in the frame that is driven in.
    pub(super) goal: PlanarPose,
    /// The vehicle's heading where the path begins, in that frame, rad.
    pub(super) start_rad: f64,
}

/// What has become of a path that was prepared.
pub(super) enum Prepared {
    /// It can be followed.
    Path(Handover),
    /// It leads nowhere else than where the vehicle is: to this goal, in the frame that is driven in.
    AtGoal(PlanarPose),
}

/// The paths in hand.
pub(super) struct Paths {
    settings: RouteSettings,
    /// Speed wanted where nobody limits it, m/s.
    speed_m_s: f64,
    limit: SpeedLimit,
    odometry_frame: String,
    /// The path in hand as it came.
    plan: Option<Plan>,
    preparing: Option<Preparing>,
    assigned: Option<Assigned>,
}

impl Paths {
    pub(super) fn new(settings: RouteSettings, odometry_frame: &str) -> Self {
        Self {
            speed_m_s: settings.limits.speed_max_m_s,
            limit: SpeedLimit::default(),
            settings,
            odometry_frame: odometry_frame.to_owned(),
            plan: None,
            preparing: None,
            assigned: None,
        }
    }

    /// Takes up a path.
    pub(super) fn prepare(&mut self, plan: Plan, now_s: f64) {
        self.preparing = Some(Preparing {
            plan,
            since_s: now_s,
            building: None,
        });
    }

    /// Takes up the path in hand once more, from where the vehicle is then.
    pub(super) fn prepare_again(&mut self, now_s: f64) {
        if let Some(plan) = self.plan.take() {
            self.prepare(plan, now_s);
        }
    }

    /// Has the path that is being prepared begin its waits anew.
    pub(super) fn postpone(&mut self, now_s: f64) {
        if let Some(preparing) = &mut self.preparing {
            preparing.since_s = now_s;
        }
    }

    /// Forgets the path that is being prepared, and the one that is driven where `all`.
    pub(super) fn forget(&mut self, all: bool) {
        self.preparing = None;
        if all {
            self.set_aside();
            self.plan = None;
        }
    }

    /// Has the controller follow something else than the path in hand for now.
    pub(super) fn set_aside(&mut self) {
        self.assigned = None;
    }

    /// Returns the length of the path in hand, m.
    pub(super) fn length_m(&self) -> Option<f64> {
        let assigned = self.assigned.as_ref()?;
        Some(assigned.route.trajectory.length_m())
    }

    /// Goes on with what is being prepared: needs where the vehicle is and the path's frame, for
    /// which it waits `failure_s` of the tolerances, then time to smooth.
    pub(super) fn step(
        &mut self,
        now_s: f64,
        here: Option<Whereabouts>,
        transforms: &Transforms,
        tolerances: &Tolerances,
    ) -> Option<Result<Prepared, Outcome>> {
        let (tolerance_s, patience_s) = (tolerances.transform_s, tolerances.failure_s);
        let preparing = self.preparing.as_mut()?;
        let waited_s = now_s - preparing.since_s;
        let frame = preparing.plan.frame.clone();
        if let Some(building) = &preparing.building {
            let built = match building.try_recv() {
                Ok(built) => built,
                Err(TryRecvError::Empty) if waited_s <= patience_s + BUILDING_S => return None,
                Err(_) => Err(Outcome::new(code::UNKNOWN, "the path could not be made")),
            };
            let handed = built.and_then(|route| {
                let found = transforms.look_up(&self.odometry_frame, &frame, now_s, tolerance_s);
                let frame =
                    found.map_err(|error| Outcome::new(code::TF_ERROR, error.to_string()))?;
                Ok(Prepared::Path(self.hand_over(route, planar(&frame))))
            });
            self.plan = self.preparing.take().map(|preparing| preparing.plan);
            return Some(handed);
        }
        let found = transforms.look_up(&self.odometry_frame, &frame, now_s, tolerance_s);
        let trouble = match (found, here) {
            (Ok(in_odometry), Some(here)) => {
                let at = in_odometry.inverse() * Point3::new(here.pose.x_m, here.pose.y_m, 0.0);
                let pose = PlanarPose {
                    x_m: at.x,
                    y_m: at.y,
                    yaw_rad: 0.0,
                };
                if preparing.plan.stays_within(&pose, tolerances.goal_xy_m) {
                    let goal = seen_from(&preparing.plan.goal(), &planar(&in_odometry));
                    self.preparing = None;
                    return Some(Ok(Prepared::AtGoal(goal)));
                }
                let (sender, receiver) = channel();
                let (plan, settings) = (preparing.plan.clone(), self.settings);
                let thread = std::thread::Builder::new().name("ros2 path".to_owned());
                let started = thread.spawn(move || {
                    let route = Route::build(&plan, &pose, here.speed_m_s, &settings);
                    // Nobody waits for it where another path has come.
                    let _ = sender.send(route);
                });
                match started {
                    Ok(_) => {
                        preparing.building = Some(receiver);
                        return None;
                    }
                    Err(error) => Outcome::new(code::UNKNOWN, error.to_string()),
                }
            }
            (Err(error), _) => Outcome::new(code::TF_ERROR, error.to_string()),
            (Ok(_), None) => Outcome::new(code::TF_ERROR, "there is no fresh pose of the vehicle"),
        };
        if waited_s <= patience_s {
            return None;
        }
        self.preparing = None;
        Some(Err(trouble))
    }

    fn hand_over(&mut self, route: Route, frame: PlanarPose) -> Handover {
        let handover = handover(&route, &frame);
        self.assigned = Some(Assigned { route, frame });
        handover
    }

    /// Looks whether the frame of the path that is driven has moved: returns why that is not known,
    /// or the path where it is now.
    pub(super) fn follow_frame(
        &mut self,
        now_s: f64,
        pose: &PlanarPose,
        transforms: &Transforms,
        tolerance_s: f64,
    ) -> Result<Option<Handover>, String> {
        let Some(assigned) = &mut self.assigned else {
            return Ok(None);
        };
        let frame = &assigned.route.frame;
        let found = transforms
            .look_up(&self.odometry_frame, frame, now_s, tolerance_s)
            .map_err(|error| error.to_string())?;
        let (now, before) = (planar(&found), assigned.frame);
        let turned_rad = wrap_angle(now.yaw_rad - before.yaw_rad);
        // The point of the path's frame at which the vehicle was is now elsewhere.
        let (sin, cos) = turned_rad.sin_cos();
        let (x_m, y_m) = (pose.x_m - before.x_m, pose.y_m - before.y_m);
        let moved_m = (now.x_m + cos * x_m - sin * y_m - pose.x_m)
            .hypot(now.y_m + sin * x_m + cos * y_m - pose.y_m);
        if moved_m <= MOVED_M && turned_rad.abs() <= MOVED_RAD {
            return Ok(None);
        }
        assigned.frame = now;
        Ok(Some(handover(&assigned.route, &now)))
    }

    /// Returns a turn on the spot from a pose.
    pub(super) fn turn(&self, from: &PlanarPose, angle_rad: f64) -> Result<Trajectory, Outcome> {
        let limits = &self.settings.limits;
        let fastest_rad_s = 2.0 * limits.steer_max_m_s / limits.track_width_m;
        let turn = Course::Pivot(Pivot {
            angle_deg: angle_rad.to_degrees(),
            yaw_rate_rad_s: TURN_RAD_S.min(fastest_rad_s),
            centre_forward_m: 0.0,
        });
        turn.trajectory(limits)
            .map(|trajectory| trajectory.seen_from(from))
            .map_err(|error| Outcome::new(code::UNKNOWN, error.to_string()))
    }

    /// Takes a limit of the speed, and returns the path in hand at its new speeds; none where nothing
    /// changes. A limit that is no speed is not believed.
    pub(super) fn limit(&mut self, limit: &SpeedLimit) -> Option<Handover> {
        if limit.speed_limit.is_finite() && limit.speed_limit >= 0.0 {
            self.limit = limit.clone();
        }
        self.at_speed()
    }

    /// Takes the speed wanted where nobody limits it, and returns the same.
    pub(super) fn want_speed(&mut self, speed_m_s: f64) -> Option<Handover> {
        self.speed_m_s = speed_m_s;
        self.at_speed()
    }

    fn at_speed(&mut self) -> Option<Handover> {
        let limited_m_s = match (self.limit.percentage, self.limit.speed_limit) {
            (_, 0.0) => self.speed_m_s,
            (true, share) => self.speed_m_s * share / 100.0,
            (false, speed_m_s) => speed_m_s,
        };
        let speed_m_s = limited_m_s.min(self.speed_m_s).max(SPEED_MIN_M_S);
        if speed_m_s == self.settings.limits.speed_max_m_s {
            return None;
        }
        self.settings.limits.speed_max_m_s = speed_m_s;
        let assigned = self.assigned.as_mut()?;
        assigned.route = assigned.route.at_speeds(&self.settings.limits).ok()?;
        Some(handover(&assigned.route, &assigned.frame))
    }
}

fn handover(route: &Route, frame: &PlanarPose) -> Handover {
    Handover {
        trajectory: route.trajectory.clone().seen_from(frame),
        start_rad: route.trajectory.at(0.0).heading_rad + frame.yaw_rad,
        goal: seen_from(&route.goal, frame),
    }
}

/// Returns a pose that is given in a frame where that frame is.
fn seen_from(pose: &PlanarPose, frame: &PlanarPose) -> PlanarPose {
    let at = Point2 {
        x_m: pose.x_m,
        y_m: pose.y_m,
    }
    .seen_from(frame);
    PlanarPose {
        x_m: at.x_m,
        y_m: at.y_m,
        yaw_rad: pose.yaw_rad + frame.yaw_rad,
    }
}

/// Returns where a frame is in the plane: its turn is that of its heading.
fn planar(frame: &Isometry3<f64>) -> PlanarPose {
    // A frame that is not turned looks along x, which is a heading of -90 deg.
    let mut pose = pose_and_attitude(frame).0.planar();
    pose.yaw_rad += FRAC_PI_2;
    pose
}

#[cfg(test)]
mod tests;
