//! From a requested path to a route that the controller follows.

use super::{
    AfterStop, BUILDING_S, FollowedPath, GoalSession, PlacedRoute, SessionPhase, SessionSettings,
};
use crate::node::message::action::code;
use crate::server::goal_context::{GoalContext, Request, StepRequests};
use crate::server::outcome::Outcome;
use crate::server::path_frame::{has_moved, planar, pose_in};
use crate::server::requested_path::RequestedPath;
use crate::server::route::ProfiledRoute;
use crate::server::termination::Termination;
use nalgebra::{Isometry3, Point3, Vector3};
use sidehill_bridge::safety::StopCause;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use std::f64::consts::FRAC_PI_2;
use std::sync::Arc;
use std::sync::mpsc::{TryRecvError, channel};

/// Time between two checks of the path's frame, s.
const FRAME_PERIOD_S: f64 = 0.1;

impl GoalSession {
    /// Locates the vehicle on the path, builds the route, and hands it to the controller.
    pub(super) fn prepare(
        &mut self,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) {
        let now_s = context.now_s;
        let (SessionPhase::Locating { since_s } | SessionPhase::Building { since_s, .. }) =
            &mut self.phase
        else {
            return;
        };
        if context.estop_unknown {
            *since_s = now_s;
            return;
        }
        let waited_s = now_s - *since_s;
        let done = match &self.phase {
            SessionPhase::Building { route, .. } => match route.try_recv() {
                Err(TryRecvError::Empty)
                    if waited_s <= context.tolerances.failure_s + BUILDING_S =>
                {
                    return;
                }
                Ok(built) => {
                    built.and_then(|route| self.follow_route(route, context, settings, requests))
                }
                Err(_) => Err(Outcome::new(code::UNKNOWN, "the route could not be built")),
            },
            _ => match self.locate(context, settings, requests) {
                Err(_) if waited_s <= context.tolerances.failure_s => return,
                located => located,
            },
        };
        if let Err(outcome) = done {
            let refused = Termination::abort_with(StopCause::PathRefused, outcome);
            self.terminate(now_s, refused, requests);
        }
    }

    /// Starts to build the route from where the vehicle is.
    fn locate(
        &mut self,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) -> Result<(), Outcome> {
        let frame = path_frame(&self.path, context, settings)?;
        let no_pose = || Outcome::new(code::TF_ERROR, "there is no fresh pose of the vehicle");
        let pose = whereabouts(context).ok_or_else(no_pose)?;
        let normal = context
            .decision
            .and_then(|decision| decision.estimate)
            .map_or(Vector3::z(), |estimate| estimate.normal_in_world);
        let point = settings.route.tracked_point.of(&pose, &normal);
        let at = frame.inverse() * Point3::new(point.x_m, point.y_m, 0.0);
        let pose = PlanarPose {
            x_m: at.x,
            y_m: at.y,
            yaw_rad: 0.0,
        };
        if self.path.stays_within(&pose, context.tolerances.goal_xy_m) {
            self.goal = pose_in(&self.path.goal(), &planar(&frame));
            self.stop_first(AfterStop::CheckGoal, !context.is_off(), context, requests);
            return Ok(());
        }
        let (sender, route) = channel();
        let (path, settings) = (Arc::clone(&self.path), settings.route);
        std::thread::Builder::new()
            .name("ros2 path".to_owned())
            .spawn(move || {
                // The receiver is gone if a newer path has arrived.
                let _ = sender.send(ProfiledRoute::build(&path, &pose, &settings));
            })
            .map_err(|error| Outcome::new(code::UNKNOWN, error.to_string()))?;
        self.phase = SessionPhase::Building {
            since_s: context.now_s,
            route,
        };
        Ok(())
    }

