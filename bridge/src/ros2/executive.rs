//! From a path that is asked for to a drive that has ended: when to arm, when to stop, what to tell.
//!
//! ```text
//! Preparing -> Arming -> Driving -> Ending -> (told)
//! ```
//!
//! A path that leads off behind the vehicle is preceded by a turn on the spot, and prepared again after
//! it; where the vehicle shall look elsewhere at its end, such a turn follows.
//!
//! Time is an argument; there is no node and no thread in here. The safety decides on its own when
//! the vehicle stops; the executive only asks it to, and gives its reasons a code.

mod outcomes;
mod vocabulary;

pub use vocabulary::{Client, Effect, Seen, Turns};

use super::checkers::{GoalError, ProgressChecker};
use super::config::Tolerances;
use super::goals::{GoalEnd, Outcome};
use super::message::action::code;
use crate::safety::{Reason, SafetyState, StopCause};
use outcomes::{doubt, explained, refusal};
use sidehill_controller::controller::Status;
use sidehill_plant::frames::{PlanarPose, wrap_angle};

/// A turn on the spot that belongs to a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Turn {
    AtStart,
    AtGoal,
}

#[derive(Debug, Clone, PartialEq)]
enum Phase {
    Preparing,
    /// The vehicle shall stand, and then turn to this heading; without one it is at the goal.
    Standing {
        since_s: f64,
        turn_to_rad: Option<f64>,
    },
    Arming {
        since_s: f64,
    },
    Driving,
    Ending {
        since_s: f64,
        end: GoalEnd,
        outcome: Outcome,
    },
}

#[derive(Debug, Clone)]
struct Job {
    client: Client,
    number: u64,
    phase: Phase,
    goal: PlanarPose,
    progress: ProgressChecker,
    /// Whether the controller has taken the path up.
    followed: bool,
    /// The newest turn, where there was one.
    turn: Option<Turn>,
    /// Whether it is what is driven.
    turning: bool,
    /// Since when transforms are missing, and plans.
    without_transform_s: Option<f64>,
    without_plan_s: Option<f64>,
}

/// Longest time until the drives are armed, s.
const ARMING_S: f64 = 10.0;
/// Longest time for a stop, s; the safety's own ramp is far shorter.
const ENDING_S: f64 = 10.0;

/// Looks after one path at a time.
#[derive(Debug, Default)]
pub struct Executive {
    turns: Turns,
    job: Option<Job>,
    number: u64,
    /// What a stop is asked for.
    stopping: Option<StopCause>,
}

impl Executive {
    /// Returns an executive without a path.
    pub fn new(turns: Turns) -> Self {
        Self {
            turns,
            ..Self::default()
        }
    }

    /// Returns who the path in hand is for.
    pub fn client(&self) -> Option<Client> {
        self.job.as_ref().map(|job| job.client)
    }

    /// Returns the number of the path in hand, where it is given to the controller.
    pub fn driven(&self) -> Option<u64> {
        let job = self.job.as_ref()?;
        matches!(job.phase, Phase::Arming { .. } | Phase::Driving).then_some(job.number)
    }

    /// Takes up another path; the one before has ended. Returns its number.
    pub fn begin(&mut self, client: Client) -> (u64, Vec<Effect>) {
        let mut effects = Vec::new();
        let mut progress = ProgressChecker::default();
        if let Some(job) = self.job.take() {
            // Who sends a newer path again and again shall still learn that the vehicle does not get on.
            progress = job.progress;
            effects.push(match job.phase {
                // What was being ended has its end.
                Phase::Ending { end, outcome, .. } => Effect::Told(job.client, end, outcome),
                _ => Effect::Told(
                    job.client,
                    GoalEnd::Aborted,
                    Outcome::new(code::UNKNOWN, "a newer path has come"),
                ),
            });
        }
        self.number += 1;
        self.job = Some(Job {
            client,
            number: self.number,
            phase: Phase::Preparing,
            goal: PlanarPose::default(),
            progress,
            followed: false,
            turn: None,
            turning: false,
            without_transform_s: None,
            without_plan_s: None,
        });
        (self.number, effects)
    }

