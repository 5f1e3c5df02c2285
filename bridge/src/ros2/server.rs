//! The controller server on the ROS 2 graph: one thread that answers everything but the cycle.

mod jobs;

use super::arguments::{RosArguments, RosEnvironment};
use super::config::Ros2Config;
use super::convert::TwistMapping;
use super::executive::{Client, Executive, Turns};
use super::follow_path::{FollowPathEndpoints, endpoints};
use super::goals::{GoalEnd, Goals, Outcome};
use super::inputs::{Common, Ears, ListenError, Shared};
use super::lifecycle::Lifecycle;
use super::message::action::code;
use super::message::{Path, SpeedLimit};
use super::node::RosNode;
use super::parameters::Parameters;
use super::paths::Paths;
use super::peers::{Participant, Peers};
use super::port::Ros2Port;
use super::qos;
use super::route::RouteSettings;
use super::services::Services;
use super::telemetry::{Account, Telemetry};
use super::time::RosTime;
use super::worker::Worker;
use crate::control_loop::channel::{
    CommandClient, ControllerEnd, LoopEnd, LoopStatus, command_channel,
};
use crate::drives::{Epoch, ExternalClock};
use crate::safety::StopCause;
use ros2_client::action::GoalId;
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::dds::rustdds::{
    DomainParticipantStatusEvent as Event, DomainParticipantStatusListener, StatusEvented,
};
use ros2_client::log::LogLevel;
use ros2_client::{NodeLoggingHandle, RosoutRaw, Subscription};
use sidehill_plant::vehicle::Vehicle;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// Time between two looks where nothing comes, s.
const TICK_S: f64 = 0.02;
/// Time between two feedbacks, s.
const FEEDBACK_S: f64 = 0.05;
/// Time between two looks at the path's frame, s.
const FRAME_S: f64 = 0.1;
/// A step of the world's clock that is a jump, s.
const WORLD_JUMP_S: f64 = 0.5;

/// What a server is made of.
pub struct Setup<'a> {
    /// The `ros2:` section.
    pub config: Ros2Config,
    /// Vehicle that the controller steers by.
    pub vehicle: &'a Vehicle,
    /// How paths are made into what is followed.
    pub route: RouteSettings,
    /// What stood after `--ros-args`.
    pub arguments: &'a RosArguments,
    /// What the environment says.
    pub environment: &'a RosEnvironment,
    /// Where the cycle's time begins.
    pub epoch: Epoch,
    /// Whether the drives are told over ROS 2.
    pub drives: bool,
    /// Stages of the controller's horizon.
    pub stages: usize,
    /// Period of the cycle, s.
    pub period_s: f64,
}

/// A server, and the ends of it that belong to the cycle. Dropped, it leaves the graph.
pub struct Ros2 {
    /// The time of the cycle.
    pub time: RosTime,
    /// For the cycle.
    pub cycle: LoopEnd,
    /// For the controller.
    pub pilot: ControllerEnd,
    /// The vehicle, where the drives are told over ROS 2.
    pub port: Option<Ros2Port>,
    /// Kept for its threads.
    pub server: Ros2Server,
}

/// The threads of a server; dropped, it leaves the graph.
pub struct Ros2Server {
    _server: Worker,
    _listener: Option<Worker>,
}

/// Starts a server.
///
/// # Errors
/// [`ListenError`] for a setting out of range, a name that is not allowed or a network that cannot be
/// used.
pub fn start(setup: Setup<'_>) -> Result<Ros2, ListenError> {
    setup.config.validate()?;
    let config = setup.config;
    let mut node = RosNode::start(&config.node, setup.arguments, setup.environment)?;
    let time = if config.use_sim_time {
        RosTime::told(ExternalClock::default())
    } else {
        RosTime::of_world(setup.epoch)
    };
    let mapping = TwistMapping::new(config.commands.track_width_m, setup.vehicle)?;
    let (dispatcher, cycle, pilot) = command_channel(setup.stages);
    let common = Common {
        frames: config.frames.clone(),
        mapping,
        time: time.clone(),
        shared: Arc::new(Shared::default()),
    };
    let ears = Ears {
        config: config.inputs.clone(),
        common: common.clone(),
        brake: dispatcher.halt_switch(),
        drives: setup.drives,
    };
    let (listener, heard) = ears.listen(&mut node)?;
    let (port, listener) = if setup.drives {
        let correction = setup.vehicle.encoder_scale;
        let (commands, common) = (&config.commands, common.clone());
        let port = Ros2Port::new(&mut node, commands, correction, common, (listener, heard))?;
        (Some(port), None)
    } else {
        (None, Some(listener))
    };
    let parameters = Parameters::new(&config, setup.period_s, setup.route.limits.speed_max_m_s);
    let services = (parameters, Lifecycle::new(config.autostart));
    let paths = Paths::new(setup.route, &config.frames.odometry);
    let server = Server::new(
        node,
        config,
        paths,
        setup.vehicle,
        services,
        dispatcher,
        common,
    )?;
    Ok(Ros2 {
        time,
        cycle,
        pilot,
        port,
        server: Ros2Server {
            _server: server.work()?,
            _listener: listener,
        },
    })
}

