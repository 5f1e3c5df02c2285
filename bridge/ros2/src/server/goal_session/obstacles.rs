//! Obstacles on the way of a session: slower ahead of them, a stop in time, and on when the way is free.

use super::ahead::{Mount, REFERENCE_STEP_M, along, nearer};
use super::{Blocked, Following, GoalSession, Phase, SessionSettings};
use crate::node::message::action::code;
use crate::server::goal_context::{GoalContext, ObstacleContext, Request, Requests};
use crate::server::obstacles::{Ahead, Blockage, Braking, Doubt, StoppingSettings};
use crate::server::outcome::Outcome;
use crate::server::pivot_slide::pivot_poses;
use crate::server::route::{Approach, pivot_rate_rad_s};
use crate::server::termination::{Termination, abort_cause, ended_by_safety};
use sidehill_bridge::safety::{Reason, StopCause};
use sidehill_controller::controller::Decision;
use sidehill_controller::estimator::Estimate;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::speeds::MotorSpeeds;

/// Least time between two checks, s; the thread that checks is late by up to the rest of
/// [`StoppingSettings::CHECK_S`].
const CHECK_PERIOD_S: f64 = 0.5 * StoppingSettings::CHECK_S;
/// Time for which the way must be free before a stopped vehicle resumes, s.
const FREE_S: f64 = 0.5;
/// Distance that must be free beyond the gap before it resumes, m.
const RESUME_M: f64 = 0.1;
/// Change of a stop along the route from which on the speeds are changed, m.
const MOVED_M: f64 = 0.02;

/// What a check finds.
enum Finding {
    /// The way is free, or free until an arc length of the route at which the vehicle would stop.
    Go(Option<Approach>),
    /// The vehicle must stop.
    Stop(StopCause, Outcome),
}

impl GoalSession {
    /// Returns what keeps the vehicle from driving; none where nothing does.
    pub(crate) fn blocked_by(&self) -> Option<&str> {
        match &self.phase {
            Phase::Blocked(blocked) => Some(&blocked.outcome.message),
            _ => None,
        }
    }

    /// Checks the way ahead when a check is due, and slows down or stops.
    pub(super) fn watch_obstacles(
        &mut self,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut Requests,
    ) {
        let now_s = context.now_s;
        let own = context
            .decision
            .filter(|decision| decision.reference == self.number);
        if let Some(progress) = own.and_then(|decision| decision.progress) {
            self.reached_m = progress.arc_length_m;
        }
        // The clock may have jumped back.
        let due = !(0.0..CHECK_PERIOD_S).contains(&(now_s - self.obstacles_checked_s));
        let was_driving = match self.phase {
            Phase::Driving { .. } => true,
            Phase::Arming { request, .. } => context.armed >= request,
            Phase::Blocked(_) => false,
            _ => return,
        };
        let Some(obstacles) = context.obstacles.as_ref().filter(|_| due) else {
            return;
        };
        self.obstacles_checked_s = now_s;
        self.pass_obstacle(context, obstacles, settings, requests);
        let finding = self.check_way(context, obstacles, settings);
        match (&mut self.phase, finding) {
            (Phase::Blocked(blocked), Finding::Go(_)) => {
                blocked.free_since_s.get_or_insert(now_s);
            }
            (Phase::Blocked(blocked), Finding::Stop(_, outcome)) => {
                blocked.free_since_s = None;
                blocked.outcome = outcome;
            }
            (_, Finding::Go(approach)) => self.slow_down(approach, settings),
            (_, Finding::Stop(cause, outcome)) => {
                let message = format!("the vehicle stops and waits: {}", outcome.message);
                requests.push(Request::Warn(message));
                requests.push(Request::Arm(0));
                requests.stop(Some(cause));
                self.phase = Phase::Blocked(Blocked {
                    since_s: now_s,
                    free_since_s: None,
                    was_driving,
                    cause,
                    outcome,
                });
            }
        }
    }