    /// Returns a number for a path that replaces the one in hand without being another: at other
    /// speeds, or after its frame has moved.
    pub fn renumber(&mut self) -> Option<u64> {
        let job = self.job.as_mut()?;
        self.number += 1;
        job.number = self.number;
        Some(self.number)
    }

    /// Says that the controller has been given the path, which leads to `goal`; where it leads off
    /// behind the vehicle, also the heading there, rad.
    pub fn ready(
        &mut self,
        now_s: f64,
        state: SafetyState,
        goal: PlanarPose,
        turn_to_rad: Option<f64>,
    ) -> Vec<Effect> {
        let Some(job) = self.job.as_mut() else {
            return Vec::new();
        };
        job.goal = goal;
        job.followed = false;
        // A vehicle that is under way goes over to the new path as it drives.
        let under_way = matches!(
            state,
            SafetyState::Zeroing | SafetyState::Enabling | SafetyState::Driving
        );
        if turn_to_rad.is_some() && self.turns.at_start && job.turn.is_none() {
            return self.stand(now_s, under_way, turn_to_rad);
        }
        if under_way && self.stopping.is_none() {
            job.phase = Phase::Driving;
            return Vec::new();
        }
        job.progress.reset();
        job.phase = Phase::Arming { since_s: now_s };
        vec![Effect::Arm(job.number)]
    }

    /// Says that the path leads nowhere: the vehicle is at its goal, but may look elsewhere.
    pub fn arrived(&mut self, now_s: f64, state: SafetyState, goal: PlanarPose) -> Vec<Effect> {
        let Some(job) = self.job.as_mut() else {
            return Vec::new();
        };
        job.goal = goal;
        let stands = matches!(state, SafetyState::Disarmed | SafetyState::Latched);
        self.stand(now_s, !stands, None)
    }

    fn stand(&mut self, now_s: f64, under_way: bool, turn_to_rad: Option<f64>) -> Vec<Effect> {
        if let Some(job) = &mut self.job {
            job.phase = Phase::Standing {
                since_s: now_s,
                turn_to_rad,
            };
        }
        if under_way {
            self.stopping = Some(StopCause::DriveEnded);
        }
        vec![Effect::Stop(self.stopping)]
    }

    /// Says where the goal is now, as its frame has moved.
    pub fn move_goal(&mut self, goal: PlanarPose) {
        if let Some(job) = &mut self.job {
            job.goal = goal;
        }
    }

    /// Ends the path in hand for a cause; it is told when the vehicle stands.
    pub fn end(
        &mut self,
        now_s: f64,
        end: GoalEnd,
        (cause, outcome): (StopCause, Outcome),
    ) -> Vec<Effect> {
        let Some(job) = self.job.as_mut() else {
            return Vec::new();
        };
        if let Phase::Ending { .. } = job.phase {
            return Vec::new();
        }
        job.phase = Phase::Ending {
            since_s: now_s,
            end,
            outcome,
        };
        self.stopping = Some(cause);
        vec![Effect::Arm(0), Effect::Stop(self.stopping)]
    }

