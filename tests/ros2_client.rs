//! An action client in the mapping of Fast DDS, against a controller and a virtual rover in
//! processes of their own.

// The lints' exceptions for tests do not reach helper functions.
#![allow(clippy::unwrap_used, clippy::panic)]

use ros2_client::action::{
    ActionClientQosPolicies, CancelGoalResponse, GoalId, GoalStatusEnum, SendGoalResponse,
};
use ros2_client::action_msgs::CancelGoalResponseEnum;
use ros2_client::dds::rustdds::{DomainParticipantStatusEvent, StatusEvented};
use ros2_client::{ActionClient, ActionTypeName, Name, ServiceMapping};
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::convert::{to_pose, world_from_base_link};
use sidehill_bridge::ros2::message::action::{
    FollowPathFeedback, FollowPathGoal, FollowPathResult, code,
};
use sidehill_bridge::ros2::message::{Path, PoseStamped};
use sidehill_bridge::ros2::node::RosNode;
use sidehill_bridge::ros2::qos;
use sidehill_plant::frames::{Attitude, Pose};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// What an answer may take on a busy machine: a limit for liveness, not a figure.
const PATIENCE: Duration = Duration::from_secs(60);

type FollowPathClient = ActionClient<FollowPathGoal, FollowPathResult, FollowPathFeedback>;

/// A process that ends with the test.
struct Program(Child);

impl Program {
    fn start(subcommand: &str, config: &str, domain_id: u16) -> Self {
        let config = format!("{}/config/bridge/{config}", env!("CARGO_MANIFEST_DIR"));
        let mut command = Command::new(env!("CARGO_BIN_EXE_sidehill"));
        command
            .args([subcommand, &config])
            .env("ROS_DOMAIN_ID", domain_id.to_string())
            .env("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp")
            .env("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
            .stdout(Stdio::null())
            .stderr(Stdio::null());
        Self(command.spawn().unwrap())
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        self.0.kill().unwrap();
        self.0.wait().unwrap();
    }
}

/// Controller, rover and a client of the action.
struct Rig {
    client: FollowPathClient,
    _node: RosNode,
    _programs: [Program; 2],
}

impl Rig {
    fn start() -> Self {
        // Tests that run at the same time must not hear each other.
        let domain_id = 1 + (std::process::id() % 200) as u16;
        let programs = [
            Program::start("vehicle", "vehicle_ros2.yaml", domain_id),
            Program::start("run", "run_ros2.yaml", domain_id),
        ];
        let environment = RosEnvironment {
            domain_id,
            service_mapping: ServiceMapping::Enhanced,
            loopback_only: true,
        };
        let mut node = RosNode::start("client", &RosArguments::default(), &environment).unwrap();
        let status = node.context().domain_participant().status_listener();
        let client = node
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
        // Three services with a reader and a writer each, feedback and status; a request that is
        // written before its reader is known is lost.
        let (mut readers, mut writers) = (0, 0);
        until(|| {
            while let Some(event) = status.try_recv_status() {
                match event {
                    DomainParticipantStatusEvent::RemoteReaderMatched { .. } => readers += 1,
                    DomainParticipantStatusEvent::RemoteWriterMatched { .. } => writers += 1,
                    _ => {}
                }
            }
            (readers >= 3 && writers >= 5).then_some(())
        });
        Self {
            client,
            _node: node,
            _programs: programs,
        }
    }

    fn send(&self, path: Path) -> (GoalId, SendGoalResponse) {
        let goal = FollowPathGoal {
            path,
            ..FollowPathGoal::default()
        };
        let (request, id) = self.client.send_goal(goal).unwrap();
        let answer = until(|| self.client.receive_goal_response(request).unwrap());
        (id, answer)
    }

    fn result(&self, id: GoalId) -> (GoalStatusEnum, FollowPathResult) {
        let request = self.client.request_result(id).unwrap();
        until(|| self.client.receive_result(request).unwrap())
    }

    fn cancel(&self, id: GoalId) -> CancelGoalResponse {
        let request = self.client.cancel_goal(id).unwrap();
        until(|| self.client.receive_cancel_response(request).unwrap())
    }

    /// Drives `length_m` from where the rover stands at first, and returns how far is left as it is
    /// told on the way.
    fn feedback(&self, id: GoalId) -> Vec<f32> {
        let mut left_m = Vec::new();
        while let Some(feedback) = self.client.receive_feedback(id).unwrap() {
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

#[test]
fn a_client_of_fast_dds_drives_cancels_and_asks_twice() {
    let rig = Rig::start();

    let (id, answer) = rig.send(straight(0.0, 2.0));
    assert!(answer.accepted);
    let (status, result) = rig.result(id);
    assert_eq!(
        (status, result.error_code),
        (GoalStatusEnum::Succeeded, code::NONE)
    );
    assert_eq!(result.error_msg, "");
    let left_m = rig.feedback(id);
    assert!(!left_m.is_empty() && left_m.iter().all(|left_m| *left_m <= 2.0));

    // The answer to a second request is the same, and there is nothing to cancel any more.
    assert_eq!(rig.result(id).0, GoalStatusEnum::Succeeded);
    assert_eq!(
        rig.cancel(id).return_code,
        CancelGoalResponseEnum::GoalTerminated
    );
    let nobody = rig.cancel(GoalId::new_random());
    assert_eq!(nobody.return_code, CancelGoalResponseEnum::UnknownGoal);

    // Another goal is cancelled under way.
    let (id, answer) = rig.send(straight(2.0, 12.0));
    assert!(answer.accepted);
    until(|| {
        rig.feedback(id)
            .last()
            .copied()
            .filter(|left_m| *left_m < 9.5)
    });
    let canceled = rig.cancel(id);
    assert_eq!(canceled.return_code, CancelGoalResponseEnum::None);
    assert_eq!(canceled.goals_canceling[0].goal_id, id);
    assert_eq!(rig.result(id).0, GoalStatusEnum::Canceled);

    // And one that cannot be followed is aborted, with the reason.
    let (id, answer) = rig.send(Path::default());
    assert!(answer.accepted);
    let (status, result) = rig.result(id);
    assert_eq!(
        (status, result.error_code),
        (GoalStatusEnum::Aborted, code::INVALID_PATH)
    );
    assert!(!result.error_msg.is_empty());
}
