use super::*;
use crate::node::message::action::{FollowPathFeedback, code};
use crate::server::goal_context::Request;
use crate::server::obstacles::StoppingSettings;
use crate::server::outcome::Outcome;
use crate::server::test_data::{decision, j8, route_settings};
use ros2_client::action::GoalId;
use ros2_client::builtin_interfaces::Time;
use ros2_client::service::RmwRequestId;
use sidehill_bridge::control_loop::channel::{ControllerEnd, LoopEnd, command_channel};
use sidehill_bridge::ros2::arguments::ServiceMapping;
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::message::PoseStamped;
use sidehill_bridge::safety::OperatorRequests;
use std::collections::VecDeque;
use std::sync::Mutex;

/// What clients ask for, and what they are told.
#[derive(Default)]
struct Clients {
    goals: VecDeque<FollowPathRequest>,
    cancels: VecDeque<Vec<GoalId>>,
    accepted: Vec<bool>,
    ends: Vec<(GoalId, GoalEnd, u16, String)>,
}

/// An action server whose clients are in the same process.
#[derive(Clone, Default)]
struct Action(Arc<Mutex<Clients>>);

impl FollowPathServer for Action {
    fn next_goal(&mut self, _: &Peers) -> Option<FollowPathRequest> {
        self.0.lock().unwrap().goals.pop_front()
    }
    fn take_unreadable(&mut self) -> bool {
        false
    }
    fn respond(&mut self, _: RmwRequestId, _: GoalId, accept: bool, _: Time) -> bool {
        self.0.lock().unwrap().accepted.push(accept);
        accept
    }
    fn next_cancel(&mut self, _: &Peers) -> Option<Vec<GoalId>> {
        self.0.lock().unwrap().cancels.pop_front()
    }
    fn answer_result_requests(&mut self, _: &Peers) {}
    fn end(&mut self, id: &GoalId, _: f64, end: GoalEnd, outcome: Outcome) {
        let told = (*id, end, outcome.code, outcome.message);
        self.0.lock().unwrap().ends.push(told);
    }
    fn is_active(&self, _: &GoalId) -> bool {
        true
    }
    fn publish_feedback(&self, _: GoalId, _: FollowPathFeedback) {
        panic!("nothing is driven");
    }
    fn publish_status(&mut self, _: f64) {}
}

/// A server on a node of its own, between clients and a control loop that the test plays.
struct Bench {
    server: ControllerServer,
    action: Action,
    loop_end: LoopEnd,
    _controller_end: ControllerEnd,
    now_s: Arc<Mutex<f64>>,
}

impl Bench {
    fn new(autostart: bool) -> Self {
        let environment = RosEnvironment {
            domain_id: 100 + (std::process::id() % 100) as u16,
            loopback_only: true,
            service_mapping: ServiceMapping::Enhanced,
        };
        let arguments = RosArguments::default();
        let node = RosNode::start("controller_server", &arguments, &environment).unwrap();
        let (commands, loop_end, controller_end) = command_channel(10);
        let now_s = Arc::new(Mutex::new(1.0));
        let clock = Arc::clone(&now_s);
        let config = Ros2Config {
            autostart,
            ..Ros2Config::default()
        };
        let stopping = StoppingSettings {
            deceleration_m_s2: 2.0,
            reaction_s: 0.2,
        };
        let links = ServerLinks {
            commands,
            time: RosTime::simulated(move || *clock.lock().unwrap()),
            inputs: Arc::default(),
            recording: None,
            live: None,
            configured_route: None,
        };
        let (route, settings) = (route_settings(), (0.05, stopping, None));
        let mut server =
            ControllerServer::new(node, config, route, &j8(), settings, links).unwrap();
        let action = Action::default();
        server.action = Box::new(action.clone());
        Self {
            server,
            action,
            loop_end,
            _controller_end: controller_end,
            now_s,
        }
    }

    /// Takes steps for a time.
    fn steps(&mut self, time_s: f64) {
        for _ in 0..(time_s / 0.05).round() as u32 {
            *self.now_s.lock().unwrap() += 0.05;
            self.server.step();
        }
    }

    /// A goal of two poses for a controller, and a step.
    fn goal(&mut self, controller: &str) -> GoalId {
        let mut path = Path::default();
        path.header.frame_id = "map".to_owned();
        path.poses = vec![PoseStamped::default(); 2];
        path.poses[1].pose.position.x = 5.0;
        for pose in &mut path.poses {
            pose.pose.orientation.w = 1.0;
        }
        let id = GoalId::new_random();
        self.clients().goals.push_back(FollowPathRequest {
            request: RmwRequestId::default(),
            id,
            path,
            controller_id: controller.to_owned(),
            goal_checker_id: String::new(),
            progress_checker_id: String::new(),
        });
        self.steps(0.05);
        id
    }

