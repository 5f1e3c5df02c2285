//! Action clients in the mapping of Fast DDS, against a controller and a virtual rover in processes
//! of their own.

use crate::configured::configuration;
use crate::running::Running;
use crate::{repository, sidehill};
use ros2_client::action::{
    ActionClientQosPolicies, CancelGoalResponse, GoalId, GoalStatusEnum, SendGoalResponse,
};
use ros2_client::action_msgs::CancelGoalResponseEnum;
use ros2_client::dds::rustdds::{DomainParticipantStatusEvent, GUID, StatusEvented};
use ros2_client::{ActionClient, ActionTypeName, Message, Name, ServiceMapping};
use sidehill_bridge::ros2::arguments::{self, RosArguments, RosEnvironment};
use sidehill_bridge::ros2::conversions::to_pose;
use sidehill_bridge::ros2::convert::world_from_base_link;
use sidehill_bridge::ros2::message::{Path, PoseStamped};
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_ros2::node::RosNode;
use sidehill_ros2::node::message::action::{
    FollowPathFeedback, FollowPathGoal, FollowPathGoalHumble, FollowPathResult,
    FollowPathResultHumble, FollowPathResultIron, code,
};
use sidehill_ros2::node::qos;
use std::collections::BTreeSet;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

/// Longest wait for an answer on a busy machine: a limit for liveness, not a measurement.
const PATIENCE: Duration = Duration::from_secs(60);

/// A separate domain for each test, so that parallel tests do not interfere.
fn domain_id() -> u16 {
    static TESTS: AtomicU32 = AtomicU32::new(0);
    let test = TESTS.fetch_add(1, Ordering::Relaxed);
    1 + ((7 * std::process::id() + test) % 200) as u16
}

/// Returns a subcommand in a domain, configured for Fast DDS.
fn command(subcommand: &str, config: &std::path::Path, domain_id: u16) -> Command {
    let mut command = sidehill();
    command
        .arg(subcommand)
        .arg(config)
        .env("ROS_DOMAIN_ID", domain_id.to_string())
        .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
        .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        .stdout(Stdio::null())
        .stderr(Stdio::null());
    command
}

/// Starts a subcommand with a file of `config/bridge/`.
fn start(subcommand: &str, name: &str, domain_id: u16) -> Running {
    let config = repository("config/bridge").join(name);
    Running::start(&mut command(subcommand, &config, domain_id))
}

/// A client of the action, by the types of one definition.
struct Client<G: Message + Clone, R: Message + Clone> {
    action: ActionClient<G, R, FollowPathFeedback>,
    _node: RosNode,
}

impl<G: Message + Clone + 'static, R: Message + Clone + 'static> Client<G, R> {
    /// Returns a client that has found the server.
    fn find(domain_id: u16) -> Self {
        let environment = RosEnvironment {
            domain_id,
            service_mapping: arguments::ServiceMapping::Enhanced,
            loopback_only: true,
        };
        let mut node = RosNode::start("client", &RosArguments::default(), &environment).unwrap();
        let status = node.context().domain_participant().status_listener();
        let action = node
            .inner()
            .create_action_client(
                ServiceMapping::Enhanced,
                &Name::new("/", "follow_path").unwrap(),
                &ActionTypeName::new("nav2_msgs", "FollowPath"),
                ActionClientQosPolicies {
                    goal_service: qos::SERVICE,
                    result_service: qos::SERVICE,
                    cancel_service: qos::SERVICE,
                    feedback_subscription: qos::RELIABLE_10,
                    status_subscription: qos::LATCHED,
                },
            )
            .unwrap();
        // Three services with a writer and a reader each, feedback and status. A request that is
        // written before its reader is known is lost.
        let (mut writers, mut readers) = (BTreeSet::new(), BTreeSet::new());
        // The events include the middleware's own endpoints.
        let own = |guid: &GUID| guid.to_bytes()[15] & 0xc0 == 0;
        until(|| {
            while let Some(event) = status.try_recv_status() {
                match event {
                    DomainParticipantStatusEvent::RemoteReaderMatched { local_writer, .. } => {
                        writers.extend(own(&local_writer).then_some(local_writer));
                    }
                    DomainParticipantStatusEvent::RemoteWriterMatched { local_reader, .. } => {
                        readers.extend(own(&local_reader).then_some(local_reader));
                    }
                    _ => {}
                }
            }
            (writers.len() >= 3 && readers.len() >= 5).then_some(())
        });
        Self {
            action,
            _node: node,
        }
    }

