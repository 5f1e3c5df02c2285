//! The action server of nav2_msgs/FollowPath, in the definition of any distribution.

use super::outcome::Outcome;
use crate::node::action::ActionServer;
use crate::node::goals::GoalEnd;
use crate::node::message::action::{
    FollowPathFeedback, FollowPathGoal, FollowPathGoalHumble, FollowPathResult,
    FollowPathResultHumble, FollowPathResultIron, code,
};
use crate::node::peers::Peers;
use crate::node::{NodeError, RosNode};
use ros2_client::Message;
use ros2_client::action::GoalId;
use ros2_client::builtin_interfaces::Time;
use ros2_client::dds::rustdds::mio1::{Registry, Token};
use ros2_client::request_id::RmwRequestId;
use sidehill_bridge::ros2::message::{Empty, Path};
use sidehill_bridge::ros2::settings::server::{Definition, FollowPathConfig};

/// A goal that a client has sent.
pub(crate) struct FollowPathRequest {
    pub(crate) request: RmwRequestId,
    pub(crate) id: GoalId,
    pub(crate) path: Path,
    pub(crate) controller_id: String,
    pub(crate) goal_checker_id: String,
    pub(crate) progress_checker_id: String,
}

impl FollowPathRequest {
    /// Checks that the goal names the controller and the checkers that there are, or none.
    ///
    /// # Errors
    /// `INVALID_CONTROLLER` with the name.
    pub(crate) fn check_ids(&self, config: &FollowPathConfig) -> Result<(), Outcome> {
        for (kind, id, own) in [
            ("controller", &self.controller_id, &config.controller_id),
            (
                "goal checker",
                &self.goal_checker_id,
                &config.goal_checker_id,
            ),
            (
                "progress checker",
                &self.progress_checker_id,
                &config.progress_checker_id,
            ),
        ] {
            if !id.is_empty() && id != own {
                let message = format!("there is no {kind} {id}, only {own}");
                return Err(Outcome::new(code::INVALID_CONTROLLER, message));
            }
        }
        Ok(())
    }
}

/// The action server for either definition: see [`ActionServer`].
pub(crate) trait FollowPathServer: Send {
    fn next_goal(&mut self, peers: &Peers) -> Option<FollowPathRequest>;
    fn take_unreadable(&mut self) -> bool;
    fn respond(&mut self, request: RmwRequestId, id: GoalId, accept: bool, now: Time) -> bool;
    fn next_cancel(&mut self, peers: &Peers) -> Option<Vec<GoalId>>;
    fn answer_result_requests(&mut self, peers: &Peers);
    fn end(&mut self, id: &GoalId, now_s: f64, end: GoalEnd, outcome: Outcome);
    fn is_active(&self, id: &GoalId) -> bool;
    fn publish_feedback(&self, id: GoalId, feedback: FollowPathFeedback);
    fn publish_status(&mut self, now_s: f64);
}

/// Returns the action server of the definition that is configured.
pub(crate) fn action_server(
    node: &mut RosNode,
    config: &FollowPathConfig,
    poll: (&Registry, Token),
) -> Result<Box<dyn FollowPathServer>, NodeError> {
    let (action, kind) = (&config.action, ("nav2_msgs", "FollowPath"));
    type Server<G, R> = ActionServer<G, R, FollowPathFeedback>;
    Ok(match config.definition {
        Definition::Humble => Box::new(
            Server::<FollowPathGoalHumble, FollowPathResultHumble>::new(node, action, kind, poll)?,
        ),
        Definition::Iron => Box::new(Server::<FollowPathGoal, FollowPathResultIron>::new(
            node, action, kind, poll,
        )?),
        Definition::Jazzy => Box::new(Server::<FollowPathGoal, FollowPathResult>::new(
            node, action, kind, poll,
        )?),
    })
}

impl<G, R> FollowPathServer for ActionServer<G, R, FollowPathFeedback>
where
    G: Message + Clone + Into<FollowPathGoal> + Send + 'static,
    R: Message + Clone + Default + From<Outcome> + Send + 'static,
{
    fn next_goal(&mut self, peers: &Peers) -> Option<FollowPathRequest> {
        let goal = ActionServer::next_goal(self, peers)?;
        let FollowPathGoal {
            path,
            controller_id,
            goal_checker_id,
            progress_checker_id,
        } = goal.goal.into();
        Some(FollowPathRequest {
            request: goal.request,
            id: goal.id,
            path,
            controller_id,
            goal_checker_id,
            progress_checker_id,
        })
    }

    fn take_unreadable(&mut self) -> bool {
        ActionServer::take_unreadable(self)
    }

    fn respond(&mut self, request: RmwRequestId, id: GoalId, accept: bool, now: Time) -> bool {
        ActionServer::respond(self, request, id, accept, now)
    }

    fn next_cancel(&mut self, peers: &Peers) -> Option<Vec<GoalId>> {
        ActionServer::next_cancel(self, peers)
    }

    fn answer_result_requests(&mut self, peers: &Peers) {
        ActionServer::answer_result_requests(self, peers);
    }

    fn end(&mut self, id: &GoalId, now_s: f64, end: GoalEnd, outcome: Outcome) {
        ActionServer::end(self, id, now_s, end, R::from(outcome));
    }

    fn is_active(&self, id: &GoalId) -> bool {
        ActionServer::is_active(self, id)
    }

    fn publish_feedback(&self, id: GoalId, feedback: FollowPathFeedback) {
        ActionServer::publish_feedback(self, id, feedback);
    }

    fn publish_status(&mut self, now_s: f64) {
        ActionServer::publish_status(self, now_s);
    }
}

impl From<FollowPathGoalHumble> for FollowPathGoal {
    fn from(goal: FollowPathGoalHumble) -> Self {
        Self {
            path: goal.path,
            controller_id: goal.controller_id,
            goal_checker_id: goal.goal_checker_id,
            progress_checker_id: String::new(),
        }
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
        Self {
            result: Empty::default(),
            error_code: match outcome.code {
                // New in jazzy.
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

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::Gid;

    #[test]
    fn a_code_that_a_definition_does_not_have_becomes_one_it_has() {
        let late = Outcome::new(code::CONTROLLER_TIMED_OUT, "late");
        assert_eq!(FollowPathResultIron::from(late.clone()).error_code, 106);
        let result = FollowPathResult::from(late);
        assert_eq!(
            (result.error_code, result.error_msg.as_str()),
            (107, "late")
        );
    }

    #[test]
    fn ids_are_empty_or_those_of_the_configuration() {
        let config = FollowPathConfig::default();
        let mut goal = FollowPathRequest {
            request: RmwRequestId {
                writer_gid: Gid::ZERO,
                sequence_number: 1,
            },
            id: GoalId::ZERO,
            path: Path::default(),
            controller_id: config.controller_id.clone(),
            goal_checker_id: String::new(),
            progress_checker_id: config.progress_checker_id.clone(),
        };
        goal.check_ids(&config).unwrap();
        goal.goal_checker_id = "other".to_owned();
        let outcome = goal.check_ids(&config).unwrap_err();
        assert_eq!(outcome.code, code::INVALID_CONTROLLER);
        assert!(
            outcome.message.contains("goal checker other"),
            "{outcome:?}"
        );
    }
}