    /// Looks at what has become of the path in hand.
    pub fn step(&mut self, seen: &Seen<'_>, tolerances: &Tolerances) -> Vec<Effect> {
        let off = matches!(seen.state, SafetyState::Disarmed | SafetyState::Latched);
        let Some(job) = self.job.as_mut() else {
            return self.guard_idle(off);
        };
        match job.phase.clone() {
            Phase::Preparing => {
                if let Some(doubt) = refusal(seen) {
                    return self.end(seen.now_s, GoalEnd::Aborted, doubt);
                }
                if self.stopping.is_some() && off {
                    self.stopping = None;
                    return vec![Effect::Stop(None)];
                }
                Vec::new()
            }
            Phase::Ending {
                since_s,
                end,
                outcome,
            } => {
                // Only a cycle that has seen the stop says that the vehicle stands.
                let stands = off && seen.cycle_s > since_s;
                if stands || seen.now_s - since_s > ENDING_S {
                    let client = job.client;
                    self.job = None;
                    self.stopping = self.stopping.filter(|_| !stands);
                    return vec![
                        Effect::Clear,
                        Effect::Stop(self.stopping),
                        Effect::Told(client, end, outcome),
                    ];
                }
                Vec::new()
            }
            Phase::Standing {
                since_s,
                turn_to_rad,
            } => {
                if let Some(doubt) = refusal(seen) {
                    return self.end(seen.now_s, GoalEnd::Aborted, doubt);
                }
                let estimate = seen.decision.and_then(|decision| decision.estimate);
                // Only a cycle that has seen the stop says that the vehicle stands.
                if off
                    && seen.cycle_s > since_s
                    && let Some(estimate) = estimate
                {
                    self.stopping = None;
                    let mut effects = vec![Effect::Stop(None)];
                    let (now_s, pose) = (seen.now_s, estimate.pose);
                    effects.extend(match turn_to_rad {
                        Some(to_rad) => {
                            let angle_rad = wrap_angle(to_rad - pose.yaw_rad);
                            self.turn(now_s, Turn::AtStart, pose, angle_rad)
                        }
                        None => self.at_end(now_s, &pose, tolerances),
                    });
                    return effects;
                }
                if seen.now_s - since_s > ENDING_S {
                    let doubt = doubt(code::UNKNOWN, StopCause::NotArmed);
                    return self.end(seen.now_s, GoalEnd::Aborted, doubt);
                }
                Vec::new()
            }
            Phase::Arming { since_s } => {
                if let Some(doubt) = refusal(seen) {
                    return self.end(seen.now_s, GoalEnd::Aborted, doubt);
                }
                if self.stopping.is_some() && off {
                    self.stopping = None;
                    return vec![Effect::Stop(None)];
                }
                if seen.armed >= job.number {
                    job.phase = Phase::Driving;
                } else if seen.now_s - since_s > ARMING_S {
                    let doubt = doubt(code::UNKNOWN, StopCause::NotArmed);
                    return self.end(seen.now_s, GoalEnd::Aborted, doubt);
                }
                Vec::new()
            }
            Phase::Driving => self.watch(seen, tolerances, off),
        }
    }

    /// Nobody has asked for a drive.
    fn guard_idle(&mut self, off: bool) -> Vec<Effect> {
        let wanted = (!off).then_some(StopCause::NobodyAsked);
        if wanted.is_some() == self.stopping.is_some() {
            return Vec::new();
        }
        self.stopping = wanted;
        vec![Effect::Stop(wanted)]
    }

    fn watch(&mut self, seen: &Seen<'_>, tolerances: &Tolerances, off: bool) -> Vec<Effect> {
        let Some(job) = self.job.as_mut() else {
            return Vec::new();
        };
        let now_s = seen.now_s;
        let own = seen
            .decision
            .filter(|decision| decision.reference == job.number);
        let tracked = own.filter(|decision| {
            matches!(
                decision.status,
                Status::Tracking | Status::Fallback { .. } | Status::Finished
            )
        });
        job.followed |= tracked.is_some() && !off;
        if off {
            return self.ended(seen, tolerances);
        }
        if seen.state == SafetyState::Stopping {
            return Vec::new();
        }
        if let Some(doubt) = refusal(seen) {
            return self.end(now_s, GoalEnd::Aborted, doubt);
        }
        if seen.emergency_stop_awaited {
            let doubt = doubt(code::UNKNOWN, StopCause::EmergencyStopUnheard);
            return self.end(now_s, GoalEnd::Aborted, doubt);
        }
        if seen.client_lost {
            let doubt = doubt(code::UNKNOWN, StopCause::ClientLeft);
            return self.end(now_s, GoalEnd::Aborted, doubt);
        }
        let lasts = |since_s: &mut Option<f64>, holds: bool| {
            if !holds {
                *since_s = None;
                return false;
            }
            now_s - *since_s.get_or_insert(now_s) > tolerances.failure_s
        };
        if lasts(&mut job.without_transform_s, seen.transform.is_some()) {
            let outcome = Outcome::new(code::TF_ERROR, seen.transform.unwrap_or_default());
            let doubt = (StopCause::FrameLost, outcome);
            return self.end(now_s, GoalEnd::Aborted, doubt);
        }
        let fallback = match own.map(|decision| decision.status) {
            Some(Status::Fallback { reason, .. }) => Some(reason),
            _ => None,
        };
        if lasts(&mut job.without_plan_s, fallback.is_some()) {
            let reason = fallback.map_or_else(String::new, |reason| format!(": {reason}"));
            let message = format!("{}{reason}", StopCause::NoPlan);
            let outcome = Outcome::new(code::PATIENCE_EXCEEDED, message);
            return self.end(now_s, GoalEnd::Aborted, (StopCause::NoPlan, outcome));
        }
        let pose = own
            .and_then(|decision| decision.estimate)
            .map(|estimate| estimate.pose);
        if let Some(pose) = pose.filter(|_| seen.state == SafetyState::Driving && !job.turning) {
            let (radius_m, time_s) = (tolerances.progress_m, tolerances.progress_time_s);
            if !job.progress.gets_on(now_s, &pose, radius_m, time_s) {
                let message = format!("no progress of {radius_m} m within {time_s} s");
                let outcome = Outcome::new(code::FAILED_TO_MAKE_PROGRESS, message);
                return self.end(now_s, GoalEnd::Aborted, (StopCause::NoProgress, outcome));
            }
        }
        Vec::new()
    }