    /// Hands the route to the controller, and arms; where it begins behind the vehicle, stops first.
    fn follow_route(
        &mut self,
        mut route: ProfiledRoute,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut StepRequests,
    ) -> Result<(), Outcome> {
        if route.speed_max_m_s != settings.route.limits.speed_max_m_s {
            route = route.with_speeds(&settings.route.limits)?;
        }
        let frame = path_frame(&self.path, context, settings)?;
        let placed = PlacedRoute {
            route,
            frame: planar(&frame),
            changed: false,
        };
        self.frame_error = None;
        self.goal = pose_in(&self.path.goal(), &placed.frame);
        let command = placed.command(self.number, 0.0);
        if let Some(geofence) = &settings.geofence
            && let Some([x_m, y_m]) = geofence.first_outside(&command.trajectory)
        {
            return Err(Outcome::invalid_path(format!(
                "the path leaves the geofence at x = {x_m:.2} m, y = {y_m:.2} m of {}",
                settings.odometry_frame
            )));
        }
        requests.push(Request::Follow(Some(command)));
        let start_rad = placed.route.trajectory.at(0.0).heading_rad + placed.frame.yaw_rad;
        let begins_behind = whereabouts(context)
            .is_some_and(|pose| wrap_angle(pose.yaw_rad - start_rad).abs() > FRAC_PI_2);
        if begins_behind && settings.pivots.at_start && !self.pivoted_at_start {
            let then = AfterStop::PivotTo(start_rad);
            self.stop_first(then, context.is_under_way(), context, requests);
            return Ok(());
        }
        self.following = FollowedPath::Route(Box::new(placed));
        // A vehicle that is under way changes to the new path without a stop.
        if context.is_under_way() && requests.stop_cause().is_none() {
            self.phase = SessionPhase::Driving { tracked: false };
        } else {
            self.progress.reset();
            self.arm(context.now_s, requests);
        }
        Ok(())
    }

    fn stop_first(
        &mut self,
        then: AfterStop,
        moving: bool,
        context: &GoalContext<'_>,
        requests: &mut StepRequests,
    ) {
        self.frame_error = None;
        self.phase = SessionPhase::Stopping {
            since_s: context.now_s,
            then,
        };
        let cause = moving.then_some(StopCause::DriveEnded);
        requests.stop(cause.or(requests.stop_cause()));
    }

    /// Moves the route with the frame of its path, as localization corrects it.
    pub(super) fn follow_frame(&mut self, context: &GoalContext<'_>, settings: &SessionSettings) {
        let now_s = context.now_s;
        // The clock may have jumped back.
        let due = !(0.0..FRAME_PERIOD_S).contains(&(now_s - self.frame_checked_s));
        let estimate = context.decision.and_then(|decision| decision.estimate);
        let (FollowedPath::Route(placed), Some(estimate), true) =
            (&mut self.following, estimate, due)
        else {
            return;
        };
        self.frame_checked_s = now_s;
        match path_frame(&self.path, context, settings) {
            Err(outcome) => self.frame_error = Some(outcome.message),
            Ok(frame) => {
                self.frame_error = None;
                let frame = planar(&frame);
                if has_moved(&placed.frame, &frame, &estimate.pose) {
                    placed.frame = frame;
                    placed.changed = true;
                    self.goal = pose_in(&self.path.goal(), &frame);
                }
            }
        }
    }

    /// Gives the controller a route with a new frame or new speeds, from where the vehicle is on it.
    pub(super) fn hand_over_changes(
        &mut self,
        context: &GoalContext<'_>,
        requests: &mut StepRequests,
    ) {
        let own = context
            .decision
            .filter(|decision| decision.reference == self.number);
        if let FollowedPath::Route(placed) = &mut self.following
            && placed.changed
            && let Some(progress) = own.and_then(|decision| decision.progress)
        {
            placed.changed = false;
            self.number = requests.next_number();
            let command = placed.command(self.number, progress.arc_length_m);
            requests.push(Request::Follow(Some(command)));
        }
    }
}

/// Returns the frame of a path in that of the odometry.
fn path_frame(
    path: &RequestedPath,
    context: &GoalContext<'_>,
    settings: &SessionSettings,
) -> Result<Isometry3<f64>, Outcome> {
    let (odometry, tolerance_s) = (&settings.odometry_frame, context.tolerances.transform_s);
    context
        .transforms
        .look_up(odometry, &path.frame, context.now_s, tolerance_s)
        .map_err(|error| Outcome::new(code::TF_ERROR, error.to_string()))
}

/// Returns the pose of the vehicle, where it is fresh.
fn whereabouts(context: &GoalContext<'_>) -> Option<PlanarPose> {
    let estimate = context.decision?.estimate.as_ref()?;
    let age_s = context.now_s - estimate.time_s + estimate.pose_age_s;
    (age_s <= context.tolerances.transform_s).then_some(estimate.pose)
}
