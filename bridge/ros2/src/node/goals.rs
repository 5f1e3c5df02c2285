//! The goals of an action server: their states, their results, and the clients that wait for them.

use ros2_client::action::{CancelGoalResponse, GoalId, GoalInfo, GoalStatusEnum};
use ros2_client::action_msgs::{CancelGoalResponseEnum, GoalStatus};
use ros2_client::builtin_interfaces::Time;
use ros2_client::request_id::RmwRequestId;
use std::collections::BTreeMap;

/// How a goal has ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GoalEnd {
    /// It was reached.
    Succeeded,
    /// Its client cancelled it.
    Canceled,
    /// The server gave it up.
    Aborted,
}

impl GoalEnd {
    fn status(self) -> GoalStatusEnum {
        match self {
            Self::Succeeded => GoalStatusEnum::Succeeded,
            Self::Canceled => GoalStatusEnum::Canceled,
            Self::Aborted => GoalStatusEnum::Aborted,
        }
    }
}

/// The answer to a request for a result.
#[derive(Debug, Clone, PartialEq)]
pub struct ResultResponse<R> {
    /// The request.
    pub request: RmwRequestId,
    /// How the goal has ended; [`GoalStatusEnum::Unknown`] if the goal is unknown.
    pub status: GoalStatusEnum,
    /// The result.
    pub result: R,
}

#[derive(Debug, Clone)]
struct Goal<R> {
    accepted: Time,
    status: GoalStatusEnum,
    waiting: Vec<RmwRequestId>,
    /// When it ended, s, and its result.
    ended: Option<(f64, R)>,
}

/// For how long a result can be requested, s: the default of `rcl_action`.
const KEPT_S: f64 = 900.0;
/// Results that are kept.
const KEPT_MAX: usize = 100;

/// The goals of an action server with results of type `R`.
#[derive(Debug)]
pub struct Goals<R> {
    goals: BTreeMap<GoalId, Goal<R>>,
}

impl<R> Default for Goals<R> {
    fn default() -> Self {
        Self {
            goals: BTreeMap::new(),
        }
    }
}

impl<R: Clone + Default> Goals<R> {
    /// Accepts a goal; returns false where its id is taken.
    pub fn accept(&mut self, id: GoalId, accepted: Time) -> bool {
        if self.goals.contains_key(&id) {
            return false;
        }
        self.goals.insert(
            id,
            Goal {
                accepted,
                status: GoalStatusEnum::Executing,
                waiting: Vec::new(),
                ended: None,
            },
        );
        true
    }

    /// Returns the state of a goal.
    pub fn status(&self, id: &GoalId) -> Option<GoalStatusEnum> {
        self.goals.get(id).map(|goal| goal.status)
    }

    /// Returns the answer to a request to cancel; the goals in it are being cancelled from now on.
    ///
    /// As in `rcl_action`: a zero id and a zero stamp mean all goals, a stamp alone all accepted until
    /// then, an id alone that goal, and both either.
    pub fn cancel(&mut self, request: &GoalInfo) -> CancelGoalResponse {
        let (by_id, by_time) = (request.goal_id != GoalId::ZERO, request.stamp != Time::ZERO);
        let named = self.goals.get(&request.goal_id).map(|goal| goal.status);
        let mut goals_canceling = Vec::new();
        for (id, goal) in &mut self.goals {
            let matches = match (by_id, by_time) {
                (false, false) => true,
                (true, false) => *id == request.goal_id,
                (false, true) => goal.accepted <= request.stamp,
                (true, true) => *id == request.goal_id || goal.accepted <= request.stamp,
            };
            if matches && goal.ended.is_none() {
                goal.status = GoalStatusEnum::Canceling;
                goals_canceling.push(GoalInfo {
                    goal_id: *id,
                    stamp: goal.accepted,
                });
            }
        }
        let return_code = match named {
            _ if !goals_canceling.is_empty() || !by_id => CancelGoalResponseEnum::None,
            None => CancelGoalResponseEnum::UnknownGoal,
            Some(_) => CancelGoalResponseEnum::GoalTerminated,
        };
        CancelGoalResponse {
            return_code,
            goals_canceling,
        }
    }

    /// Ends a goal and returns the answers to the requests that wait for its result; none where it has
    /// ended before.
    pub fn end(
        &mut self,
        id: &GoalId,
        now_s: f64,
        end: GoalEnd,
        result: R,
    ) -> Vec<ResultResponse<R>> {
        let Some(goal) = self.goals.get_mut(id).filter(|goal| goal.ended.is_none()) else {
            return Vec::new();
        };
        goal.status = end.status();
        let responses = std::mem::take(&mut goal.waiting)
            .into_iter()
            .map(|request| ResultResponse {
                request,
                status: goal.status,
                result: result.clone(),
            })
            .collect();
        goal.ended = Some((now_s, result));
        responses
    }

    /// Takes a request for a result, and returns the answer where the goal has ended or is not known.
    pub fn result(&mut self, id: &GoalId, request: RmwRequestId) -> Option<ResultResponse<R>> {
        let Some(goal) = self.goals.get_mut(id) else {
            return Some(ResultResponse {
                request,
                status: GoalStatusEnum::Unknown,
                result: R::default(),
            });
        };
        let Some((_, result)) = &goal.ended else {
            goal.waiting.push(request);
            return None;
        };
        Some(ResultResponse {
            request,
            status: goal.status,
            result: result.clone(),
        })
    }

