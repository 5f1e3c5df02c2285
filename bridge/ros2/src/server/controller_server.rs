//! The thread that serves FollowPath, parameters and lifecycle, and publishes telemetry.

mod actions;
mod create;
mod output;
mod watch;

use super::action_topic::ActionTopic;
use super::configured_route::ConfiguredRoute;
use super::follow_path::{FollowPathRequest, FollowPathServer};
use super::goal_context::{GoalContext, ObstacleContext, PathSource};
use super::goal_handler::GoalHandler;
use super::live_parameters;
use super::obstacles::CostmapReader;
use super::parameters::ServerParameters;
use super::requested_path::RequestedPath;
use super::telemetry::Telemetry;
use crate::node::RosNode;
use crate::node::goals::GoalEnd;
use crate::node::peers::Peers;
use crate::node::services::NodeServices;
use crate::node::subscription::take_newest;
use crate::node::time::RosTime;
use crate::node::worker::Worker;
use crate::port::shared_inputs::SharedInputs;
use ros2_client::dds::rustdds::DomainParticipantStatusListener;
use ros2_client::dds::rustdds::mio1::{Events, Poll};
use ros2_client::log::LogLevel;
use ros2_client::{NodeLoggingHandle, ServiceMapping, Subscription};
use sidehill_bridge::control_loop::channel::{CommandClient, LoopStatus};
use sidehill_bridge::ros2::message::{Path, SpeedLimit};
use sidehill_bridge::ros2::settings::server::Ros2Config;
use sidehill_bridge::safety::{SafetyState, StopCause};
use sidehill_recording::live::ParameterOwner;
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Longest wait for an event.
const TICK: Duration = Duration::from_millis(20);

/// Time between two views of the obstacles, s.
const OBSTACLES_PERIOD_S: f64 = 1.0;

/// What the server shares with the rest of the program.
pub(crate) struct ServerLinks {
    pub(crate) commands: CommandClient,
    pub(crate) time: RosTime,
    pub(crate) inputs: Arc<SharedInputs>,
    /// Why nothing is recorded any more, once that is so; none where nothing is to be recorded.
    pub(crate) recording: Option<Arc<OnceLock<String>>>,
    /// Where live clients see and set the parameters; none without a live view.
    pub(crate) live: Option<ParameterOwner>,
    /// The route of the configuration.
    pub(crate) configured_route: Option<ConfiguredRoute>,
}

pub(crate) struct ControllerServer {
    config: Ros2Config,
    parameters: ServerParameters,
    links: ServerLinks,
    action: Box<dyn FollowPathServer>,
    path: Option<Subscription<Path>>,
    speed_limit: Subscription<SpeedLimit>,
    costmap: Option<CostmapReader>,
    services: NodeServices,
    telemetry: Telemetry,
    actions: ActionTopic,
    /// Whether the route of the configuration was begun and the vehicle has not driven on it since.
    joins_route: bool,
    /// Whether the vehicle drives, or comes to a halt.
    moves: bool,
    handler: GoalHandler,
    discovery: DomainParticipantStatusListener,
    peers: Peers,
    accepted_goals: u64,
    /// How the last goal ended, and why.
    last_end: Option<(GoalEnd, String)>,
    /// Jumps of `/clock` that were seen.
    clock_jumps: u64,
    /// Whether the last thing that was said of poses is that they are left out.
    poses_left_out: bool,
    feedback_s: f64,
    obstacles_s: f64,
    /// Topics as DDS names them.
    emergency_stop_topic: String,
    result_topic: String,
    logger: NodeLoggingHandle,
    poll: Poll,
    // Dropped last, after all that it has created.
    node: RosNode,
}

impl ControllerServer {
    /// Runs the server in its own thread.
    ///
    /// # Errors
    /// The system's, where no thread can be created.
    pub(crate) fn start(mut self) -> std::io::Result<Worker> {
        Worker::start("ros2 server", move |end| {
            let mut events = Events::with_capacity(64);
            while !end.load(Ordering::Relaxed) {
                if self.poll.poll(&mut events, Some(TICK)).is_err() {
                    // A poll that failed has not waited.
                    std::thread::sleep(Duration::from_millis(1));
                }
                self.step();
            }
        })
    }

