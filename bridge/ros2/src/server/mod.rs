//! A controller server for `nav2_msgs/FollowPath`.
//!
//! ```text
//! FollowPath goal -> RequestedPath -> Route -> PathCommand -> controller
//! ```
//!
//! One [`goal_session`] owns a goal from its acceptance to its result. One thread serves the action, the
//! parameters and the lifecycle; neither the control loop nor the controller waits for it.

mod action_topic;
pub mod checkers;
mod configured_route;
mod controller_server;
mod diagnostics;
mod follow_path;
mod goal_context;
mod goal_handler;
pub mod goal_session;
mod live_parameters;
pub mod obstacles;
pub mod outcome;
pub mod parameters;
mod path_frame;
mod pivot_slide;
pub mod requested_path;
pub mod route;
mod start;
mod telemetry;
mod termination;
#[cfg(test)]
pub(crate) mod test_data;
pub mod way_round;

pub use configured_route::ConfiguredRoute;
pub use start::{Ros2, Ros2Inputs, Ros2Server, ServerSetup, StartError, start};
