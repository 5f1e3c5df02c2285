//! A goal from its acceptance to its result.
//!
//! ```text
//! Locating -> Building -> Arming -> Driving -> Ending
//!     |           `-> Stopping -^     |  ^
//!     `-> Stopping           ^        |--' pivot
//!                            |        v
//!                            `---- Blocked
//! ```
//!
//! *Locating* waits for the pose of the vehicle and the transform of the path's frame, *Building* for the
//! smooth curve. *Stopping* brings a vehicle to a halt that is to pivot first, or is at its goal already. A
//! path that begins behind the vehicle is preceded by a pivot and then located again; a goal with another
//! heading is followed by one. *Blocked* waits for an obstacle to leave the way. *Ending* waits until the vehicle
//! has stopped; then the client gets the result.
//!
//! Time is an argument, and nothing in here touches the network. The safety stops the vehicle on its own; a
//! session only requests stops, and gives their reasons a code.

mod ahead;
mod drive;
mod obstacles;
mod passing;
mod placed_route;
mod prepare;
mod waiting;

use self::placed_route::PlacedRoute;
use super::checkers::ProgressChecker;
use super::goal_context::{GoalContext, PathSource, Request, StepRequests};
use super::outcome::Outcome;
use super::path_frame::{inverse, pose_in};
use super::requested_path::RequestedPath;
use super::route::{ProfiledRoute, RouteSettings};
use super::termination::{Termination, abort_cause};
use crate::node::goals::GoalEnd;
use crate::node::message::action::code;
use sidehill_bridge::safety::{Geofence, StopCause};
use sidehill_controller::controller::Decision;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::vehicle::Vehicle;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::mpsc::Receiver;

/// Longest time for building a route, s.
const BUILDING_S: f64 = 20.0;

/// When the vehicle pivots.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct PivotSettings {
    /// Where a path begins behind it.
    pub at_start: bool,
    /// Where the heading of the goal is another than that at the end of the path.
    pub at_goal: bool,
}

/// What all sessions share.
#[derive(Debug, Clone)]
pub(crate) struct SessionSettings {
    pub(crate) route: RouteSettings,
    pub(crate) pivots: PivotSettings,
    pub(crate) odometry_frame: String,
    /// Model by which the slide of a pivot is predicted.
    pub(crate) vehicle: Vehicle,
    /// Area that no path may leave.
    pub(crate) geofence: Option<Geofence>,
}

/// What the controller follows for this session.
enum FollowedPath {
    Nothing,
    Route(Box<PlacedRoute>),
    /// A pivot to the first heading of the path, rad.
    StartPivot(f64),
    /// A pivot to the heading of the goal, rad.
    GoalPivot(f64),
}

#[derive(Clone, Copy)]
enum AfterStop {
    /// Pivot to this heading, rad; then the path follows.
    PivotTo(f64),
    /// Nothing follows on the path: check the goal.
    CheckGoal,
}

enum SessionPhase {
    Locating {
        since_s: f64,
    },
    Building {
        since_s: f64,
        route: Receiver<Result<ProfiledRoute, Outcome>>,
    },
    Stopping {
        since_s: f64,
        then: AfterStop,
    },
    Arming {
        since_s: f64,
        /// Number of the request to arm.
        request: u64,
    },
    Driving {
        /// Whether the controller has tracked what it follows.
        tracked: bool,
    },
    Blocked(Blocked),
    Ending {
        since_s: f64,
        end: GoalEnd,
        outcome: Outcome,
    },
}

/// A vehicle that waits for its way to become free.
struct Blocked {
    since_s: f64,
    /// Since when the way is free.
    free_since_s: Option<f64>,
    /// Whether the drives were on, or about to be, and the safety ends that.
    was_driving: bool,
    cause: StopCause,
    outcome: Outcome,
}

