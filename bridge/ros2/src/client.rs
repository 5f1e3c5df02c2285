//! A client of FollowPath, in whichever definition of the action.

use super::node::message::action::{
    FollowPathFeedback, FollowPathGoal, FollowPathGoalHumble, FollowPathResult,
    FollowPathResultHumble, FollowPathResultIron, code,
};
use super::node::{NodeError, RosNode, qos};
use super::server::outcome::Outcome;
use ros2_client::action::{ActionClientQosPolicies, GoalId, GoalStatusEnum};
use ros2_client::dds::rustdds::{
    DomainParticipantStatusEvent, DomainParticipantStatusListener, GUID, StatusEvented,
};
use ros2_client::{ActionClient, ActionTypeName, Message, Publisher, RmwRequestId};
use sidehill_bridge::ros2::ROUTE_ACTION;
use sidehill_bridge::ros2::arguments::{RosArguments, RosEnvironment};
use sidehill_bridge::ros2::message::{Path, Text};
use sidehill_bridge::ros2::settings::server::{Definition, FollowPathConfig};
use std::collections::BTreeSet;
use std::time::{Duration, Instant};

/// Time after which a request without an answer is sent again: the server answers within milliseconds, but a first
/// request may be lost.
const AGAIN: Duration = Duration::from_secs(5);

/// What has become of the goal.
#[derive(Debug, Clone, PartialEq)]
pub enum GoalEvent {
    /// The server has rejected it: its log says why.
    Rejected,
    /// Distance that is left along the path, m.
    Left(f64),
    /// It was driven to its end.
    Succeeded,
    /// It ended otherwise.
    Ended(GoalFailure),
}

/// Why a goal has ended before its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct GoalFailure {
    /// The server's reason.
    pub reason: String,
    /// Whether the vehicle has made no progress; no definition before iron's says so.
    pub stuck: bool,
}

impl GoalFailure {
    /// Returns the failure of a vehicle that is not stuck.
    pub fn new(reason: impl Into<String>) -> Self {
        Self {
            reason: reason.into(),
            stuck: false,
        }
    }
}

/// How the types of a definition are used.
trait Calls: Send {
    fn send(&self, path: Path) -> Option<(RmwRequestId, GoalId)>;
    fn accepted(&self, request: RmwRequestId) -> Option<bool>;
    fn ask(&self, goal: GoalId) -> Option<RmwRequestId>;
    fn result(&self, request: RmwRequestId) -> Option<(GoalStatusEnum, Outcome)>;
    fn left_m(&self, goal: GoalId) -> Option<f64>;
    fn cancel(&self, goal: GoalId);
}

struct Typed<G: Message + Clone, R: Message + Clone> {
    action: ActionClient<G, R, FollowPathFeedback>,
    goal: fn(Path) -> G,
    outcome: fn(R) -> Outcome,
}

impl<G: Message + Clone + Send + 'static, R: Message + Clone + Send + 'static> Calls
    for Typed<G, R>
{
    fn send(&self, path: Path) -> Option<(RmwRequestId, GoalId)> {
        self.action.send_goal((self.goal)(path)).ok()
    }

    fn accepted(&self, request: RmwRequestId) -> Option<bool> {
        let answer = self.action.receive_goal_response(request).ok()?;
        answer.map(|answer| answer.accepted)
    }

    fn ask(&self, goal: GoalId) -> Option<RmwRequestId> {
        self.action.request_result(goal).ok()
    }

    fn result(&self, request: RmwRequestId) -> Option<(GoalStatusEnum, Outcome)> {
        let answer = self.action.receive_result(request).ok()?;
        answer.map(|(status, result)| (status, (self.outcome)(result)))
    }

    fn left_m(&self, goal: GoalId) -> Option<f64> {
        let mut newest = None;
        while let Ok(Some(feedback)) = self.action.receive_feedback(goal) {
            newest = Some(f64::from(feedback.distance_to_goal));
        }
        newest
    }

    fn cancel(&self, goal: GoalId) {
        let _ = self.action.cancel_goal(goal);
    }
}

/// A request and when it was sent.
#[derive(Debug, Clone, Copy)]
struct SentRequest {
    request: RmwRequestId,
    at: Instant,
}

/// A goal on its way.
struct SentGoal {
    path: Path,
    id: GoalId,
    /// The goal itself until it is accepted, then its result.
    asked: SentRequest,
    accepted: bool,
}

/// The client. Dropped, it leaves the graph, and its goal ends.
pub struct FollowPathClient {
    calls: Box<dyn Calls>,
    discovery: DomainParticipantStatusListener,
    writers: BTreeSet<GUID>,
    readers: BTreeSet<GUID>,
    goal: Option<SentGoal>,
    actions: Publisher<Text>,
    // Dropped last, after all that it has created.
    _node: RosNode,
}

