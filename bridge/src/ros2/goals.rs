//! The goals of an action: their states, who waits for their results, and what may be cancelled.

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
    /// Its client took it back.
    Canceled,
    /// It was given up.
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

/// What a client is told of an ended goal.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Outcome {
    /// One of [`code`](super::message::action::code).
    pub code: u16,
    /// Why, in words; empty for success.
    pub message: String,
}

impl Outcome {
    /// Returns an outcome.
    pub fn new(code: u16, message: impl Into<String>) -> Self {
        Self {
            code,
            message: message.into(),
        }
    }
}

/// An answer to who asks for a result.
#[derive(Debug, Clone, PartialEq)]
pub struct ResultAnswer {
    /// Who asked.
    pub request: RmwRequestId,
    /// How the goal has ended; unknown where there is no such goal.
    pub status: GoalStatusEnum,
    /// What is told.
    pub outcome: Outcome,
}

#[derive(Debug, Clone)]
struct Goal {
    accepted: Time,
    status: GoalStatusEnum,
    waiting: Vec<RmwRequestId>,
    /// When it ended, s, and how.
    ended: Option<(f64, Outcome)>,
}

/// For how long a result can be asked for, s, as `rcl_action` has it for Nav2.
const KEPT_S: f64 = 900.0;
/// Ended goals that are kept.
const KEPT_MAX: usize = 100;

/// The goals of an action.
#[derive(Debug, Default)]
pub struct Goals {
    goals: BTreeMap<GoalId, Goal>,
}

impl Goals {
    /// Takes a goal up; returns false where there is one of that name already.
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

    /// Asks to cancel what `asked` names, and returns the answer: the goals named in it are being
    /// cancelled from now on.
    ///
    /// A zero name and a zero stamp mean all goals, a stamp alone all accepted until then, a name
    /// alone that goal, and both either.
    pub fn cancel(&mut self, asked: &GoalInfo) -> CancelGoalResponse {
        let (by_name, by_time) = (asked.goal_id != GoalId::ZERO, asked.stamp != Time::ZERO);
        let named = self.goals.get(&asked.goal_id).map(|goal| goal.status);
        let mut goals_canceling = Vec::new();
        for (id, goal) in &mut self.goals {
            let meant = match (by_name, by_time) {
                (false, false) => true,
                (true, false) => *id == asked.goal_id,
                (false, true) => goal.accepted <= asked.stamp,
                (true, true) => *id == asked.goal_id || goal.accepted <= asked.stamp,
            };
            if meant && goal.ended.is_none() {
                goal.status = GoalStatusEnum::Canceling;
                goals_canceling.push(GoalInfo {
                    goal_id: *id,
                    stamp: goal.accepted,
                });
            }
        }
        let return_code = match named {
            _ if !goals_canceling.is_empty() || !by_name => CancelGoalResponseEnum::None,
            None => CancelGoalResponseEnum::UnknownGoal,
            Some(_) => CancelGoalResponseEnum::GoalTerminated,
        };
        CancelGoalResponse {
            return_code,
            goals_canceling,
        }
    }

    /// Ends a goal and returns the answers to all who wait for its result; none where it has ended
    /// before.
    pub fn end(
        &mut self,
        id: &GoalId,
        now_s: f64,
        end: GoalEnd,
        outcome: Outcome,
    ) -> Vec<ResultAnswer> {
        let Some(goal) = self.goals.get_mut(id).filter(|goal| goal.ended.is_none()) else {
            return Vec::new();
        };
        goal.status = end.status();
        let answers = std::mem::take(&mut goal.waiting)
            .into_iter()
            .map(|request| ResultAnswer {
                request,
                status: goal.status,
                outcome: outcome.clone(),
            })
            .collect();
        goal.ended = Some((now_s, outcome));
        answers
    }

    /// Takes a request for a result, and returns the answer where there is one now.
    pub fn result(&mut self, id: &GoalId, request: RmwRequestId) -> Option<ResultAnswer> {
        let Some(goal) = self.goals.get_mut(id) else {
            return Some(ResultAnswer {
                request,
                status: GoalStatusEnum::Unknown,
                outcome: Outcome::default(),
            });
        };
        let Some((_, outcome)) = &goal.ended else {
            goal.waiting.push(request);
            return None;
        };
        Some(ResultAnswer {
            request,
            status: goal.status,
            outcome: outcome.clone(),
        })
    }