    /// Answers what has arrived, takes the session one step on, and publishes.
    fn step(&mut self) {
        let now_s = self.links.time.now_s();
        self.discover_peers();
        let clock_jumped = self.detect_clock_jump();
        self.serve_action(now_s);
        self.serve_node(now_s);
        if let Some(limit) = take_newest(&self.speed_limit) {
            self.handler.limit_speed(limit);
        }
        self.read_costmap();
        let status = self.links.commands.loop_status();
        self.step_session(now_s, status.as_ref(), clock_jumped);
        let decision = self.links.commands.controller_status().decision;
        self.pass_actions(status.as_ref(), decision.as_ref());
        for request in self.handler.take_requests() {
            self.carry_out(request, now_s);
        }
        self.watch_poses(decision.as_ref());
        self.actions.hear(&self.links.inputs);
        self.publish_feedback(now_s, decision.as_ref());
        self.publish_telemetry(now_s, status.as_ref());
        self.action.publish_status(now_s);
    }

    fn serve_action(&mut self, now_s: f64) {
        while let Some(goal) = self.action.next_goal(&self.peers) {
            self.take_goal(goal, now_s);
        }
        if self.action.take_unreadable() {
            let ours = match self.node.service_mapping() {
                ServiceMapping::Cyclone => "rmw_cyclonedds_cpp",
                _ => "rmw_fastrtps_cpp",
            };
            let message = format!(
                "a goal cannot be read: its client has another middleware than RMW_IMPLEMENTATION={ours} of this \
                 program, or another follow_path.definition"
            );
            self.log(LogLevel::Warn, &message);
        }
        while let Some(canceling) = self.action.next_cancel(&self.peers) {
            for id in canceling {
                self.handler.cancel(id, now_s);
            }
        }
        self.action.answer_result_requests(&self.peers);
        let path = self.path.as_ref().and_then(take_newest);
        if let Some(path) = path.filter(|_| self.services.lifecycle.is_active()) {
            let path = RequestedPath::from_message(&path);
            self.handler.begin(PathSource::None, path, now_s);
        }
        self.begin_configured_route(now_s);
    }

    /// Begins the route of the configuration where the operator has asked for it.
    fn begin_configured_route(&mut self, now_s: f64) {
        let Some(route) = &mut self.links.configured_route else {
            return;
        };
        let decision = &self.links.commands.controller_status().decision;
        let located = decision
            .as_ref()
            .is_some_and(|decision| decision.estimate.is_some());
        let at_start = route.at_start && located;
        route.at_start &= !at_start;
        if !route.begin.swap(false, Ordering::Relaxed) && !at_start {
            return;
        }
        if !self.services.lifecycle.is_active() {
            let reason = "the route is not begun: the node is not active";
            return self.log(LogLevel::Warn, reason);
        }
        let path = route.path.clone();
        self.log(LogLevel::Info, "the route of the configuration begins");
        self.joins_route = true;
        self.handler.begin(PathSource::Route, Ok(path), now_s);
    }

    fn take_goal(&mut self, goal: FollowPathRequest, now_s: f64) {
        let active = self.services.lifecycle.is_active();
        let now = self.stamp(now_s);
        if !self.action.respond(goal.request, goal.id, active, now) {
            let reason = match active {
                true => "its id is taken",
                false => "the node is not active",
            };
            self.log(LogLevel::Warn, &format!("a goal is rejected: {reason}"));
            return;
        }
        let count = goal.path.poses.len();
        let waits = match self.estop_unknown(false) {
            true => ", and waits for the first message of the emergency stop",
            false => "",
        };
        let message = format!("a goal of {count} poses is accepted{waits}");
        self.log(LogLevel::Info, &message);
        self.accepted_goals += 1;
        let client = PathSource::Goal {
            id: goal.id,
            client: self.peers.client(&goal.request),
        };
        let path = goal
            .check_ids(&self.config.follow_path)
            .and_then(|()| RequestedPath::from_message(&goal.path));
        if path.as_ref().is_ok_and(|path| !path.speeds_m_s.is_empty()) {
            let message = "the stamps of its poses limit its speed by stretch";
            self.log(LogLevel::Info, message);
        }
        self.handler.begin(client, path, now_s);
    }