/// Where the vehicle is on the route of a goal.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TrackingState {
    /// Distance from the route, m, positive to the left of travel.
    pub(crate) cross_track_m: f64,
    /// Distance of the route from the path, m, likewise: not 0 where it passes an obstacle.
    pub(crate) aside_m: f64,
    /// Heading less that of the reference, rad.
    pub(crate) heading_error_rad: f64,
    /// Straight distance to the goal, m.
    pub(crate) distance_to_goal_m: f64,
    /// Distance left along the path, m.
    pub(crate) left_m: f64,
    /// Index of the pose of the client's path that the vehicle is at.
    pub(crate) path_index: usize,
}

/// A goal with its phase, path, client and number.
pub(crate) struct GoalSession {
    client: PathSource,
    /// Whether the client has left.
    client_lost: bool,
    /// Number under which the controller has the path or the pivot.
    number: u64,
    path: Arc<RequestedPath>,
    phase: SessionPhase,
    following: FollowedPath,
    /// The goal in the frame of the odometry; known from the end of locating on.
    goal: PlanarPose,
    pivoted_at_start: bool,
    progress: ProgressChecker,
    frame_checked_s: f64,
    /// Time of the newest check for obstacles, s.
    obstacles_checked_s: f64,
    /// Time of the newest look for a course past an obstacle, s.
    passing_tried_s: f64,
    /// Index of the newest pose of the path that the vehicle was at.
    passed_index: Cell<usize>,
    /// Arc length that the vehicle has reached on the route, m.
    reached_m: f64,
    /// Why the frame of the path is unknown.
    frame_error: Option<String>,
    without_frame_since_s: Option<f64>,
    without_plan_since_s: Option<f64>,
}

impl GoalSession {
    /// Returns the session of a new path. Progress is that of the session before: a client that sends newer
    /// paths again and again still learns that the vehicle makes none.
    pub(crate) fn new(
        client: PathSource,
        path: RequestedPath,
        number: u64,
        progress: ProgressChecker,
        now_s: f64,
    ) -> Self {
        Self {
            client,
            client_lost: false,
            number,
            path: Arc::new(path),
            phase: SessionPhase::Locating { since_s: now_s },
            following: FollowedPath::Nothing,
            goal: PlanarPose::default(),
            pivoted_at_start: false,
            progress,
            frame_checked_s: f64::NEG_INFINITY,
            obstacles_checked_s: f64::NEG_INFINITY,
            passing_tried_s: f64::NEG_INFINITY,
            passed_index: Cell::new(0),
            reached_m: 0.0,
            frame_error: None,
            without_frame_since_s: None,
            without_plan_since_s: None,
        }
    }

    /// Returns the client.
    pub(crate) fn client(&self) -> PathSource {
        self.client
    }

    /// Takes that the client has left.
    pub(crate) fn lose_client(&mut self) {
        self.client_lost = true;
    }

    /// Ends the session for a newer path, and returns how.
    pub(crate) fn preempt(self) -> (ProgressChecker, Request) {
        let (end, outcome) = match self.phase {
            SessionPhase::Ending { end, outcome, .. } => (end, outcome),
            _ => {
                let outcome = Outcome::new(code::UNKNOWN, "a newer path has arrived");
                (GoalEnd::Aborted, outcome)
            }
        };
        let client = self.client;
        let finish = Request::Finish {
            client,
            end,
            outcome,
        };
        (self.progress, finish)
    }

    /// Ends the session; the client gets the result when the vehicle has stopped.
    pub(crate) fn terminate(
        &mut self,
        now_s: f64,
        termination: Termination,
        requests: &mut StepRequests,
    ) {
        if let SessionPhase::Ending { .. } = self.phase {
            return;
        }
        self.phase = SessionPhase::Ending {
            since_s: now_s,
            end: termination.end,
            outcome: termination.outcome,
        };
        requests.push(Request::Arm(0));
        requests.stop(Some(termination.cause));
    }

