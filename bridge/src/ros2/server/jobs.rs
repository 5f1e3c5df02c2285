//! What the server does with goals and paths: take them, hand them over, look after them, tell.

use super::{FEEDBACK_S, FRAME_S, Server};
use crate::control_loop::channel::{LoopStatus, PathCommand};
use crate::ros2::executive::{Client, Effect, Seen};
use crate::ros2::follow_path::NewGoal;
use crate::ros2::goals::{GoalEnd, Outcome};
use crate::ros2::inputs::drain;
use crate::ros2::message::action::{FollowPathFeedback, code};
use crate::ros2::paths::{Handover, Prepared, Whereabouts};
use crate::ros2::peers::participant;
use crate::ros2::route::Plan;
use crate::safety::{SafetyState, StopCause};
use ros2_client::action::GoalStatusEnum;
use ros2_client::builtin_interfaces::Time;
use ros2_client::log::LogLevel;
use sidehill_controller::controller::Decision;
use sidehill_plant::frames::wrap_angle;
use std::f64::consts::FRAC_PI_2;
use std::time::Instant;

impl Server {
    pub(super) fn take_goal(&mut self, goal: NewGoal, now_s: f64) {
        let stamp = Time::from_nanos(self.time.stamp_ns(now_s));
        let active = self.services.lifecycle.is_active();
        let accepted = active && self.goals.accept(goal.id, stamp);
        self.action.answer_goal(goal.request, accepted, stamp);
        if !accepted {
            let why = match active {
                true => "it is not new",
                false => "the node is not active",
            };
            self.log(LogLevel::Warn, &format!("a goal is refused: {why}"));
            return;
        }
        let count = goal.path.poses.len();
        let waits = match self.emergency_stop_is_awaited(false) {
            true => ", and waits for the first word of the emergency stop",
            false => "",
        };
        let message = format!("a goal of {count} poses is accepted{waits}");
        self.log(LogLevel::Info, &message);
        self.statuses_changed = true;
        self.accepted += 1;
        let client = Some((participant(&goal.request), false));
        let plan = self.named(&goal).and_then(|()| Plan::of(&goal.path));
        self.take_plan(Client::Goal(goal.id), plan, now_s);
        self.client = client;
    }

    /// Returns whether a goal names what there is.
    fn named(&self, goal: &NewGoal) -> Result<(), Outcome> {
        let config = &self.config.follow_path;
        for (kind, asked, own) in [
            ("controller", &goal.controller_id, &config.controller_id),
            (
                "goal checker",
                &goal.goal_checker_id,
                &config.goal_checker_id,
            ),
            (
                "progress checker",
                &goal.progress_checker_id,
                &config.progress_checker_id,
            ),
        ] {
            if !asked.is_empty() && asked != own {
                let message = format!("there is no {kind} {asked}, only {own}");
                return Err(Outcome::new(code::INVALID_CONTROLLER, message));
            }
        }
        Ok(())
    }

    pub(super) fn take_path_topic(&mut self, now_s: f64) {
        let mut newest = None;
        if let Some(path) = &self.path {
            drain(path, |message| newest = Some(message));
        }
        if let Some(path) = newest.filter(|_| self.services.lifecycle.is_active()) {
            self.client = None;
            self.take_plan(Client::Topic, Plan::of(&path), now_s);
        }
    }

    fn take_plan(&mut self, client: Client, plan: Result<Plan, Outcome>, now_s: f64) {
        let (number, effects) = self.executive.begin(client);
        self.next_number = number;
        self.carry_out(effects, now_s);
        match plan {
            Ok(plan) => self.paths.prepare(plan, now_s),
            Err(outcome) => self.fail(StopCause::PathRefused, outcome, now_s),
        }
    }

    pub(super) fn fail(&mut self, cause: StopCause, outcome: Outcome, now_s: f64) {
        self.paths.forget(false);
        let effects = self
            .executive
            .end(now_s, GoalEnd::Aborted, (cause, outcome));
        self.carry_out(effects, now_s);
    }

    pub(super) fn take_speed_limit(&mut self) {
        let mut newest = None;
        drain(&self.speed_limit, |message| newest = Some(message));
        if let Some(limit) = newest
            && let Some(handover) = self.paths.limit(&limit)
        {
            self.replace(handover);
        }
    }

    /// Gives the controller the path it has, changed, where it has come to on it.
    pub(super) fn replace(&mut self, handover: Handover) {
        let Some(before) = self.executive.driven() else {
            return;
        };
        let decision = self.dispatcher.controller_status().decision;
        let progress = decision
            .filter(|decision| decision.reference == before)
            .and_then(|decision| decision.progress);
        if let Some(progress) = progress
            && let Some(number) = self.executive.renumber()
        {
            self.dispatcher.set_path(Some(PathCommand {
                number,
                trajectory: handover.trajectory,
                from_m: progress.arc_length_m,
            }));
        }
    }

    pub(super) fn look_after(&mut self, now_s: f64, clock_jumped: bool) {
        let view = self.dispatcher.loop_status();
        let decision = self.dispatcher.controller_status().decision;
        self.hand_over(now_s, view.as_ref(), decision.as_ref());
        self.look_at_frame(now_s, decision.as_ref());
        let state = view.map_or(SafetyState::Disarmed, |view| view.row.state);
        let effects = self.executive.step(
            &Seen {
                now_s,
                cycle_s: view.map_or(f64::NEG_INFINITY, |view| view.row.time_s),
                state,
                armed: view.map_or(0, |view| view.armed),
                stopped_by: view.and_then(|view| view.stopped_by),
                decision: decision.as_ref(),
                transform: self.transform.as_deref(),
                emergency_stop: self.shared.emergency_stop.get(),
                emergency_stop_awaited: self.emergency_stop_is_awaited(true),
                clock_jumped,
                client_lost: self.client.is_some_and(|(_, left)| left),
            },
            &self.config.tolerances,
        );
        self.carry_out(effects, now_s);
        self.feed_back(now_s, decision.as_ref());
        self.tell(now_s, view.as_ref());
    }

