//! The endpoints of nav2_msgs/FollowPath, whichever distribution's.
//!
//! On the client library's plain server: its asynchronous one answers a result once and only after
//! the client has asked, knows no feedback while cancelling and gives wrong codes.

use super::config::{Definition, FollowPathConfig};
use super::goals::{Outcome, ResultAnswer};
use super::message::action::{
    FollowPathFeedback, FollowPathGoal, FollowPathGoalHumble, FollowPathResult,
    FollowPathResultHumble, FollowPathResultIron,
};
use super::message::{Empty, Path};
use super::node::{NodeError, RosNode};
use super::peers::{Peers, Requests};
use super::qos;
use ros2_client::action::{
    ActionServerQosPolicies, CancelGoalRequest, CancelGoalResponse, GetResultRequest,
    GetResultResponse, GoalId, GoalInfo, SendGoalRequest, SendGoalResponse,
};
use ros2_client::action_msgs::{GoalStatus, GoalStatusArray};
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use ros2_client::request_id::RmwRequestId;
use ros2_client::{ActionServer, ActionTypeName, Message};

/// A goal that has come.
pub(super) struct NewGoal {
    pub(super) request: RmwRequestId,
    pub(super) id: GoalId,
    pub(super) path: Path,
    pub(super) controller_id: String,
    pub(super) goal_checker_id: String,
    pub(super) progress_checker_id: String,
}

/// The action on the graph. Writing never fails here: what a full queue drops is as lost as on the
/// way, and the client asks again or has left.
pub(super) trait FollowPathEndpoints: Send {
    /// Wakes a poll with `token` when something comes.
    fn register(&mut self, registry: &Registry, token: Token) -> std::io::Result<()>;
    fn next_goal(&mut self, peers: &Peers) -> Option<NewGoal>;
    fn answer_goal(&self, request: RmwRequestId, accepted: bool, stamp: Time);
    fn next_cancel(&mut self, peers: &Peers) -> Option<(RmwRequestId, GoalInfo)>;
    fn answer_cancel(&self, request: RmwRequestId, answer: CancelGoalResponse);
    fn next_result_request(&mut self, peers: &Peers) -> Option<(RmwRequestId, GoalId)>;
    fn answer_result(&self, answer: ResultAnswer);
    fn feed_back(&self, id: GoalId, feedback: FollowPathFeedback);
    fn publish_statuses(&self, statuses: Vec<GoalStatus>);
}

/// Returns the endpoints of the action that is configured.
pub(super) fn endpoints(
    node: &mut RosNode,
    config: &FollowPathConfig,
) -> Result<Box<dyn FollowPathEndpoints>, NodeError> {
    Ok(match config.definition {
        Definition::Humble => {
            Box::new(Endpoints::<FollowPathGoalHumble, FollowPathResultHumble>::new(node, config)?)
        }
        Definition::Iron => Box::new(Endpoints::<FollowPathGoal, FollowPathResultIron>::new(
            node, config,
        )?),
        Definition::Jazzy => Box::new(Endpoints::<FollowPathGoal, FollowPathResult>::new(
            node, config,
        )?),
    })
}

/// A goal of any definition: path, controller, goal checker and progress checker.
trait Goal: Message + Clone + Send + 'static {
    fn parts(self) -> (Path, [String; 3]);
}

impl Goal for FollowPathGoalHumble {
    fn parts(self) -> (Path, [String; 3]) {
        (
            self.path,
            [self.controller_id, self.goal_checker_id, String::new()],
        )
    }
}

impl Goal for FollowPathGoal {
    fn parts(self) -> (Path, [String; 3]) {
        (
            self.path,
            [
                self.controller_id,
                self.goal_checker_id,
                self.progress_checker_id,
            ],
        )
    }
}

impl From<Outcome> for FollowPathResultHumble {
    fn from(_: Outcome) -> Self {
        Self {
            result: Empty::default(),
        }
    }
}

impl From<Outcome> for FollowPathResultIron {
    fn from(outcome: Outcome) -> Self {
        use super::message::action::code;
        Self {
            result: Empty::default(),
            error_code: match outcome.code {
                // It came with jazzy.
                code::CONTROLLER_TIMED_OUT => code::NO_VALID_CONTROL,
                code => code,
            },
        }
    }
}

impl From<Outcome> for FollowPathResult {
    fn from(outcome: Outcome) -> Self {
        Self {
            result: Empty::default(),
            error_code: outcome.code,
            error_msg: outcome.message,
        }
    }
}

struct Endpoints<G: Goal, R: Message + Clone + 'static> {
    server: ActionServer<G, R, FollowPathFeedback>,
    goals: Requests<SendGoalRequest<G>>,
    cancels: Requests<CancelGoalRequest>,
    results: Requests<GetResultRequest>,
}