    /// The vehicle stands, but looks elsewhere than it shall.
    fn turn(&mut self, now_s: f64, turn: Turn, from: PlanarPose, angle_rad: f64) -> Vec<Effect> {
        let Some(number) = self.renumber() else {
            return Vec::new();
        };
        if let Some(job) = &mut self.job {
            job.turn = Some(turn);
            job.turning = true;
            job.followed = false;
            job.phase = Phase::Arming { since_s: now_s };
        }
        let turn = Effect::Turn {
            number,
            from,
            angle_rad,
        };
        vec![turn, Effect::Arm(number)]
    }

    /// The safety has ended the drive.
    fn ended(&mut self, seen: &Seen<'_>, tolerances: &Tolerances) -> Vec<Effect> {
        let Some(job) = self.job.as_mut() else {
            return Vec::new();
        };
        let finished = seen.stopped_by == Some(Reason::Finished);
        if finished && !job.followed {
            // The drive before had come to its end when this path came.
            job.phase = Phase::Arming {
                since_s: seen.now_s,
            };
            return vec![Effect::Arm(job.number)];
        }
        if finished && job.turning && job.turn == Some(Turn::AtStart) {
            job.turning = false;
            job.phase = Phase::Preparing;
            let number = self.renumber().unwrap_or_default();
            return vec![Effect::Prepare(number)];
        }
        let estimate = seen.decision.and_then(|decision| decision.estimate);
        match estimate.filter(|_| finished) {
            Some(estimate) => self.at_end(seen.now_s, &estimate.pose, tolerances),
            None => {
                let doubt = (StopCause::DriveEnded, explained(seen));
                self.end(seen.now_s, GoalEnd::Aborted, doubt)
            }
        }
    }

    /// The vehicle stands where the path has ended.
    fn at_end(&mut self, now_s: f64, pose: &PlanarPose, tolerances: &Tolerances) -> Vec<Effect> {
        let Some(job) = self.job.as_mut() else {
            return Vec::new();
        };
        let left = GoalError::of(pose, &job.goal);
        let (end, outcome) = if left.within(tolerances.goal_xy_m, tolerances.goal_yaw_rad) {
            (GoalEnd::Succeeded, Outcome::default())
        } else if self.turns.at_goal && !job.turning && left.distance_m <= tolerances.goal_xy_m {
            return self.turn(now_s, Turn::AtGoal, *pose, -left.heading_rad);
        } else {
            let message = format!(
                "the path has ended {:.2} m and {:.2} rad off the goal",
                left.distance_m, left.heading_rad
            );
            (
                GoalEnd::Aborted,
                Outcome::new(code::NO_VALID_CONTROL, message),
            )
        };
        self.end(now_s, end, (StopCause::DriveEnded, outcome))
    }
}

#[cfg(test)]
mod tests;
