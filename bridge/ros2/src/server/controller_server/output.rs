//! What the server sends: commands to the control loop, results, feedback, telemetry and log lines.

use super::ControllerServer;
use crate::node::goals::GoalEnd;
use crate::node::message::action::FollowPathFeedback;
use crate::server::diagnostics::{RecordingState, ServerStatus};
use crate::server::goal_context::{PathSource, Request};
use crate::server::outcome::Outcome;
use ros2_client::RosoutRaw;
use ros2_client::builtin_interfaces::Time;
use ros2_client::log::LogLevel;
use sidehill_bridge::control_loop::channel::LoopStatus;
use sidehill_controller::controller::Decision;

/// Time between two feedback messages, s.
const FEEDBACK_PERIOD_S: f64 = 0.05;

impl ControllerServer {
    pub(super) fn carry_out(&mut self, request: Request, now_s: f64) {
        let commands = &mut self.links.commands;
        match request {
            Request::Follow(path) => commands.set_path(path),
            Request::Arm(number) => commands.arm(number),
            Request::Stop(cause) => commands.stop(cause),
            Request::Warn(message) => self.log(LogLevel::Warn, &message),
            Request::Finish {
                client,
                end,
                outcome,
            } => self.finish(client, end, outcome, now_s),
        }
    }

    pub(super) fn finish(
        &mut self,
        client: PathSource,
        end: GoalEnd,
        outcome: Outcome,
        now_s: f64,
    ) {
        match end {
            GoalEnd::Succeeded => self.log(LogLevel::Info, "the goal is reached"),
            GoalEnd::Canceled => self.log(LogLevel::Info, "the goal is cancelled"),
            GoalEnd::Aborted => {
                let Outcome { code, message } = &outcome;
                let message = format!("the goal is aborted ({code}): {message}");
                self.log(LogLevel::Warn, &message);
            }
        }
        self.last_end = Some((end, outcome.message.clone()));
        match client {
            PathSource::Goal { id, .. } => self.action.end(&id, now_s, end, outcome),
            PathSource::Route if end == GoalEnd::Succeeded => self.finish_actions(),
            PathSource::Route | PathSource::None => {}
        }
    }

    pub(super) fn publish_feedback(&mut self, now_s: f64, decision: Option<&Decision>) {
        if let Some(id) = self.handler.goal()
            && let Some((distance_m, speed_m_s)) =
                decision.and_then(|decision| self.handler.feedback(decision))
            && self.action.is_active(&id)
            && now_s - self.feedback_s >= FEEDBACK_PERIOD_S
        {
            self.feedback_s = now_s;
            let feedback = FollowPathFeedback {
                distance_to_goal: distance_m as f32,
                speed: speed_m_s as f32,
            };
            self.action.publish_feedback(id, feedback);
        }
    }

    pub(super) fn publish_telemetry(&mut self, now_s: f64, status: Option<&LoopStatus>) {
        let (node, handler, time) = (&self.node, &self.handler, &self.links.time);
        self.telemetry.look(now_s, || node.subscribed_topics());
        let controller = self.links.commands.controller_status();
        let tracking = |decision: &Decision| handler.tracking(decision);
        self.telemetry.publish(now_s, time, controller, tracking);
        let (Some(status), Some(decision)) = (status, &controller.decision) else {
            return;
        };
        if !self.telemetry.diagnostics_are_due(now_s) {
            return;
        }
        let inputs = &self.links.inputs;
        let server = ServerStatus {
            lifecycle: &self.services.lifecycle.state().label,
            rejected: inputs.rejected(),
            last_rejection: &inputs.last_rejection(),
            inputs: &inputs.graph().inputs(),
            emergency_stop: inputs.emergency_stop.get(),
            blocked_by: handler.blocked_by(),
            tracking: tracking(decision),
            goals: self.accepted_goals,
            last_end: self
                .last_end
                .as_ref()
                .map(|(end, reason)| (*end, reason.as_str())),
            recording: match &self.links.recording {
                None => RecordingState::Off,
                Some(ended) => ended
                    .get()
                    .map_or(RecordingState::On, |reason| RecordingState::Ended(reason)),
            },
            drives: controller.drives,
        };
        self.telemetry
            .publish_diagnostics(now_s, time, (status, decision), &server);
    }

    pub(super) fn stamp(&self, now_s: f64) -> Time {
        Time::from_nanos(self.links.time.stamp_ns(now_s))
    }

    /// Writes to `/rosout`, to the screen and to the log of the run.
    pub(super) fn log(&self, level: LogLevel, message: &str) {
        self.links.inputs.note("goal", message.to_owned());
        let now = self.stamp(self.links.time.now_s());
        let name = self.logger.base_name();
        self.logger
            .rosout_raw(now, level, name, message, file!(), "", line!());
    }
}