    fn send(&self, goal: G) -> (GoalId, SendGoalResponse) {
        let (request, id) = self.action.send_goal(goal).unwrap();
        let answer = until(|| self.action.receive_goal_response(request).unwrap());
        (id, answer)
    }

    fn result(&self, id: GoalId) -> (GoalStatusEnum, R) {
        let request = self.action.request_result(id).unwrap();
        until(|| self.action.receive_result(request).unwrap())
    }

    fn cancel(&self, id: GoalId) -> CancelGoalResponse {
        let request = self.action.cancel_goal(id).unwrap();
        until(|| self.action.receive_cancel_response(request).unwrap())
    }

    /// Returns the remaining distances, m, reported since the last call.
    fn feedback(&self, id: GoalId) -> Vec<f32> {
        let mut left_m = Vec::new();
        while let Some(feedback) = self.action.receive_feedback(id).unwrap() {
            left_m.push(feedback.distance_to_goal);
        }
        left_m
    }
}

#[track_caller]
fn until<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let since = Instant::now();
    loop {
        if let Some(found) = look() {
            return found;
        }
        assert!(since.elapsed() < PATIENCE, "nothing came");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// A straight path in the odometry's frame from the rover's start on, along its heading there.
fn straight(from_m: f64, to_m: f64) -> Path {
    let yaw_rad = -50.906_f64.to_radians();
    let mut path = Path::default();
    path.header.frame_id = "odom".to_owned();
    let count = ((to_m - from_m) / 0.1).round() as usize;
    for i in 0..=count {
        let along_m = from_m + 0.1 * i as f64;
        let pose = Pose {
            x_m: -yaw_rad.sin() * along_m,
            y_m: yaw_rad.cos() * along_m,
            z_m: 0.0,
            yaw_rad,
        };
        path.poses.push(PoseStamped {
            header: path.header.clone(),
            pose: to_pose(&world_from_base_link(&pose, &Attitude::LEVEL)),
        });
    }
    path
}

fn goal(path: Path) -> FollowPathGoal {
    FollowPathGoal {
        path,
        ..FollowPathGoal::default()
    }
}

#[test]
fn a_wrong_topic_frame_or_type_is_found_from_the_screen_alone() {
    for (from, to, says) in [
        (
            "    odometry: odom # nav",
            "    odometry: wheels/odom # nav",
            &[
                "odometry on /wheels/odom (nav_msgs/msg/Odometry)",
                "no publisher",
                "this type is on /odom",
            ][..],
        ),
        (
            "    imu: imu #",
            "    imu: odom #",
            &[
                "imu on /odom (sensor_msgs/msg/Imu)",
                "published as nav_msgs/msg/Odometry",
            ],
        ),
        (
            "    odometry: odom # frame",
            "    odometry: map # frame",
            &[
                "odometry on /odom",
                "rejected",
                "it is in odom, must be in map",
            ],
        ),
    ] {
        let domain_id = domain_id();
        let _vehicle = start("vehicle", "vehicle_ros2.yaml", domain_id);
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("run.yaml");
        let text = configuration("bridge/run_ros2.yaml");
        assert!(text.contains(from), "{from}");
        std::fs::write(&file, text.replace(from, to)).unwrap();
        let mut run = Running::start(
            command("run", &file, domain_id)
                .args(["--format", "text"])
                .stdout(Stdio::piped()),
        );
        let lines = BufReader::new(run.0.stdout.take().unwrap()).lines();
        let mut seen = Vec::new();
        // Discovery takes time: the first reason may be that no publisher is known yet. Without a change there is a line
        // a minute.
        let found = lines.map_while(Result::ok).take(6).any(|line| {
            let found = says.iter().all(|part| line.contains(part));
            seen.push(line);
            found
        });
        assert!(found, "{says:?} in {seen:#?}");
        assert!(seen[0].contains("listens to odometry /"), "{}", seen[0]);
        drop(run);
    }
}

#[test]
fn a_client_of_fast_dds_drives_cancels_and_asks_twice() {
    let domain_id = domain_id();
    let _vehicle = start("vehicle", "vehicle_ros2.yaml", domain_id);
    let _run = start("run", "run_ros2.yaml", domain_id);
    let client = Client::<FollowPathGoal, FollowPathResult>::find(domain_id);

    let (id, answer) = client.send(goal(straight(0.0, 2.0)));
    assert!(answer.accepted);
    let (status, result) = client.result(id);
    let told = (status, result.error_code, result.error_msg.as_str());
    assert_eq!(told, (GoalStatusEnum::Succeeded, code::NONE, ""));
    let left_m = client.feedback(id);
    assert!(!left_m.is_empty() && left_m.iter().all(|left_m| *left_m <= 2.0));

    // The answer to a second request is the same, and there is nothing to cancel any more.
    assert_eq!(client.result(id).0, GoalStatusEnum::Succeeded);
    let ended = client.cancel(id).return_code;
    assert_eq!(ended, CancelGoalResponseEnum::GoalTerminated);
    let nobody = client.cancel(GoalId::new_random()).return_code;
    assert_eq!(nobody, CancelGoalResponseEnum::UnknownGoal);

    // Another goal is cancelled under way.
    let (id, answer) = client.send(goal(straight(2.0, 12.0)));
    assert!(answer.accepted);
    until(|| {
        client
            .feedback(id)
            .last()
            .copied()
            .filter(|left_m| *left_m < 9.5)
    });
    let canceled = client.cancel(id);
    assert_eq!(canceled.return_code, CancelGoalResponseEnum::None);
    assert_eq!(canceled.goals_canceling[0].goal_id, id);
    assert_eq!(client.result(id).0, GoalStatusEnum::Canceled);

    // A path that cannot be followed aborts the goal, with the reason.
    let (id, answer) = client.send(goal(Path::default()));
    assert!(answer.accepted);
    let (status, result) = client.result(id);
    assert_eq!(
        (status, result.error_code),
        (GoalStatusEnum::Aborted, code::INVALID_PATH)
    );
    assert!(!result.error_msg.is_empty());
}

/// A controller with this `definition` of the action, without a vehicle.
fn run_with(definition: &str, domain_id: u16) -> (Running, tempfile::TempDir) {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("run.yaml");
    let text = configuration("bridge/run_ros2.yaml");
    assert!(text.contains("definition: jazzy"));
    let text = text.replace("definition: jazzy", &format!("definition: {definition}"));
    std::fs::write(&file, text).unwrap();
    let run = Running::start(&mut command("run", &file, domain_id));
    (run, folder)
}

#[test]
fn clients_of_humble_and_iron_are_understood_and_answered() {
    let domain = domain_id();
    let _run = run_with("humble", domain);
    let humble = Client::<FollowPathGoalHumble, FollowPathResultHumble>::find(domain);
    let (id, answer) = humble.send(FollowPathGoalHumble::default());
    assert!(answer.accepted);
    assert_eq!(humble.result(id).0, GoalStatusEnum::Aborted);

    let domain = domain_id();
    let _run = run_with("iron", domain);
    let iron = Client::<FollowPathGoal, FollowPathResultIron>::find(domain);
    let (id, answer) = iron.send(FollowPathGoal {
        path: straight(0.0, 2.0),
        progress_checker_id: "no_such".to_owned(),
        ..FollowPathGoal::default()
    });
    assert!(answer.accepted);
    let (status, result) = iron.result(id);
    let told = (status, result.error_code);
    assert_eq!(told, (GoalStatusEnum::Aborted, code::INVALID_CONTROLLER));
}