impl FollowPathClient {
    /// Starts a node called `name` unless an argument renames it.
    ///
    /// # Errors
    /// [`NodeError`]: an invalid name, or a network that cannot be used.
    pub fn start(
        name: &str,
        config: &FollowPathConfig,
        arguments: &RosArguments,
        environment: &RosEnvironment,
    ) -> Result<Self, NodeError> {
        let mut node = RosNode::start(name, arguments, environment)?;
        let discovery = node.context().domain_participant().status_listener();
        let calls: Box<dyn Calls> = match config.definition {
            Definition::Humble => Box::new(Typed {
                action: action::<FollowPathGoalHumble, FollowPathResultHumble>(&mut node, config)?,
                goal: |path| FollowPathGoalHumble {
                    path,
                    ..FollowPathGoalHumble::default()
                },
                outcome: |_| Outcome::default(),
            }),
            Definition::Iron => Box::new(Typed {
                action: action::<FollowPathGoal, FollowPathResultIron>(&mut node, config)?,
                goal,
                outcome: |result| Outcome::new(result.error_code, ""),
            }),
            Definition::Jazzy => Box::new(Typed {
                action: action::<FollowPathGoal, FollowPathResult>(&mut node, config)?,
                goal,
                outcome: |result| Outcome::new(result.error_code, result.error_msg),
            }),
        };
        Ok(Self {
            calls,
            discovery,
            writers: BTreeSet::new(),
            readers: BTreeSet::new(),
            goal: None,
            actions: node.publisher(ROUTE_ACTION, &qos::RELIABLE_10)?,
            _node: node,
        })
    }

    /// Returns whether a server has been found: what is sent before it is lost.
    pub fn has_server(&mut self) -> bool {
        // The events include the middleware's own endpoints.
        let of_user = |guid: &GUID| guid.to_bytes()[15] & 0xc0 == 0;
        while let Some(event) = self.discovery.try_recv_status() {
            match event {
                DomainParticipantStatusEvent::RemoteReaderMatched { local_writer, .. } => {
                    let of_action = of_user(&local_writer) && local_writer != self.actions.guid();
                    self.writers.extend(of_action.then_some(local_writer));
                }
                DomainParticipantStatusEvent::RemoteWriterMatched { local_reader, .. } => {
                    self.readers
                        .extend(of_user(&local_reader).then_some(local_reader));
                }
                _ => {}
            }
        }
        // Three services, feedback and status.
        self.writers.len() >= 3 && self.readers.len() >= 5
    }

    /// Sends a path, in place of one that is on its way.
    pub fn send(&mut self, path: Path) {
        self.goal = self.calls.send(path.clone()).map(|(request, id)| SentGoal {
            path,
            id,
            asked: asked(request),
            accepted: false,
        });
    }

    /// Asks the server to end the goal: the vehicle stops.
    pub fn cancel(&self) {
        if let Some(goal) = &self.goal {
            self.calls.cancel(goal.id);
        }
    }

    /// Publishes that the vehicle has passed an action of its route.
    pub fn publish_action(&self, text: &str) {
        let data = text.to_owned();
        // A full queue drops it.
        let _ = self.actions.publish(Text { data });
    }

    /// Returns what is new. After the end there is no goal any more.
    pub fn poll(&mut self) -> Option<GoalEvent> {
        let goal = self.goal.as_mut()?;
        let SentRequest { request, at } = goal.asked;
        let unanswered = at.elapsed() > AGAIN;
        if !goal.accepted {
            match self.calls.accepted(request) {
                Some(true) => {
                    goal.accepted = true;
                    goal.asked = asked(self.calls.ask(goal.id)?);
                }
                Some(false) => {
                    self.goal = None;
                    return Some(GoalEvent::Rejected);
                }
                None if unanswered => {
                    let path = goal.path.clone();
                    self.send(path);
                }
                None => {}
            }
            return None;
        }
        if let Some((status, outcome)) = self.calls.result(request) {
            self.goal = None;
            return Some(match status {
                GoalStatusEnum::Succeeded => GoalEvent::Succeeded,
                GoalStatusEnum::Canceled => GoalEvent::Ended(GoalFailure::new("it was cancelled")),
                _ => GoalEvent::Ended(GoalFailure {
                    stuck: outcome.code == code::FAILED_TO_MAKE_PROGRESS,
                    reason: match outcome.message.is_empty() {
                        true => format!("error code {}", outcome.code),
                        false => outcome.message,
                    },
                }),
            });
        }
        if unanswered {
            goal.asked = asked(self.calls.ask(goal.id)?);
        }
        self.calls.left_m(goal.id).map(GoalEvent::Left)
    }
}

fn asked(request: RmwRequestId) -> SentRequest {
    SentRequest {
        request,
        at: Instant::now(),
    }
}

fn goal(path: Path) -> FollowPathGoal {
    FollowPathGoal {
        path,
        ..FollowPathGoal::default()
    }
}

fn action<G: Message + Clone + 'static, R: Message + Clone + 'static>(
    node: &mut RosNode,
    config: &FollowPathConfig,
) -> Result<ActionClient<G, R, FollowPathFeedback>, NodeError> {
    let mapping = node.service_mapping();
    let name = node.resolve(&config.action)?;
    Ok(node.inner().create_action_client(
        mapping,
        &name,
        &ActionTypeName::new("nav2_msgs", "FollowPath"),
        ActionClientQosPolicies {
            goal_service: qos::SERVICE,
            result_service: qos::SERVICE,
            cancel_service: qos::SERVICE,
            feedback_subscription: qos::RELIABLE_10,
            status_subscription: qos::LATCHED,
        },
    )?)
}
