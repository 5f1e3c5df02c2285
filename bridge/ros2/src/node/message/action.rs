//! nav2_msgs/FollowPath, which differs by distribution.

use super::wire;
use sidehill_bridge::ros2::message::{Empty, Path};

/// Error codes of FollowPath, from iron on.
pub mod code {
    /// Success.
    pub const NONE: u16 = 0;
    /// No other code fits.
    pub const UNKNOWN: u16 = 100;
    /// The requested controller, goal checker or progress checker does not exist.
    pub const INVALID_CONTROLLER: u16 = 101;
    /// A transform is missing or stale.
    pub const TF_ERROR: u16 = 102;
    /// The path cannot be followed.
    pub const INVALID_PATH: u16 = 103;
    /// The controller failed for longer than tolerated.
    pub const PATIENCE_EXCEEDED: u16 = 104;
    /// The vehicle makes no progress.
    pub const FAILED_TO_MAKE_PROGRESS: u16 = 105;
    /// The controller found no valid command.
    pub const NO_VALID_CONTROL: u16 = 106;
    /// The controller took too long; from jazzy on.
    pub const CONTROLLER_TIMED_OUT: u16 = 107;
}

wire! {
    /// Goal of humble.
    FollowPathGoalHumble { path: Path, controller_id: String, goal_checker_id: String }
    /// Goal of iron, jazzy and kilted.
    FollowPathGoal {
        path: Path,
        controller_id: String,
        goal_checker_id: String,
        progress_checker_id: String,
    }
    /// Result of humble.
    FollowPathResultHumble { result: Empty }
    /// Result of iron.
    FollowPathResultIron { result: Empty, error_code: u16 }
    /// Result of jazzy and kilted.
    FollowPathResult { result: Empty, error_code: u16, error_msg: String }
    /// Feedback of all: m along the path, m/s.
    FollowPathFeedback { distance_to_goal: f32, speed: f32 }
}