    /// Waits until the way has been free for long enough, then resumes; aborts after the longest wait.
    pub(super) fn step_blocked(
        &mut self,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut Requests,
    ) {
        let now_s = context.now_s;
        let (Phase::Blocked(blocked), Some(obstacles)) = (&self.phase, &context.obstacles) else {
            return;
        };
        let stopped = context.has_stopped_since(blocked.since_s);
        let other_end = blocked.was_driving
            && stopped
            && !matches!(
                context.stopped_by,
                Some(Reason::Requested(cause)) if cause == blocked.cause
            )
            && context.stopped_by != Some(Reason::Finished);
        let termination = if let Some(termination) = abort_cause(context) {
            Some(termination)
        } else if self.client_lost {
            Some(Termination::abort(code::UNKNOWN, StopCause::ClientLeft))
        } else if other_end {
            let outcome = ended_by_safety(context);
            Some(Termination::abort_with(StopCause::DriveEnded, outcome))
        } else if now_s - blocked.since_s > obstacles.settings.config.patience_s {
            let (cause, mut outcome) = (blocked.cause, blocked.outcome.clone());
            let waited_s = now_s - blocked.since_s;
            outcome.message += &format!(", waited {waited_s:.1} s");
            Some(Termination::abort_with(cause, outcome))
        } else {
            None
        };
        if let Some(termination) = termination {
            return self.terminate(now_s, termination, requests);
        }
        let free = blocked
            .free_since_s
            .is_some_and(|since_s| now_s - since_s >= FREE_S);
        let estimate = context.decision.and_then(|decision| decision.estimate);
        if let Some(estimate) = estimate.filter(|_| free && stopped && !context.estop_unknown) {
            requests.push(Request::Warn(
                "the way is free, the vehicle goes on".to_owned(),
            ));
            requests.stop(None);
            self.resume(&estimate, context, settings, requests);
        }
    }

    fn resume(
        &mut self,
        estimate: &Estimate,
        context: &GoalContext<'_>,
        settings: &SessionSettings,
        requests: &mut Requests,
    ) {
        match &self.following {
            Following::Route(placed) => {
                self.number = requests.next_number();
                let command = placed.command(self.number, self.reached_m);
                requests.push(Request::Follow(Some(command)));
                self.progress.reset();
                self.arm(context.now_s, requests);
            }
            Following::StartPivot(heading_rad) | Following::GoalPivot(heading_rad) => {
                let angle_rad = wrap_angle(heading_rad - estimate.pose.yaw_rad);
                let following = std::mem::replace(&mut self.following, Following::Nothing);
                let target = (following, angle_rad);
                self.pivot(target, &estimate.pose, context, settings, requests);
            }
            Following::Nothing => {}
        }
    }

    /// Changes the speeds of the route where the place of a stop has moved.
    fn slow_down(&mut self, approach: Option<Approach>, settings: &SessionSettings) {
        let Following::Route(placed) = &mut self.following else {
            return;
        };
        let moved = match (placed.route.approach(), &approach) {
            (None, None) => false,
            (Some(before), Some(now)) => (now.stop_at_m - before.stop_at_m).abs() > MOVED_M,
            _ => true,
        };
        if moved
            && let Ok(route) = placed
                .route
                .clone()
                .approaching(approach, &settings.route.limits)
        {
            placed.route = route;
            placed.changed = true;
        }
    }

