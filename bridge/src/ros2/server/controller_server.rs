//! The thread that serves FollowPath, parameters and lifecycle, and publishes telemetry.

use super::config::Ros2Config;
use super::diagnostics::{RecordingState, ServerStatus};
use super::follow_path::{FollowPathRequest, FollowPathServer, action_server};
use super::goal_context::{Client, GoalContext, ObstacleContext, Request};
use super::goal_handler::GoalHandler;
use super::goal_session::PivotSettings;
use super::live_parameters;
use super::obstacles::{CostmapReader, ObstacleSettings, StoppingSettings};
use super::outcome::Outcome;
use super::parameters::ServerParameters;
use super::requested_path::RequestedPath;
use super::route::RouteSettings;
use super::telemetry::Telemetry;
use crate::control_loop::channel::{CommandClient, LoopStatus};
use crate::recording::live::ParameterOwner;
use crate::ros2::node::goals::GoalEnd;
use crate::ros2::node::message::action::FollowPathFeedback;
use crate::ros2::node::message::{Path, SpeedLimit};
use crate::ros2::node::peers::Peers;
use crate::ros2::node::services::NodeServices;
use crate::ros2::node::subscription::take_newest;
use crate::ros2::node::time::RosTime;
use crate::ros2::node::worker::Worker;
use crate::ros2::node::{NodeError, RosNode, qos};
use crate::ros2::port::shared_inputs::SharedInputs;
use crate::safety::{SafetyState, StopCause};
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::dds::rustdds::{
    DomainParticipantStatusEvent as Event, DomainParticipantStatusListener, StatusEvented,
};
use ros2_client::log::LogLevel;
use ros2_client::{NodeLoggingHandle, RosoutRaw, Subscription};
use sidehill_controller::controller::Decision;
use sidehill_plant::vehicle::Vehicle;
use std::sync::atomic::Ordering;
use std::sync::{Arc, OnceLock};
use std::time::{Duration, Instant};

/// Longest wait for an event.
const TICK: Duration = Duration::from_millis(20);
/// Time between two feedback messages, s.
const FEEDBACK_PERIOD_S: f64 = 0.05;
/// A step of the system's clock that is a jump, s.
const CLOCK_JUMP_S: f64 = 0.5;

/// What the server shares with the rest of the program.
pub(crate) struct ServerLinks {
    pub(crate) commands: CommandClient,
    pub(crate) time: RosTime,
    pub(crate) inputs: Arc<SharedInputs>,
    /// Why nothing is recorded any more, once that is so; none where nothing is to be recorded.
    pub(crate) recording: Option<Arc<OnceLock<String>>>,
    /// Where live clients see and set the parameters; none without a live view.
    pub(crate) live: Option<ParameterOwner>,
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
    handler: GoalHandler,
    discovery: DomainParticipantStatusListener,
    peers: Peers,
    accepted_goals: u64,
    /// How the last goal ended, and why.
    last_end: Option<(GoalEnd, String)>,
    /// Jumps of `/clock` that were seen.
    clock_jumps: u64,
    feedback_s: f64,
    /// Topics as DDS names them.
    emergency_stop_topic: String,
    result_topic: String,
    logger: NodeLoggingHandle,
    poll: Poll,
    // Dropped last, after all that it has created.
    node: RosNode,
}