struct Server {
    config: Ros2Config,
    time: RosTime,
    shared: Arc<Shared>,
    dispatcher: CommandClient,
    action: Box<dyn FollowPathEndpoints>,
    path: Option<Subscription<Path>>,
    speed_limit: Subscription<SpeedLimit>,
    status: DomainParticipantStatusListener,
    services: Services,
    telemetry: Telemetry,
    peers: Peers,
    /// Goals accepted, and how the last one ended.
    accepted: u64,
    last_end: Option<(GoalEnd, String)>,
    goals: Goals,
    executive: Executive,
    paths: Paths,
    /// Number under which the path that is being prepared is given on.
    next_number: u64,
    /// Who sent the goal in hand, and whether it has left.
    client: Option<(Participant, bool)>,
    /// Why the path's frame is not known.
    transform: Option<String>,
    clock_jumps: u64,
    statuses_changed: bool,
    fed_back_s: f64,
    framed_s: f64,
    /// Topics as DDS names them.
    emergency_stop_topic: String,
    result_topic: String,
    logger: NodeLoggingHandle,
    poll: Poll,
    // After all that it has made.
    node: RosNode,
}

impl Server {
    fn new(
        mut node: RosNode,
        config: Ros2Config,
        paths: Paths,
        vehicle: &Vehicle,
        (parameters, lifecycle): (Parameters, Lifecycle),
        dispatcher: CommandClient,
        common: Common,
    ) -> Result<Self, ListenError> {
        let poll = Poll::new()?;
        let (registry, token) = (poll.registry(), Token(0));
        let mut action = endpoints(&mut node, &config.follow_path)?;
        action.register(registry, token)?;
        let mut path = match config.inputs.path.as_str() {
            "" => None,
            topic => Some(node.subscription::<Path>(topic, &qos::LATCHED)?),
        };
        if let Some(path) = &mut path {
            registry.register(path, token, Interest::READABLE)?;
        }
        let mut speed_limit = node.subscription(&config.inputs.speed_limit, &qos::RELIABLE_10)?;
        registry.register(&mut speed_limit, token, Interest::READABLE)?;
        let mut status = node.context().domain_participant().status_listener();
        registry.register(&mut status, token, Interest::READABLE)?;
        let poll_of = (registry, token);
        let services = Services::new(&mut node, poll_of, parameters, lifecycle)?;
        let logger = node.inner().logging_handle();
        let telemetry = Telemetry::new(&mut node, vehicle, &config.frames.odometry)?;
        let whole = |name: &str| {
            let name = node.names().resolve(name);
            name.map_err(super::node::NodeError::from)
        };
        let action_name = whole(&config.follow_path.action)?;
        let emergency_stop_topic = format!("rt{}", whole(&config.inputs.emergency_stop)?);
        Ok(Self {
            paths,
            time: common.time,
            shared: common.shared,
            dispatcher,
            action,
            path,
            speed_limit,
            status,
            services,
            telemetry,
            logger,
            peers: Peers::default(),
            accepted: 0,
            last_end: None,
            goals: Goals::default(),
            executive: Executive::new(Turns {
                at_start: config.follow_path.turn_at_start,
                at_goal: config.follow_path.turn_at_goal,
            }),
            next_number: 0,
            client: None,
            transform: None,
            clock_jumps: 0,
            statuses_changed: true,
            fed_back_s: f64::NEG_INFINITY,
            framed_s: f64::NEG_INFINITY,
            config,
            emergency_stop_topic,
            result_topic: format!("rr{action_name}/_action/get_resultReply"),
            poll,
            node,
        })
    }

    fn work(mut self) -> std::io::Result<Worker> {
        Worker::start("ros2 server", move |end| {
            let mut events = Events::with_capacity(64);
            while !end.load(Ordering::Relaxed) {
                let tick = Duration::from_secs_f64(TICK_S);
                if self.poll.poll(&mut events, Some(tick)).is_err() {
                    std::thread::sleep(Duration::from_millis(1));
                }
                self.turn();
            }
        })
    }

