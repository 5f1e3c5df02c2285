//! Slope-corrected odometry from tread speeds and attitude alone, as a node: no pose, no path, no drives.
//!
//! ```text
//! treads, attitude -> port::inputs (thread) -> DeadReckoning -> nav_msgs/Odometry, odom -> base_link
//! ```

mod dead_reckoning;
mod node;

pub use node::{OdometryNode, OdometrySetup};