    fn emergency_stop_is_awaited(&self, driving: bool) -> bool {
        self.shared.words().is_awaited(Instant::now(), driving)
    }

    /// Goes on with a path that is being prepared.
    fn hand_over(&mut self, now_s: f64, view: Option<&LoopStatus>, decision: Option<&Decision>) {
        if self.emergency_stop_is_awaited(false) {
            self.paths.postpone(now_s);
            return;
        }
        let tolerances = &self.config.tolerances;
        let driving = view.is_some_and(|view| view.row.state == SafetyState::Driving);
        let here = decision.and_then(|decision| {
            let estimate = decision.estimate.as_ref()?;
            let age_s = now_s - estimate.time_s + estimate.pose_age_s;
            (..=tolerances.transform_s)
                .contains(&age_s)
                .then_some(Whereabouts {
                    pose: estimate.pose,
                    speed_m_s: if driving {
                        decision.command_effective.traction_m_s.abs()
                    } else {
                        0.0
                    },
                })
        });
        let transforms = self.shared.transforms();
        let done = self.paths.step(now_s, here, &transforms, tolerances);
        drop(transforms);
        let state = view.map_or(SafetyState::Disarmed, |view| view.row.state);
        match done {
            None => {}
            Some(Err(outcome)) => self.fail(StopCause::PathRefused, outcome, now_s),
            Some(Ok(Prepared::AtGoal(goal))) => {
                self.paths.set_aside();
                self.transform = None;
                let effects = self.executive.arrived(now_s, state, goal);
                self.carry_out(effects, now_s);
            }
            Some(Ok(Prepared::Path(handover))) => {
                self.transform = None;
                self.dispatcher.set_path(Some(PathCommand {
                    number: self.next_number,
                    trajectory: handover.trajectory,
                    from_m: 0.0,
                }));
                let start_rad = handover.start_rad;
                let behind = here.is_some_and(|here| {
                    wrap_angle(here.pose.yaw_rad - start_rad).abs() > FRAC_PI_2
                });
                let turn_to_rad = behind.then_some(start_rad);
                let effects = self
                    .executive
                    .ready(now_s, state, handover.goal, turn_to_rad);
                self.carry_out(effects, now_s);
            }
        }
    }

    /// Keeps the path in its frame.
    fn look_at_frame(&mut self, now_s: f64, decision: Option<&Decision>) {
        let driven = self.executive.driven();
        if driven.is_none() || now_s - self.framed_s < FRAME_S {
            return;
        }
        self.framed_s = now_s;
        let Some(estimate) = decision.and_then(|decision| decision.estimate) else {
            return;
        };
        let tolerance_s = self.config.tolerances.transform_s;
        let transforms = self.shared.transforms();
        let found = self
            .paths
            .follow_frame(now_s, &estimate.pose, &transforms, tolerance_s);
        drop(transforms);
        match found {
            Err(why) => self.transform = Some(why),
            Ok(handover) => {
                self.transform = None;
                if let Some(handover) = handover {
                    self.executive.move_goal(handover.goal);
                    self.replace(handover);
                }
            }
        }
    }

    fn feed_back(&mut self, now_s: f64, decision: Option<&Decision>) {
        let Some(Client::Goal(id)) = self.executive.client() else {
            return;
        };
        let (Some(number), Some(length_m)) = (self.executive.driven(), self.paths.length_m())
        else {
            return;
        };
        let executing = self.goals.status(&id) == Some(GoalStatusEnum::Executing);
        let own = decision.filter(|decision| decision.reference == number);
        if let Some(decision) = own
            && let Some(progress) = decision.progress
            && executing
            && now_s - self.fed_back_s >= FEEDBACK_S
        {
            self.fed_back_s = now_s;
            let feedback = FollowPathFeedback {
                distance_to_goal: (length_m - progress.arc_length_m).max(0.0) as f32,
                speed: decision.command_effective.traction_m_s as f32,
            };
            self.action.feed_back(id, feedback);
        }
    }

    pub(super) fn carry_out(&mut self, effects: Vec<Effect>, now_s: f64) {
        for effect in effects {
            match effect {
                Effect::Arm(number) => self.dispatcher.arm(number),
                Effect::Stop(cause) => self.dispatcher.stop(cause),
                Effect::Turn {
                    number,
                    from,
                    angle_rad,
                } => {
                    self.paths.set_aside();
                    self.transform = None;
                    match self.paths.turn(&from, angle_rad) {
                        Ok(trajectory) => {
                            self.dispatcher.set_path(Some(PathCommand {
                                number,
                                trajectory,
                                from_m: 0.0,
                            }));
                        }
                        Err(outcome) => self.fail(StopCause::PathRefused, outcome, now_s),
                    }
                }
                Effect::Prepare(number) => {
                    self.next_number = number;
                    self.paths.prepare_again(now_s);
                }
                Effect::Clear => {
                    self.paths.forget(true);
                    self.transform = None;
                    self.dispatcher.set_path(None);
                }
                Effect::Told(Client::Topic, end, outcome) => {
                    self.log_end(end, &outcome);
                    self.last_end = Some((end, outcome.message));
                }
                Effect::Told(Client::Goal(id), end, outcome) => {
                    self.log_end(end, &outcome);
                    self.last_end = Some((end, outcome.message.clone()));
                    for answer in self.goals.end(&id, now_s, end, outcome) {
                        self.action.answer_result(answer);
                    }
                    self.statuses_changed = true;
                }
            }
        }
    }
}
