//! What the executive is asked, what it sees, and what it wants done.

use super::{GoalEnd, Outcome, Reason, SafetyState, StopCause};
use ros2_client::action::GoalId;
use sidehill_controller::controller::Decision;
use sidehill_plant::frames::PlanarPose;

/// Who wants a path driven.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Client {
    /// A goal of the action.
    Goal(GoalId),
    /// The topic.
    Topic,
}

/// What shall happen.
#[derive(Debug, Clone, PartialEq)]
pub enum Effect {
    /// Arm under this number; 0 takes a wish back.
    Arm(u64),
    /// Stop for this cause and stay so, or no longer.
    Stop(Option<StopCause>),
    /// Tell how it has ended.
    Told(Client, GoalEnd, Outcome),
    /// Give the controller nothing to follow any more.
    Clear,
    /// Prepare the path in hand again, under this number.
    Prepare(u64),
    /// Give the controller a turn on the spot.
    Turn {
        /// Number of the turn.
        number: u64,
        /// Where the vehicle stands.
        from: PlanarPose,
        /// By how much it turns, rad, counter-clockwise.
        angle_rad: f64,
    },
}

/// What the executive looks at.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// Now, s.
    pub now_s: f64,
    /// Time of the cycle that the next three are of, s.
    pub cycle_s: f64,
    /// State of the safety.
    pub state: SafetyState,
    /// Number of the newest arming carried out.
    pub armed: u64,
    /// Why the last drive ended.
    pub stopped_by: Option<Reason>,
    /// The controller's newest decision.
    pub decision: Option<&'a Decision>,
    /// Why the path's frame cannot be brought to that of odometry now.
    pub transform: Option<&'a str>,
    /// Whether the emergency stop is pressed or silent.
    pub emergency_stop: Option<StopCause>,
    /// Whether somebody has come who may press it and has not been heard.
    pub emergency_stop_awaited: bool,
    /// Whether the clock has jumped.
    pub clock_jumped: bool,
    /// Whether the goal's client has left the graph.
    pub client_lost: bool,
}

/// Where the vehicle turns on the spot.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Turns {
    /// Where a path leads off behind it.
    pub at_start: bool,
    /// Where the path has ended and the goal's heading is another.
    pub at_goal: bool,
}