    /// Answers the services of parameters and lifecycle.
    fn serve_node(&mut self, now_s: f64) {
        let mut changes = self.services.answer(&mut self.node, &self.peers);
        if let Some(owner) = &self.links.live {
            let (services, node) = (&mut self.services, &mut self.node);
            changes.parameters |= live_parameters::serve(owner, services, node, changes.parameters);
        }
        if changes.parameters {
            let (names, values) = (&self.parameters, &self.services.parameters);
            self.config.tolerances = names.tolerances(values);
            let thresholds = ServerParameters::velocity_thresholds(values);
            self.links.inputs.set_velocity_thresholds(thresholds);
            self.handler.set_desired_speed(names.speed_m_s(values));
        }
        if changes.state && !self.services.lifecycle.is_active() {
            self.handler.abort(StopCause::Deactivated, now_s);
        }
    }

    /// Returns whether recording and live view are to be given the obstacles again.
    fn obstacles_due(&mut self, now_s: f64) -> bool {
        // The clock may have jumped back.
        let due = self.links.recording.is_some()
            && !(0.0..OBSTACLES_PERIOD_S).contains(&(now_s - self.obstacles_s));
        if due {
            self.obstacles_s = now_s;
        }
        due
    }

    fn step_session(&mut self, now_s: f64, status: Option<&LoopStatus>, clock_jumped: bool) {
        let (estop_unknown, estop_unknown_driving) =
            (self.estop_unknown(false), self.estop_unknown(true));
        let show_obstacles = self.obstacles_due(now_s);
        let inputs = &self.links.inputs;
        let estop_incompatible = inputs.unheard_stop(now_s);
        let controller = self.links.commands.controller_status();
        let transforms = inputs.transforms();
        let time = &self.links.time;
        let tolerance_s = self.config.tolerances.transform_s;
        let frames = (
            &*transforms,
            self.config.frames.odometry.as_str(),
            tolerance_s,
        );
        let obstacles = self.costmap.as_ref().map(|costmap| ObstacleContext {
            settings: costmap.settings(),
            seen: costmap.surroundings(now_s, time, frames),
        });
        // While a costmap cannot be used the last obstacles stay to be seen: no way becomes free by that.
        if let Some(ObstacleContext { seen: Ok(seen), .. }) = &obstacles
            && show_obstacles
        {
            inputs.show_obstacles(now_s, seen.obstacles());
        }
        self.handler.step(&GoalContext {
            now_s,
            cycle_s: status.map_or(f64::NEG_INFINITY, |status| status.row.time_s),
            state: status.map_or(SafetyState::Disarmed, |status| status.row.state),
            armed: status.map_or(0, |status| status.armed),
            stopped_by: status.and_then(|status| status.stopped_by),
            decision: controller.decision.as_ref(),
            plan: &controller.view.plan,
            obstacles,
            transforms: &transforms,
            tolerances: &self.config.tolerances,
            emergency_stop: inputs.emergency_stop.get(),
            estop_unknown,
            estop_unknown_driving,
            estop_incompatible: estop_incompatible.as_deref(),
            clock_jumped,
        });
    }

    fn read_costmap(&mut self) {
        let inputs = &self.links.inputs;
        if let Some(costmap) = &mut self.costmap {
            costmap.read(|topic, error| inputs.reject(topic, error));
        }
    }

    fn estop_unknown(&self, driving: bool) -> bool {
        let publishers = self.links.inputs.estop_publishers();
        publishers.awaits_first_message(Instant::now(), driving)
    }
}

#[cfg(test)]
mod tests;
