//! The controller server on the ROS 2 graph: one thread that answers everything but the cycle.

use super::arguments::{RosArguments, RosEnvironment};
use super::config::Ros2Config;
use super::convert::TwistMapping;
use super::executive::{Client, Effect, Executive, Seen};
use super::follow_path::{FollowPathEndpoints, NewGoal, endpoints};
use super::goals::{GoalEnd, Goals, Outcome};
use super::inputs::{Common, Ears, ListenError, Shared, drain};
use super::lifecycle::Lifecycle;
use super::message::action::{FollowPathFeedback, code};
use super::message::{Path, SpeedLimit};
use super::node::RosNode;
use super::parameters::Parameters;
use super::paths::{Handover, Paths, Whereabouts};
use super::peers::{Participant, Peers, participant};
use super::port::Ros2Port;
use super::qos;
use super::route::{Plan, RouteSettings};
use super::services::Services;
use super::telemetry::{Account, Telemetry};
use super::time::RosTime;
use super::worker::Worker;
use crate::clock::{Epoch, ToldClock};
use crate::mission::{Assignment, CycleDesk, CycleView, Dispatcher, PilotDesk, desks};
use crate::safety::State;
use ros2_client::action::{GoalId, GoalStatusEnum};
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::{Events, Interest, Poll, Token};
use ros2_client::dds::rustdds::{
    DomainParticipantStatusEvent as Event, DomainParticipantStatusListener, StatusEvented,
};
use ros2_client::log::LogLevel;
use ros2_client::{NodeLoggingHandle, RosoutRaw, Subscription};
use sidehill_controller::controller::Decision;
use sidehill_controller::trajectory::Trajectory;
use sidehill_plant::frames::PlanarPose;
use sidehill_plant::vehicle::Vehicle;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::Duration;

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
    pub cycle: CycleDesk,
    /// For the controller.
    pub pilot: PilotDesk,
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
        RosTime::told(ToldClock::default())
    } else {
        RosTime::of_world(setup.epoch)
    };
    let mapping = TwistMapping::new(config.commands.track_width_m, setup.vehicle)?;
    let (dispatcher, cycle, pilot) = desks(setup.stages);
    let common = Common {
        frames: config.frames.clone(),
        mapping,
        time: time.clone(),
        shared: Arc::new(Shared::default()),
    };
    let ears = Ears {
        config: config.inputs.clone(),
        common: common.clone(),
        brake: dispatcher.brake(),
        drives: setup.drives,
    };
    let (listener, heard) = ears.listen(&mut node)?;
    let (port, listener) = if setup.drives {
        let correction = setup.vehicle.correction;
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
    dispatcher: Dispatcher,
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
        dispatcher: Dispatcher,
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
        let action_name = node.names().resolve(&config.follow_path.action);
        let action_name = action_name.map_err(super::node::NodeError::from)?;
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
            executive: Executive::new(config.follow_path.turn_at_goal),
            next_number: 0,
            client: None,
            transform: None,
            clock_jumps: 0,
            statuses_changed: true,
            fed_back_s: f64::NEG_INFINITY,
            framed_s: f64::NEG_INFINITY,
            config,
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
                    let outcome = Outcome::new(code::NONE, "cancelled");
                    let effects = self.executive.end(now_s, GoalEnd::Canceled, outcome);
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
            self.fail(
                Outcome::new(code::UNKNOWN, "the node was deactivated"),
                now_s,
            );
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

    fn tell(&mut self, now_s: f64, view: Option<&CycleView>) {
        let state = self.services.lifecycle.state();
        let last_refusal = self.shared.last_refusal().clone();
        let account = Account {
            lifecycle: &state.label,
            refused: self.shared.refused.load(Ordering::Relaxed),
            last_refusal: &last_refusal,
            emergency_stop: self.shared.emergency_stop.load(Ordering::Relaxed),
            goals: self.accepted,
            last_end: self
                .last_end
                .as_ref()
                .map(|(end, why)| (*end, why.as_str())),
        };
        let pilot = self.dispatcher.pilot();
        self.telemetry
            .tell(now_s, &self.time, view, pilot, &account);
    }

    fn meet_peers(&mut self) {
        while let Some(event) = self.status.try_recv_status() {
            match &event {
                Event::WriterLost { guid, .. } => self.shared.writer_left((*guid).into()),
                Event::ParticipantLost { id, .. } => {
                    let mut participant = [0; 16];
                    participant[..12].copy_from_slice(id.as_ref());
                    self.shared.writer_left(participant.into());
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

    fn take_goal(&mut self, goal: NewGoal, now_s: f64) {
        let stamp = Time::from_nanos(self.time.stamp_ns(now_s));
        let pressed = self.shared.emergency_stop.load(Ordering::Relaxed);
        let ready = self.services.lifecycle.is_active() && !pressed;
        let accepted = ready && self.goals.accept(goal.id, stamp);
        self.action.answer_goal(goal.request, accepted, stamp);
        if !accepted {
            let why = if pressed {
                "a goal is refused: the emergency stop is pressed"
            } else {
                "a goal is refused: the node is not active, or the goal is not new"
            };
            self.log(LogLevel::Warn, why);
            return;
        }
        let count = goal.path.poses.len();
        self.log(
            LogLevel::Info,
            &format!("a goal of {count} poses is accepted"),
        );
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

    fn take_path_topic(&mut self, now_s: f64) {
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
            Err(outcome) => self.fail(outcome, now_s),
        }
    }

    fn fail(&mut self, outcome: Outcome, now_s: f64) {
        self.paths.forget(false);
        let effects = self.executive.end(now_s, GoalEnd::Aborted, outcome);
        self.carry_out(effects, now_s);
    }

    fn take_speed_limit(&mut self) {
        let mut newest = None;
        drain(&self.speed_limit, |message| newest = Some(message));
        if let Some(limit) = newest
            && let Some(handover) = self.paths.limit(&limit)
        {
            self.replace(handover);
        }
    }

    /// Gives the controller the path it has, changed, where it has come to on it.
    fn replace(&mut self, handover: Handover) {
        let Some(before) = self.executive.driven() else {
            return;
        };
        let decision = self.dispatcher.pilot().decision;
        let progress = decision
            .filter(|decision| decision.reference == before)
            .and_then(|decision| decision.progress);
        if let Some(progress) = progress
            && let Some(number) = self.executive.renumber()
        {
            self.dispatcher.assign(Assignment {
                number,
                trajectory: handover.trajectory,
                from_m: progress.arc_length_m,
            });
        }
    }

    fn look_after(&mut self, now_s: f64, clock_jumped: bool) {
        let view = self.dispatcher.cycle();
        let decision = self.dispatcher.pilot().decision;
        self.hand_over(now_s, view.as_ref(), decision.as_ref());
        self.look_at_frame(now_s, decision.as_ref());
        let state = view.map_or(State::Disarmed, |view| view.row.state);
        let effects = self.executive.step(
            &Seen {
                now_s,
                cycle_s: view.map_or(f64::NEG_INFINITY, |view| view.row.time_s),
                state,
                armed: view.map_or(0, |view| view.armed),
                stopped_by: view.and_then(|view| view.stopped_by),
                decision: decision.as_ref(),
                transform: self.transform.as_deref(),
                emergency_stop: self.shared.emergency_stop.load(Ordering::Relaxed),
                clock_jumped,
                client_lost: self.client.is_some_and(|(_, left)| left),
            },
            &self.config.tolerances,
        );
        self.carry_out(effects, now_s);
        self.feed_back(now_s, decision.as_ref());
        self.tell(now_s, view.as_ref());
    }

    /// Goes on with a path that is being prepared.
    fn hand_over(&mut self, now_s: f64, view: Option<&CycleView>, decision: Option<&Decision>) {
        let tolerances = &self.config.tolerances;
        let driving = view.is_some_and(|view| view.row.state == State::Driving);
        let here = decision.and_then(|decision| {
            let estimate = decision.estimate.as_ref()?;
            let age_s = now_s - estimate.time_s + estimate.pose_age_s;
            (..=tolerances.transform_s)
                .contains(&age_s)
                .then_some(Whereabouts {
                    pose: estimate.pose,
                    speed_m_s: if driving {
                        decision.command.traction_m_s.abs()
                    } else {
                        0.0
                    },
                })
        });
        let (tolerance_s, patience_s) = (tolerances.transform_s, tolerances.failure_s);
        let transforms = self.shared.transforms();
        let done = self
            .paths
            .step(now_s, here, &transforms, tolerance_s, patience_s);
        drop(transforms);
        match done {
            None => {}
            Some(Err(outcome)) => self.fail(outcome, now_s),
            Some(Ok(handover)) => {
                self.transform = None;
                self.dispatcher.assign(Assignment {
                    number: self.next_number,
                    trajectory: handover.trajectory,
                    from_m: 0.0,
                });
                let state = view.map_or(State::Disarmed, |view| view.row.state);
                let effects = self.executive.ready(now_s, state, handover.goal);
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
                speed: decision.command.traction_m_s as f32,
            };
            self.action.feed_back(id, feedback);
        }
    }

    fn carry_out(&mut self, effects: Vec<Effect>, now_s: f64) {
        for effect in effects {
            match effect {
                Effect::Arm(number) => self.dispatcher.arm(number),
                Effect::Stop(on) => self.dispatcher.stop(on),
                Effect::Turn {
                    number,
                    from,
                    angle_rad,
                } => {
                    self.paths.forget(true);
                    self.transform = None;
                    match self.paths.turn(&from, angle_rad) {
                        Ok(trajectory) => {
                            self.dispatcher.assign(Assignment {
                                number,
                                trajectory,
                                from_m: 0.0,
                            });
                        }
                        Err(outcome) => self.fail(outcome, now_s),
                    }
                }
                Effect::Clear => {
                    self.paths.forget(true);
                    self.transform = None;
                    // Number 0 is nobody's.
                    self.dispatcher.assign(Assignment {
                        number: 0,
                        trajectory: Trajectory::standing_at(&PlanarPose::default()),
                        from_m: 0.0,
                    });
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