    /// Answers what has come, and looks after the path in hand.
    fn turn(&mut self) {
        let now_s = self.time.now_s();
        self.meet_peers();
        let jumped = self.clock_has_jumped();
        while let Some(goal) = self.action.next_goal(&self.peers) {
            self.take_goal(goal, now_s);
        }
        while let Some((request, asked)) = self.action.next_cancel(&self.peers) {
            let answer = self.goals.cancel(&asked);
            let canceled: Vec<GoalId> = answer.goals_canceling.iter().map(|g| g.goal_id).collect();
            self.statuses_changed |= !canceled.is_empty();
            self.action.answer_cancel(request, answer);
            for id in canceled {
                if self.executive.client() == Some(Client::Goal(id)) {
                    self.paths.forget(false);
                    let cause = StopCause::Cancelled;
                    let outcome = Outcome::new(code::NONE, cause.to_string());
                    let ending = (cause, outcome);
                    let effects = self.executive.end(now_s, GoalEnd::Canceled, ending);
                    self.carry_out(effects, now_s);
                }
            }
        }
        while let Some((request, id)) = self.action.next_result_request(&self.peers) {
            if let Some(answer) = self.goals.result(&id, request) {
                self.action.answer_result(answer);
            }
        }
        self.serve(now_s);
        self.take_path_topic(now_s);
        self.take_speed_limit();
        self.look_after(now_s, jumped);
        self.goals.forget_old(now_s);
        if self.statuses_changed {
            self.statuses_changed = false;
            self.action.publish_statuses(self.goals.statuses());
        }
    }

    /// Answers the services of parameters and lifecycle.
    fn serve(&mut self, now_s: f64) {
        let changes = self.services.answer(&mut self.node, &self.peers);
        if changes.parameters {
            let parameters = &self.services.parameters;
            self.config.tolerances = parameters.tolerances();
            self.shared.set_thresholds(parameters.thresholds());
            if let Some(handover) = self.paths.want_speed(parameters.speed_m_s()) {
                self.replace(handover);
            }
        }
        if changes.state && !self.services.lifecycle.is_active() {
            let cause = StopCause::Deactivated;
            self.fail(cause, Outcome::new(code::UNKNOWN, cause.to_string()), now_s);
        }
    }

    /// Says it on /rosout.
    fn log(&self, level: LogLevel, message: &str) {
        let now = Time::from_nanos(self.time.stamp_ns(self.time.now_s()));
        let name = self.logger.base_name();
        self.logger
            .rosout_raw(now, level, name, message, file!(), "", line!());
    }

    fn log_end(&self, end: GoalEnd, outcome: &Outcome) {
        match end {
            GoalEnd::Succeeded => self.log(LogLevel::Info, "the goal is reached"),
            GoalEnd::Canceled => self.log(LogLevel::Info, "the path was taken back"),
            GoalEnd::Aborted => {
                let message = format!(
                    "the path is given up ({}): {}",
                    outcome.code, outcome.message
                );
                self.log(LogLevel::Warn, &message);
            }
        }
    }

    fn tell(&mut self, now_s: f64, view: Option<&LoopStatus>) {
        let state = self.services.lifecycle.state();
        let last_refusal = self.shared.last_refusal().clone();
        let account = Account {
            lifecycle: &state.label,
            refused: self.shared.refused.load(Ordering::Relaxed),
            last_refusal: &last_refusal,
            emergency_stop: self.shared.emergency_stop.get(),
            goals: self.accepted,
            last_end: self
                .last_end
                .as_ref()
                .map(|(end, why)| (*end, why.as_str())),
        };
        let pilot = self.dispatcher.controller_status();
        self.telemetry
            .tell(now_s, &self.time, view, pilot, &account);
    }

    fn meet_peers(&mut self) {
        while let Some(event) = self.status.try_recv_status() {
            match &event {
                Event::WriterDetected { writer }
                    if writer.topic_name == self.emergency_stop_topic =>
                {
                    self.shared
                        .words()
                        .expect(writer.guid.into(), Instant::now());
                }
                Event::WriterLost { guid, .. } => self.shared.words().leave((*guid).into()),
                Event::ParticipantLost { id, .. } => {
                    let mut participant = [0; 16];
                    participant[..12].copy_from_slice(id.as_ref());
                    self.shared.words().leave(participant.into());
                }
                _ => {}
            }
            let Some((left, topic)) = self.peers.take(event) else {
                continue;
            };
            let its_client = topic.is_none_or(|topic| topic == self.result_topic);
            if let Some((client, gone)) = &mut self.client {
                *gone |= its_client && *client == left;
            }
        }
    }

    /// Looks for a jump of the clock, simulated or the world's.
    fn clock_has_jumped(&mut self) -> bool {
        let jumps = self.shared.clock_jumps.load(Ordering::Relaxed);
        let mut jumped = jumps != self.clock_jumps;
        self.clock_jumps = jumps;
        if self.time.world_set_by_s().abs() > WORLD_JUMP_S {
            self.time.follow_world();
            self.shared.transforms().forget();
            jumped = true;
        }
        if jumped {
            (self.fed_back_s, self.framed_s) = (f64::NEG_INFINITY, f64::NEG_INFINITY);
        }
        jumped
    }
}
