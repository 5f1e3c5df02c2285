//! An action server on the client library's plain one, with a cache of results.
//!
//! The library's asynchronous server answers a result once and only after the client has asked, publishes
//! no feedback while cancelling, and returns the wrong code for unknown goals.

use super::goals::{GoalEnd, Goals, ResultResponse};
use super::peers::{Peers, Requests};
use super::{NodeError, RosNode, qos};
use ros2_client::action::{
    ActionServerQosPolicies, CancelGoalRequest, GetResultRequest, GetResultResponse, GoalId,
    GoalInfo, GoalStatusEnum, SendGoalRequest, SendGoalResponse,
};
use ros2_client::action_msgs::GoalStatusArray;
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::{Interest, Registry, Token};
use ros2_client::request_id::RmwRequestId;
use ros2_client::{ActionTypeName, Message};

/// A goal that a client has sent.
#[derive(Debug, Clone)]
pub struct GoalRequest<G> {
    /// The request, which is answered once.
    pub request: RmwRequestId,
    /// Id of the goal.
    pub id: GoalId,
    /// The goal.
    pub goal: G,
}

/// An action server with goals `G`, results `R` and feedback `F`.
///
/// Writing never fails here: what a full queue drops is lost as on the network, and the client asks again
/// or has left.
pub struct ActionServer<G, R, F>
where
    G: Message + Clone + 'static,
    R: Message + Clone + 'static,
    F: Message + 'static,
{
    server: ros2_client::ActionServer<G, R, F>,
    goals: Goals<R>,
    goal_requests: Requests<SendGoalRequest<G>>,
    cancel_requests: Requests<CancelGoalRequest>,
    result_requests: Requests<GetResultRequest>,
    status_changed: bool,
}