    /// Returns the distance left along the path, m, and the commanded speed, m/s, while the route of a goal
    /// is followed.
    pub(crate) fn feedback(&self, decision: &Decision) -> Option<(f64, f64)> {
        let FollowedPath::Route(placed) = &self.following else {
            return None;
        };
        let own = Some(decision).filter(|decision| decision.reference == self.number)?;
        let left_m = placed.route.trajectory.length_m() - own.progress?.arc_length_m;
        Some((left_m.max(0.0), own.command_effective.traction_m_s))
    }

    /// Returns how much of the route is left, m, while the vehicle drives it or comes to a halt on it; a detour past an
    /// obstacle counts as the stretch beside it.
    pub(crate) fn left_on_route_m(&self, decision: &Decision) -> Option<f64> {
        let (
            FollowedPath::Route(placed),
            SessionPhase::Driving { .. } | SessionPhase::Blocked(_) | SessionPhase::Ending { .. },
        ) = (&self.following, &self.phase)
        else {
            return None;
        };
        let own = Some(decision).filter(|decision| decision.reference == self.number)?;
        Some(placed.route.left_m(own.progress?.arc_length_m))
    }

    /// Returns where the vehicle is on the route of a goal that is followed.
    pub(crate) fn tracking(&self, decision: &Decision) -> Option<TrackingState> {
        let (left_m, _) = self.feedback(decision)?;
        let (progress, estimate) = (decision.progress?, decision.estimate?);
        let FollowedPath::Route(placed) = &self.following else {
            return None;
        };
        let (pose, goal) = (&estimate.pose, &self.goal);
        let in_path = pose_in(pose, &inverse(&placed.frame));
        Some(TrackingState {
            cross_track_m: progress.cross_track_m,
            aside_m: placed.route.aside_m(progress.arc_length_m),
            heading_error_rad: wrap_angle(pose.yaw_rad - progress.point.heading_rad),
            distance_to_goal_m: (pose.x_m - goal.x_m).hypot(pose.y_m - goal.y_m),
            left_m,
            path_index: self.path.nearest_from(self.passed_index.get(), &in_path),
        })
        .inspect(|tracking| self.passed_index.set(tracking.path_index))
    }

    /// Changes the speeds of the route that is followed to those of the settings. A route that is being
    /// built gets them when it is finished.
    pub(crate) fn change_speeds(&mut self, settings: &RouteSettings) {
        let FollowedPath::Route(placed) = &mut self.following else {
            return;
        };
        if let Ok(route) = placed.route.with_speeds(&settings.limits) {
            placed.route = route;
            placed.changed = true;
        }
    }

    /// Runs one step, and returns whether the session has ended.
    pub(crate) fn step(
        &mut self,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) -> bool {
        self.prepare(context, settings, requests);
        if !matches!(self.phase, SessionPhase::Ending { .. }) {
            self.follow_frame(context, settings);
            self.hand_over_changes(context, requests);
        }
        self.watch_obstacles(context, settings, requests);
        match self.phase {
            SessionPhase::Locating { .. } | SessionPhase::Building { .. } => {
                if let Some(termination) = abort_cause(context) {
                    self.terminate(context.now_s, termination, requests);
                } else {
                    Self::withdraw_stop(context, requests);
                }
            }
            SessionPhase::Stopping { since_s, then } => {
                self.step_stopping((since_s, then), context, settings, requests);
            }
            SessionPhase::Arming { since_s, request } => {
                self.step_arming((since_s, request), context, requests);
            }
            SessionPhase::Driving { tracked } if context.is_off() => {
                self.step_stopped(tracked, context, settings, requests);
            }
            SessionPhase::Driving { .. } => self.step_driving(context, requests),
            SessionPhase::Blocked(_) => self.step_blocked(context, settings, requests),
            SessionPhase::Ending { since_s, .. } => {
                return self.step_ending(since_s, context, requests);
            }
        }
        false
    }
}