    /// Removes results that have expired.
    pub fn expire(&mut self, now_s: f64) {
        self.goals.retain(|_, goal| {
            let ended_s = goal.ended.as_ref().map(|(ended_s, _)| *ended_s);
            ended_s.is_none_or(|ended_s| now_s - ended_s <= KEPT_S)
        });
        let mut ended: Vec<(f64, GoalId)> = self
            .goals
            .iter()
            .filter_map(|(id, goal)| goal.ended.as_ref().map(|(at_s, _)| (*at_s, *id)))
            .collect();
        ended.sort_by(|a, b| b.0.total_cmp(&a.0));
        for (_, id) in ended.drain(..).skip(KEPT_MAX) {
            self.goals.remove(&id);
        }
    }

    /// Returns the states of all goals.
    pub fn statuses(&self) -> Vec<GoalStatus> {
        self.goals
            .iter()
            .map(|(id, goal)| GoalStatus {
                goal_info: GoalInfo {
                    goal_id: *id,
                    stamp: goal.accepted,
                },
                status: goal.status,
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ros2_client::Gid;

    fn request(sequence_number: i64) -> RmwRequestId {
        RmwRequestId {
            writer_gid: Gid::ZERO,
            sequence_number,
        }
    }

    fn info(goal_id: GoalId, sec: i32) -> GoalInfo {
        GoalInfo {
            goal_id,
            stamp: Time::new(sec, 0),
        }
    }

    fn with_goals(count: i32) -> (Goals<u16>, Vec<GoalId>) {
        let mut goals = Goals::default();
        let ids: Vec<GoalId> = (0..count).map(|_| GoalId::new_random()).collect();
        for (at, id) in ids.iter().enumerate() {
            assert!(goals.accept(*id, Time::new(at as i32 + 1, 0)));
        }
        (goals, ids)
    }

    #[test]
    fn every_request_for_a_result_is_answered() {
        let (mut goals, ids) = with_goals(1);
        assert!(!goals.accept(ids[0], Time::ZERO), "the id is taken");
        assert_eq!(goals.result(&ids[0], request(1)), None);
        assert_eq!(goals.result(&ids[0], request(2)), None);
        let responses = goals.end(&ids[0], 1.0, GoalEnd::Aborted, 105);
        let answered: Vec<i64> = responses
            .iter()
            .map(|r| r.request.sequence_number)
            .collect();
        assert_eq!(answered, [1, 2]);
        let later = goals.result(&ids[0], request(3)).unwrap();
        assert_eq!((later.status, later.result), (GoalStatusEnum::Aborted, 105));
        // The first end is kept.
        let again = goals.end(&ids[0], 2.0, GoalEnd::Succeeded, 0);
        assert!(again.is_empty());
        assert_eq!(goals.status(&ids[0]), Some(GoalStatusEnum::Aborted));
        let unknown = goals.result(&GoalId::new_random(), request(4)).unwrap();
        assert_eq!(unknown.status, GoalStatusEnum::Unknown);
    }

    #[test]
    fn goals_are_cancelled_by_id_by_time_or_all() {
        let (mut goals, ids) = with_goals(3);
        let mut canceled = |goal_id, sec| {
            let response = goals.cancel(&info(goal_id, sec));
            let goals: Vec<GoalId> = response.goals_canceling.iter().map(|g| g.goal_id).collect();
            (response.return_code, goals)
        };
        use CancelGoalResponseEnum as Code;
        assert_eq!(canceled(ids[1], 0), (Code::None, vec![ids[1]]));
        assert_eq!(canceled(GoalId::ZERO, 1), (Code::None, vec![ids[0]]));
        assert_eq!(canceled(GoalId::new_random(), 0).0, Code::UnknownGoal);
        assert_eq!(canceled(GoalId::ZERO, 0).1.len(), 3);
        for id in &ids {
            assert_eq!(goals.status(id), Some(GoalStatusEnum::Canceling));
            goals.end(id, 1.0, GoalEnd::Canceled, 0);
        }
        let ended = goals.cancel(&info(ids[0], 0));
        assert_eq!(ended.return_code, Code::GoalTerminated);
        assert!(ended.goals_canceling.is_empty());
        let none_left = goals.cancel(&info(GoalId::ZERO, 0));
        assert_eq!(none_left.return_code, Code::None);
        assert!(none_left.goals_canceling.is_empty());
    }

    #[test]
    fn results_expire_and_running_goals_do_not() {
        let (mut goals, ids) = with_goals(3);
        goals.end(&ids[0], 10.0, GoalEnd::Succeeded, 0);
        goals.end(&ids[1], 500.0, GoalEnd::Succeeded, 0);
        goals.expire(1000.0);
        assert_eq!(goals.statuses().len(), 2);
        assert_eq!(goals.status(&ids[0]), None);
        for _ in 0..150 {
            let id = GoalId::new_random();
            goals.accept(id, Time::ZERO);
            goals.end(&id, 1000.0, GoalEnd::Succeeded, 0);
        }
        goals.expire(1000.0);
        assert_eq!(goals.statuses().len(), KEPT_MAX + 1);
        assert!(goals.status(&ids[2]).is_some());
    }
}