impl<G, R, F> ActionServer<G, R, F>
where
    G: Message + Clone + 'static,
    R: Message + Clone + Default + 'static,
    F: Message + 'static,
{
    /// Returns the server of an action of type `package/kind`, whose name is resolved; `token` wakes a
    /// poll when something arrives.
    ///
    /// # Errors
    /// [`NodeError`].
    pub fn new(
        node: &mut RosNode,
        action: &str,
        (package, kind): (&str, &str),
        (registry, token): (&Registry, Token),
    ) -> Result<Self, NodeError> {
        let name = node.resolve(action)?;
        let mapping = node.service_mapping();
        let mut server = node.inner().create_action_server(
            mapping,
            &name,
            &ActionTypeName::new(package, kind),
            ActionServerQosPolicies {
                goal_service: qos::SERVICE,
                result_service: qos::SERVICE,
                cancel_service: qos::SERVICE,
                feedback_publisher: qos::RELIABLE_10,
                status_publisher: qos::LATCHED,
            },
        )?;
        registry.register(server.goal_server(), token, Interest::READABLE)?;
        registry.register(server.cancel_server(), token, Interest::READABLE)?;
        registry.register(server.result_server(), token, Interest::READABLE)?;
        let service = |kind: &str| format!("{name}/_action/{kind}");
        Ok(Self {
            server,
            goals: Goals::default(),
            goal_requests: Requests::of(&service("send_goal")),
            cancel_requests: Requests::of(&service("cancel_goal")),
            result_requests: Requests::of(&service("get_result")),
            status_changed: true,
        })
    }

    /// Returns the next goal that has arrived; it must be answered with [`ActionServer::respond`].
    pub fn next_goal(&mut self, peers: &Peers) -> Option<GoalRequest<G>> {
        let server = &self.server;
        let (request, goal) = self.goal_requests.next(peers, || server.receive_goal())?;
        Some(GoalRequest {
            request,
            id: goal.goal_id,
            goal: goal.goal,
        })
    }

    /// Returns whether a goal could not be read since the last call: it is of another type, or is mapped by
    /// another middleware.
    pub fn take_unreadable(&mut self) -> bool {
        self.goal_requests.take_unreadable()
    }

    /// Accepts or rejects a goal; one whose id is taken is rejected. Returns whether it was accepted.
    pub fn respond(&mut self, request: RmwRequestId, id: GoalId, accept: bool, now: Time) -> bool {
        let accepted = accept && self.goals.accept(id, now);
        let response = SendGoalResponse {
            accepted,
            stamp: now,
        };
        let _ = self.server.send_goal_response(request, response);
        self.status_changed |= accepted;
        accepted
    }

    /// Answers a request to cancel, and returns the goals that are being cancelled; none where no request
    /// has arrived.
    pub fn next_cancel(&mut self, peers: &Peers) -> Option<Vec<GoalId>> {
        loop {
            let server = &self.server;
            let (request, cancel) = self
                .cancel_requests
                .next(peers, || server.receive_cancel_request())?;
            let Some(info) = goal_info(&cancel) else {
                continue;
            };
            let response = self.goals.cancel(&info);
            let canceling = response.goals_canceling.iter().map(|goal| goal.goal_id);
            let canceling: Vec<GoalId> = canceling.collect();
            self.status_changed |= !canceling.is_empty();
            let _ = self.server.send_cancel_response(request, response);
            return Some(canceling);
        }
    }

    /// Answers all requests for results of goals that have ended; the others wait.
    pub fn answer_result_requests(&mut self, peers: &Peers) {
        loop {
            let server = &self.server;
            let next = self
                .result_requests
                .next(peers, || server.receive_result_request());
            let Some((request, result)) = next else {
                return;
            };
            if let Some(response) = self.goals.result(&result.goal_id, request) {
                self.send_result(response);
            }
        }
    }

    /// Ends a goal. Its state is published before its result is sent, so that a client that waits for the result
    /// does not read an earlier state for longer than the middleware takes.
    pub fn end(&mut self, id: &GoalId, now_s: f64, end: GoalEnd, result: R) {
        let responses = self.goals.end(id, now_s, end, result);
        self.status_changed = true;
        self.publish_status(now_s);
        for response in responses {
            self.send_result(response);
        }
    }

    /// Returns whether a goal is being executed or cancelled, and has not ended.
    pub fn is_active(&self, id: &GoalId) -> bool {
        matches!(
            self.goals.status(id),
            Some(GoalStatusEnum::Executing | GoalStatusEnum::Canceling)
        )
    }

    /// Publishes feedback on a goal.
    pub fn publish_feedback(&self, id: GoalId, feedback: F) {
        let _ = self.server.send_feedback(id, feedback);
    }

    /// Publishes the states of all goals where one has changed, and removes expired results.
    pub fn publish_status(&mut self, now_s: f64) {
        self.goals.expire(now_s);
        if std::mem::take(&mut self.status_changed) {
            let status_list = self.goals.statuses();
            let _ = self
                .server
                .send_goal_statuses(GoalStatusArray { status_list });
        }
    }

    fn send_result(&self, response: ResultResponse<R>) {
        let ResultResponse {
            request,
            status,
            result,
        } = response;
        let _ = self
            .server
            .send_result(request, GetResultResponse { status, result });
    }
}

/// Returns what a request names, which the client library shows in its serde form alone.
fn goal_info(request: &CancelGoalRequest) -> Option<GoalInfo> {
    let mut value = serde_json::to_value(request).ok()?;
    serde_json::from_value(value.get_mut("goal_info")?.take()).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_request_to_cancel_names_its_goal() {
        let info = GoalInfo {
            goal_id: GoalId::new_random(),
            stamp: Time::new(12, 34),
        };
        let value = serde_json::json!({ "goal_info": serde_json::to_value(&info).unwrap() });
        let request: CancelGoalRequest = serde_json::from_value(value).unwrap();
        let found = goal_info(&request).unwrap();
        assert_eq!((found.goal_id, found.stamp), (info.goal_id, info.stamp));
    }
}