    /// Forgets results that are old.
    pub fn forget_old(&mut self, now_s: f64) {
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

    fn with_goals(count: i32) -> (Goals, Vec<GoalId>) {
        let mut goals = Goals::default();
        let ids: Vec<GoalId> = (0..count).map(|_| GoalId::new_random()).collect();
        for (at, id) in ids.iter().enumerate() {
            assert!(goals.accept(*id, Time::new(at as i32 + 1, 0)));
        }
        (goals, ids)
    }

    #[test]
    fn a_result_is_answered_before_and_after_the_end_as_often_as_it_is_asked_for() {
        let (mut goals, ids) = with_goals(1);
        assert!(!goals.accept(ids[0], Time::ZERO), "the same name again");
        assert_eq!(goals.result(&ids[0], request(1)), None);
        assert_eq!(goals.result(&ids[0], request(2)), None);
        let outcome = Outcome::new(105, "stuck");
        let answers = goals.end(&ids[0], 1.0, GoalEnd::Aborted, outcome.clone());
        let asked: Vec<i64> = answers.iter().map(|a| a.request.sequence_number).collect();
        assert_eq!(asked, [1, 2]);
        let later = goals.result(&ids[0], request(3)).unwrap();
        assert_eq!(
            (later.status, later.outcome),
            (GoalStatusEnum::Aborted, outcome)
        );
        // The first end is kept.
        let again = goals.end(&ids[0], 2.0, GoalEnd::Succeeded, Outcome::default());
        assert!(again.is_empty());
        assert_eq!(goals.status(&ids[0]), Some(GoalStatusEnum::Aborted));
        let unknown = goals.result(&GoalId::new_random(), request(4)).unwrap();
        assert_eq!(unknown.status, GoalStatusEnum::Unknown);
    }

    #[test]
    fn cancelling_means_by_name_by_time_or_all() {
        let (mut goals, ids) = with_goals(3);
        let mut canceled = |goal_id, sec| {
            let answer = goals.cancel(&info(goal_id, sec));
            let goals: Vec<GoalId> = answer.goals_canceling.iter().map(|g| g.goal_id).collect();
            (answer.return_code, goals)
        };
        use CancelGoalResponseEnum as Code;
        assert_eq!(canceled(ids[1], 0), (Code::None, vec![ids[1]]));
        assert_eq!(canceled(GoalId::ZERO, 1), (Code::None, vec![ids[0]]));
        assert_eq!(canceled(GoalId::new_random(), 0).0, Code::UnknownGoal);
        assert_eq!(canceled(GoalId::ZERO, 0).1.len(), 3);
        for id in &ids {
            assert_eq!(goals.status(id), Some(GoalStatusEnum::Canceling));
            goals.end(id, 1.0, GoalEnd::Canceled, Outcome::default());
        }
        let ended = goals.cancel(&info(ids[0], 0));
        assert_eq!(ended.return_code, Code::GoalTerminated);
        assert!(ended.goals_canceling.is_empty());
        let none_left = goals.cancel(&info(GoalId::ZERO, 0));
        assert_eq!(none_left.return_code, Code::None);
        assert!(none_left.goals_canceling.is_empty());
    }

    #[test]
    fn ended_goals_are_forgotten_and_running_ones_are_not() {
        let (mut goals, ids) = with_goals(3);
        goals.end(&ids[0], 10.0, GoalEnd::Succeeded, Outcome::default());
        goals.end(&ids[1], 500.0, GoalEnd::Succeeded, Outcome::default());
        goals.forget_old(1000.0);
        assert_eq!(goals.statuses().len(), 2);
        assert_eq!(goals.status(&ids[0]), None);
        for _ in 0..150 {
            let id = GoalId::new_random();
            goals.accept(id, Time::ZERO);
            goals.end(&id, 1000.0, GoalEnd::Succeeded, Outcome::default());
        }
        goals.forget_old(1000.0);
        assert_eq!(goals.statuses().len(), KEPT_MAX + 1);
        assert!(goals.status(&ids[2]).is_some());
    }
}