    fn clients(&self) -> std::sync::MutexGuard<'_, Clients> {
        self.action.0.lock().unwrap()
    }

    #[track_caller]
    fn assert_end(&self, id: GoalId, wanted: GoalEnd, code: u16, words: &str) {
        let clients = self.clients();
        let [(goal, end, found, message)] = &clients.ends[..] else {
            panic!("{:?}", clients.ends);
        };
        assert_eq!((*goal, *end, *found), (id, wanted, code), "{message}");
        assert!(message.contains(words), "{message}");
    }
}

#[test]
fn goals_are_accepted_while_the_node_is_active_and_end_when_they_cannot_be_located() {
    let mut bench = Bench::new(true);
    let id = bench.goal("");
    assert_eq!(bench.clients().accepted, [true]);
    assert_eq!(bench.server.handler.goal(), Some(id));
    // Nobody publishes a transform: it waits as long as the tolerance of failures says.
    assert!(bench.clients().ends.is_empty());
    bench.steps(bench.server.config.tolerances.failure_s + 11.5);
    bench.assert_end(id, GoalEnd::Aborted, code::TF_ERROR, "map");
    assert_eq!(bench.server.accepted_goals, 1);
    let (end, reason) = bench.server.last_end.clone().unwrap();
    assert!(
        end == GoalEnd::Aborted && reason.contains("map"),
        "{reason}"
    );
}

#[test]
fn a_node_that_is_not_active_rejects_goals() {
    let mut bench = Bench::new(false);
    bench.goal("");
    assert_eq!(bench.clients().accepted, [false]);
    assert_eq!(
        (bench.server.handler.goal(), bench.server.accepted_goals),
        (None, 0)
    );
}

#[test]
fn an_unknown_controller_is_refused_by_its_name() {
    let mut bench = Bench::new(true);
    let id = bench.goal("Other");
    bench.steps(11.0);
    bench.assert_end(id, GoalEnd::Aborted, code::INVALID_CONTROLLER, "Other");
}

#[test]
fn a_goal_ends_when_it_is_cancelled_and_when_the_clock_jumps() {
    let mut bench = Bench::new(true);
    let id = bench.goal("");
    bench.clients().cancels.push_back(vec![id]);
    bench.steps(11.0);
    bench.assert_end(id, GoalEnd::Canceled, code::NONE, "");
    bench.clients().ends.clear();
    let id = bench.goal("");
    bench
        .server
        .links
        .inputs
        .clock_jumps
        .fetch_add(1, Ordering::Relaxed);
    bench.steps(11.0);
    bench.assert_end(id, GoalEnd::Aborted, code::TF_ERROR, "jump");
}

#[test]
fn requests_of_a_session_reach_the_control_loop() {
    const IDLE: OperatorRequests = OperatorRequests {
        arm: false,
        stop: None,
        halt: None,
    };
    let mut bench = Bench::new(true);
    bench.server.carry_out(Request::Arm(1), 1.0);
    assert!(bench.loop_end.merge(IDLE, SafetyState::Disarmed).arm);
    let stop = Request::Stop(Some(StopCause::Obstacle));
    bench.server.carry_out(stop, 1.0);
    let merged = bench.loop_end.merge(IDLE, SafetyState::Driving);
    assert_eq!(
        (merged.stop, merged.arm),
        (Some(StopCause::Obstacle), false)
    );
    bench.server.carry_out(Request::Stop(None), 1.0);
    assert_eq!(bench.loop_end.merge(IDLE, SafetyState::Driving).stop, None);
}

#[test]
fn poses_that_are_left_out_are_said_once_and_once_more_when_they_are_used_again() {
    let mut bench = Bench::new(true);
    let mut said = |gated: u32| {
        let mut decision = decision(1.0, 0.0, 0.0);
        decision.estimate.as_mut().unwrap().poses_gated = gated;
        bench.server.watch_poses(Some(&decision));
        let notes = bench.server.links.inputs.take_notes();
        notes
            .iter()
            .map(|note| note.message.clone())
            .collect::<String>()
    };
    for gated in [0, 1, 2] {
        assert_eq!(said(gated), "");
    }
    assert!(said(3).contains("left out"));
    assert_eq!(said(4), "");
    assert_eq!(said(0), "poses are used again");
    assert_eq!(said(0), "");
}