impl<G: Goal, R: Message + Clone + 'static> Endpoints<G, R> {
    fn new(node: &mut RosNode, config: &FollowPathConfig) -> Result<Self, NodeError> {
        let name = node.names().resolve(&config.action)?;
        let mapping = node.service_mapping();
        let server = node.inner().create_action_server(
            mapping,
            &name,
            &ActionTypeName::new("nav2_msgs", "FollowPath"),
            ActionServerQosPolicies {
                goal_service: qos::SERVICE,
                result_service: qos::SERVICE,
                cancel_service: qos::SERVICE,
                feedback_publisher: qos::RELIABLE_10,
                status_publisher: qos::LATCHED,
            },
        )?;
        let service = |kind: &str| format!("{name}/_action/{kind}");
        Ok(Self {
            server,
            goals: Requests::of(&service("send_goal")),
            cancels: Requests::of(&service("cancel_goal")),
            results: Requests::of(&service("get_result")),
        })
    }
}

impl<G, R> FollowPathEndpoints for Endpoints<G, R>
where
    G: Goal,
    R: Message + Clone + From<Outcome> + Send + 'static,
{
    fn register(&mut self, registry: &Registry, token: Token) -> std::io::Result<()> {
        registry.register(self.server.goal_server(), token, Interest::READABLE)?;
        registry.register(self.server.cancel_server(), token, Interest::READABLE)?;
        registry.register(self.server.result_server(), token, Interest::READABLE)
    }

    fn next_goal(&mut self, peers: &Peers) -> Option<NewGoal> {
        let server = &self.server;
        let (request, goal) = self.goals.next(peers, || server.receive_goal())?;
        let id = goal.goal_id;
        let (path, [controller_id, goal_checker_id, progress_checker_id]) = goal.goal.parts();
        Some(NewGoal {
            request,
            id,
            path,
            controller_id,
            goal_checker_id,
            progress_checker_id,
        })
    }

    fn answer_goal(&self, request: RmwRequestId, accepted: bool, stamp: Time) {
        let _ = self
            .server
            .send_goal_response(request, SendGoalResponse { accepted, stamp });
    }

    fn next_cancel(&mut self, peers: &Peers) -> Option<(RmwRequestId, GoalInfo)> {
        let server = &self.server;
        let (request, asked) = self
            .cancels
            .next(peers, || server.receive_cancel_request())?;
        Some((request, goal_info(&asked)?))
    }

    fn answer_cancel(&self, request: RmwRequestId, answer: CancelGoalResponse) {
        let _ = self.server.send_cancel_response(request, answer);
    }

    fn next_result_request(&mut self, peers: &Peers) -> Option<(RmwRequestId, GoalId)> {
        let server = &self.server;
        let (request, asked) = self
            .results
            .next(peers, || server.receive_result_request())?;
        Some((request, asked.goal_id))
    }

    fn answer_result(&self, answer: ResultAnswer) {
        let response = GetResultResponse {
            status: answer.status,
            result: R::from(answer.outcome),
        };
        let _ = self.server.send_result(answer.request, response);
    }

    fn feed_back(&self, id: GoalId, feedback: FollowPathFeedback) {
        let _ = self.server.send_feedback(id, feedback);
    }

    fn publish_statuses(&self, status_list: Vec<GoalStatus>) {
        let _ = self
            .server
            .send_goal_statuses(GoalStatusArray { status_list });
    }
}

/// Returns what a request names, which the client library keeps to itself but for its serde form.
fn goal_info(request: &CancelGoalRequest) -> Option<GoalInfo> {
    let mut value = serde_json::to_value(request).ok()?;
    serde_json::from_value(value.get_mut("goal_info")?.take()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cancel_request_says_which_goal_it_means() {
        let info = GoalInfo {
            goal_id: GoalId::new_random(),
            stamp: Time::new(12, 34),
        };
        let value = serde_json::json!({ "goal_info": serde_json::to_value(&info).unwrap() });
        let request: CancelGoalRequest = serde_json::from_value(value).unwrap();
        let found = goal_info(&request).unwrap();
        assert_eq!((found.goal_id, found.stamp), (info.goal_id, info.stamp));
    }

    #[test]
    fn a_code_that_a_definition_does_not_have_becomes_one_it_has() {
        let late = Outcome::new(107, "late");
        assert_eq!(FollowPathResultIron::from(late.clone()).error_code, 106);
        let result = FollowPathResult::from(late);
        assert_eq!(
            (result.error_code, result.error_msg.as_str()),
            (107, "late")
        );
    }
}
