//! What a goal session sees in one step, and what it requests.

use super::obstacles::{Doubt, ObstacleSettings, Surroundings};
use super::outcome::Outcome;
use crate::node::goals::GoalEnd;
use crate::node::peers::ClientId;
use ros2_client::action::GoalId;
use sidehill_bridge::control_loop::channel::PathCommand;
use sidehill_bridge::ros2::settings::server::Tolerances;
use sidehill_bridge::ros2::transforms::Transforms;
use sidehill_bridge::safety::{Reason, SafetyState, StopCause};
use sidehill_controller::controller::Decision;
use sidehill_plant::frames::PlanarPose;

/// Who has sent a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum PathSource {
    /// The client of a goal.
    Goal {
        /// The goal.
        id: GoalId,
        /// Who has sent it.
        client: ClientId,
    },
    /// The operator: the path is the route of the configuration.
    Route,
    /// Nobody: the path is that of the topic.
    None,
}

/// What a session knows about obstacles.
#[derive(Clone)]
pub(crate) struct ObstacleContext<'a> {
    /// Settings of the check.
    pub(crate) settings: &'a ObstacleSettings,
    /// The costmap where it is, or why it is not used.
    pub(crate) seen: Result<Surroundings<'a>, Doubt>,
}

/// What a session sees: the newest state of the control loop and of the inputs.
#[derive(Clone)]
pub(crate) struct GoalContext<'a> {
    /// Now, s.
    pub(crate) now_s: f64,
    /// Time of the newest control cycle, of which the next three are, s.
    pub(crate) cycle_s: f64,
    /// State of the safety.
    pub(crate) state: SafetyState,
    /// Number of the newest arming that was carried out.
    pub(crate) armed: u64,
    /// Why the last drive ended.
    pub(crate) stopped_by: Option<Reason>,
    /// The newest decision of the controller.
    pub(crate) decision: Option<&'a Decision>,
    /// Predicted poses of that decision, the present first; empty without a plan.
    pub(crate) plan: &'a [PlanarPose],
    /// The check for obstacles; none where no costmap is configured.
    pub(crate) obstacles: Option<ObstacleContext<'a>>,
    /// The known transforms.
    pub(crate) transforms: &'a Transforms,
    /// The tolerances.
    pub(crate) tolerances: &'a Tolerances,
    /// Whether the emergency stop is pressed or silent.
    pub(crate) emergency_stop: Option<StopCause>,
    /// Whether a new publisher of the emergency stop has not sent anything yet: no path is begun.
    pub(crate) estop_unknown: bool,
    /// Whether it has not for so long that a vehicle that drives is stopped.
    pub(crate) estop_unknown_driving: bool,
    /// Why a publisher of the emergency stop cannot be heard.
    pub(crate) estop_incompatible: Option<&'a str>,
    /// Whether the clock has jumped.
    pub(crate) clock_jumped: bool,
}

impl GoalContext<'_> {
    /// Returns whether the drives are disabled.
    pub(crate) fn is_off(&self) -> bool {
        matches!(self.state, SafetyState::Disarmed | SafetyState::Latched)
    }

    /// Returns whether the vehicle is being armed or drives.
    pub(crate) fn is_under_way(&self) -> bool {
        matches!(
            self.state,
            SafetyState::Zeroing | SafetyState::Enabling | SafetyState::Driving
        )
    }

    /// Returns whether a control cycle after `since_s` has seen the vehicle stopped: only such a cycle can
    /// have seen a stop that was requested then.
    pub(crate) fn has_stopped_since(&self, since_s: f64) -> bool {
        self.is_off() && self.cycle_s > since_s
    }
}

/// A request of a session.
pub(crate) enum Request {
    /// Give the controller a path in the frame of the odometry, or none.
    Follow(Option<PathCommand>),
    /// Arm under this number; 0 withdraws the request.
    Arm(u64),
    /// Stop for this cause and stay stopped, or no longer.
    Stop(Option<StopCause>),
    /// Write a warning to the log.
    Warn(String),
    /// Tell a client how its goal has ended.
    Finish {
        /// The client.
        client: PathSource,
        /// How it has ended.
        end: GoalEnd,
        /// Code and message.
        outcome: Outcome,
    },
}

/// The requests of a step, in order, and what they leave behind.
#[derive(Default)]
pub(crate) struct StepRequests {
    pending: Vec<Request>,
    stop: Option<StopCause>,
    last_number: u64,
}

impl StepRequests {
    /// Returns a number that was not used before.
    pub(crate) fn next_number(&mut self) -> u64 {
        self.last_number += 1;
        self.last_number
    }

    /// Returns the stop that is requested.
    pub(crate) fn stop_cause(&self) -> Option<StopCause> {
        self.stop
    }

    /// Requests a stop, or withdraws it.
    pub(crate) fn stop(&mut self, cause: Option<StopCause>) {
        self.stop = cause;
        self.push(Request::Stop(cause));
    }

    /// Adds a request.
    pub(crate) fn push(&mut self, request: Request) {
        self.pending.push(request);
    }

    /// Returns all requests since the last call.
    pub(crate) fn take(&mut self) -> Vec<Request> {
        std::mem::take(&mut self.pending)
    }
}