    fn check_way(
        &self,
        context: &GoalContext<'_>,
        obstacles: &ObstacleContext<'_>,
        settings: &SessionSettings,
    ) -> Finding {
        let surroundings = match &obstacles.seen {
            Ok(surroundings) => surroundings,
            Err(doubt) => {
                let code = match doubt {
                    Doubt::NoCostmap | Doubt::Stale { .. } => code::CONTROLLER_TIMED_OUT,
                    Doubt::NoTransform(_) => code::TF_ERROR,
                };
                return Finding::Stop(
                    StopCause::CostmapUnknown,
                    Outcome::new(code, doubt.to_string()),
                );
            }
        };
        let Some(decision) = context.decision else {
            return Finding::Go(None);
        };
        let Some(estimate) = &decision.estimate else {
            return Finding::Go(None);
        };
        // As the controller means to move; a plan for another drive says nothing.
        let own = decision.reference == self.number;
        let plan = context.plan.iter().filter(|_| own);
        let predicted = surroundings.clearance(along(&estimate.pose, plan));
        match &self.following {
            Following::Nothing => Finding::Go(None),
            Following::StartPivot(heading_rad) | Following::GoalPivot(heading_rad) => {
                let sweeps = sweeps(estimate, *heading_rad, settings);
                let [held, slid] = sweeps.map(|poses| surroundings.clearance(poses));
                match nearer(predicted, nearer(held, slid)).blockage {
                    Some(blockage) => Finding::Stop(StopCause::Obstacle, pivot_blocked(blockage)),
                    None => Finding::Go(None),
                }
            }
            Following::Route(placed) => {
                let trajectory = &placed.route.trajectory;
                let here = trajectory.at(trajectory.time_at(self.reached_m));
                let config = &obstacles.settings.config;
                let braking = obstacles
                    .settings
                    .braking(&estimate.attitude, here.speed_m_s < 0.0);
                let approach = braking.approach();
                let look_m = approach.distance_m(settings.route.limits.speed_max_m_s)
                    + config.margin_m
                    + REFERENCE_STEP_M;
                // The path is that of the tracked point, the footprint is around the origin.
                let mount = Mount {
                    point: settings.route.tracked_point,
                    normal_in_world: estimate.normal_in_world,
                };
                let reference = placed.poses_ahead(self.reached_m, look_m, mount);
                let nearest = nearer(predicted, surroundings.clearance(reference));
                let Some(blockage) = nearest.blockage else {
                    return Finding::Go(None);
                };
                let waiting = matches!(self.phase, Phase::Blocked(_));
                let stop_m = config.margin_m + braking_m(&braking, decision, estimate, waiting);
                if nearest.free_m <= stop_m {
                    return Finding::Stop(
                        StopCause::Obstacle,
                        way_blocked(blockage, nearest.free_m),
                    );
                }
                Finding::Go(Some(Approach {
                    stop_at_m: self.reached_m + nearest.free_m - config.margin_m,
                    speed: approach,
                }))
            }
        }
    }
}

/// Returns the way that a vehicle needs for a stop, m, or one that waits needs to go on.
fn braking_m(braking: &Braking, decision: &Decision, estimate: &Estimate, waiting: bool) -> f64 {
    if waiting {
        return RESUME_M;
    }
    let measured_m_s = MotorSpeeds::from(estimate.treads).traction_m_s.abs();
    let commanded_m_s = decision.command_effective.traction_m_s.abs();
    braking.distance_m(measured_m_s.max(commanded_m_s))
}

/// Returns the poses of a turn on the spot, from beginning to end: of a vehicle that keeps its place, and of one
/// that slides as the slope makes it.
fn sweeps(estimate: &Estimate, heading_rad: f64, settings: &SessionSettings) -> [Vec<Ahead>; 2] {
    let from = estimate.pose;
    let turn_rad = wrap_angle(heading_rad - from.yaw_rad);
    let rate_rad_s = pivot_rate_rad_s(&settings.route.limits);
    let attitude = estimate.attitude;
    let slid = pivot_poses(&settings.vehicle, attitude, from, turn_rad, rate_rad_s);
    let held = slid.iter().map(|pose| PlanarPose {
        yaw_rad: pose.yaw_rad,
        ..from
    });
    [held.collect(), slid].map(|poses: Vec<PlanarPose>| {
        let here = |pose| Ahead {
            pose,
            distance_m: 0.0,
        };
        poses.into_iter().map(here).collect()
    })
}

/// Returns the outcome for a blocked path: that of Nav2's controller server when its
/// controller has seen a collision ahead for too long.
fn way_blocked(blockage: Blockage, free_m: f64) -> Outcome {
    let message = match blockage {
        Blockage::Obstacle => format!("an obstacle is {free_m:.2} m ahead"),
        Blockage::MapEnds => format!("the costmap ends {free_m:.2} m ahead"),
    };
    Outcome::new(code::PATIENCE_EXCEEDED, message)
}

fn pivot_blocked(blockage: Blockage) -> Outcome {
    let message = match blockage {
        Blockage::Obstacle => "an obstacle is in the way of a turn on the spot",
        Blockage::MapEnds => "the costmap ends within a turn on the spot",
    };
    Outcome::new(code::PATIENCE_EXCEEDED, message)
}