impl ControllerServer {
    /// Creates the server on a node.
    ///
    /// # Errors
    /// [`NodeError`].
    pub(crate) fn new(
        mut node: RosNode,
        config: Ros2Config,
        route: RouteSettings,
        vehicle: &Vehicle,
        (period_s, stopping): (f64, StoppingSettings),
        links: ServerLinks,
    ) -> Result<Self, NodeError> {
        let poll = Poll::new()?;
        let (registry, token) = (poll.registry(), Token(0));
        let action = action_server(&mut node, &config.follow_path, (registry, token))?;
        let mut path = match config.inputs.path.as_str() {
            "" => None,
            topic => Some(node.subscription::<Path>(topic, &qos::LATCHED)?),
        };
        if let Some(path) = &mut path {
            registry.register(path, token, Interest::READABLE)?;
        }
        let mut speed_limit = node.subscription(&config.inputs.speed_limit, &qos::RELIABLE_10)?;
        registry.register(&mut speed_limit, token, Interest::READABLE)?;
        let costmap = match config.costmap.clone() {
            Some(costmap) => {
                let settings = ObstacleSettings::new(costmap, stopping, vehicle);
                Some(CostmapReader::new(&mut node, settings, (registry, token))?)
            }
            None => None,
        };
        let mut discovery = node.context().domain_participant().status_listener();
        registry.register(&mut discovery, token, Interest::READABLE)?;
        let parameters = ServerParameters::new(&config.follow_path);
        let declared = parameters.declare(&config, period_s, route.limits.speed_max_m_s);
        let services = NodeServices::new(&mut node, (registry, token), declared, config.autostart)?;
        if let Some(owner) = &links.live {
            owner.publish(live_parameters::values(&services.parameters));
        }
        let telemetry = Telemetry::new(&mut node, vehicle, &config)?;
        let action_name = node.names().resolve(&config.follow_path.action)?;
        let emergency_stop = node.names().resolve(&config.inputs.emergency_stop)?;
        let pivots = PivotSettings {
            at_start: config.follow_path.turn_at_start,
            at_goal: config.follow_path.turn_at_goal,
        };
        Ok(Self {
            handler: GoalHandler::new(route, pivots, &config.frames.odometry, vehicle),
            emergency_stop_topic: format!("rt{emergency_stop}"),
            result_topic: format!("rr{action_name}/_action/get_resultReply"),
            logger: node.inner().logging_handle(),
            config,
            parameters,
            links,
            action,
            path,
            speed_limit,
            costmap,
            services,
            telemetry,
            discovery,
            peers: Peers::default(),
            accepted_goals: 0,
            last_end: None,
            clock_jumps: 0,
            feedback_s: f64::NEG_INFINITY,
            poll,
            node,
        })
    }

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
        for request in self.handler.take_requests() {
            self.carry_out(request, now_s);
        }
        self.publish_feedback(now_s, decision.as_ref());
        self.publish_telemetry(now_s, status.as_ref());
        self.action.publish_status(now_s);
    }

    fn serve_action(&mut self, now_s: f64) {
        while let Some(goal) = self.action.next_goal(&self.peers) {
            self.take_goal(goal, now_s);
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
            self.handler.begin(Client::Topic, path, now_s);
        }
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
        let client = Client::Goal {
            id: goal.id,
            client: self.peers.client(&goal.request),
        };
        let path = goal
            .check_ids(&self.config.follow_path)
            .and_then(|()| RequestedPath::from_message(&goal.path));
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

    fn step_session(&mut self, now_s: f64, status: Option<&LoopStatus>, clock_jumped: bool) {
        let (estop_unknown, estop_unknown_driving) =
            (self.estop_unknown(false), self.estop_unknown(true));
        let inputs = &self.links.inputs;
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
        self.handler.step(&GoalContext {
            now_s,
            cycle_s: status.map_or(f64::NEG_INFINITY, |status| status.row.time_s),
            state: status.map_or(SafetyState::Disarmed, |status| status.row.state),
            armed: status.map_or(0, |status| status.armed),
            stopped_by: status.and_then(|status| status.stopped_by),
            decision: controller.decision.as_ref(),
            plan: &controller.plan,
            obstacles,
            transforms: &transforms,
            tolerances: &self.config.tolerances,
            emergency_stop: inputs.emergency_stop.get(),
            estop_unknown,
            estop_unknown_driving,
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

    fn carry_out(&mut self, request: Request, now_s: f64) {
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

    fn finish(&mut self, client: Client, end: GoalEnd, outcome: Outcome, now_s: f64) {
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
        if let Client::Goal { id, .. } = client {
            self.action.end(&id, now_s, end, outcome);
        }
    }

    fn publish_feedback(&mut self, now_s: f64, decision: Option<&Decision>) {
        if let Some(id) = self.handler.goal()
            && let Some((distance_m, speed_m_s)) =
                decision.and_then(|decision| self.handler.feedback(decision))
            && self.action.is_executing(&id)
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

    fn publish_telemetry(&mut self, now_s: f64, status: Option<&LoopStatus>) {
        let inputs = &self.links.inputs;
        let lifecycle = self.services.lifecycle.state();
        let last_rejection = inputs.last_rejection();
        let topics = inputs.graph().inputs();
        let controller = self.links.commands.controller_status();
        let tracking = controller
            .decision
            .as_ref()
            .and_then(|decision| self.handler.tracking(decision));
        let server = ServerStatus {
            lifecycle: &lifecycle.label,
            rejected: inputs.rejected(),
            last_rejection: &last_rejection,
            inputs: &topics,
            emergency_stop: inputs.emergency_stop.get(),
            blocked_by: self.handler.blocked_by(),
            tracking,
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
        };
        let time = &self.links.time;
        self.telemetry
            .publish(now_s, time, status, controller, &server);
    }

    /// Takes discovery events: publishers of the emergency stop, readers of replies, and peers that left.
    fn discover_peers(&mut self) {
        while let Some(event) = self.discovery.try_recv_status() {
            let inputs = &self.links.inputs;
            inputs.graph().discovered(&event);
            match &event {
                Event::WriterDetected { writer }
                    if writer.topic_name == self.emergency_stop_topic =>
                {
                    let publisher = writer.guid.into();
                    let mut publishers = inputs.estop_publishers();
                    publishers.publisher_discovered(publisher, Instant::now());
                }
                Event::WriterLost { guid, .. } => {
                    inputs.estop_publishers().publisher_lost((*guid).into());
                }
                Event::ParticipantLost { id, .. } => {
                    let mut participant = [0; 16];
                    participant[..12].copy_from_slice(id.as_ref());
                    inputs.estop_publishers().publisher_lost(participant.into());
                }
                _ => {}
            }
            if let Some(left) = self.peers.take(event) {
                let topic = &self.result_topic;
                self.handler
                    .clients_left(|client| client.has_left(&left, topic));
            }
        }
    }

    /// Returns whether the clock has jumped, that of `/clock` or the system's.
    fn detect_clock_jump(&mut self) -> bool {
        let inputs = &self.links.inputs;
        let jumps = inputs.clock_jumps.load(Ordering::Relaxed);
        let mut jumped = jumps != self.clock_jumps;
        self.clock_jumps = jumps;
        if self.links.time.system_jump_s().abs() > CLOCK_JUMP_S {
            self.links.time.resynchronize();
            inputs.transforms().forget();
            jumped = true;
        }
        if jumped {
            self.feedback_s = f64::NEG_INFINITY;
        }
        jumped
    }

    fn stamp(&self, now_s: f64) -> Time {
        Time::from_nanos(self.links.time.stamp_ns(now_s))
    }

    /// Writes to `/rosout`.
    fn log(&self, level: LogLevel, message: &str) {
        let now = self.stamp(self.links.time.now_s());
        let name = self.logger.base_name();
        self.logger
            .rosout_raw(now, level, name, message, file!(), "", line!());
    }
}
