//! What is known of ROS 2 without a middleware: messages, conversions, names, arguments and settings.
//!
//! Programs that read bags or check configurations need no more; the crate `sidehill-ros2` puts it on the graph.

pub mod arguments;
pub mod conversions;
pub mod convert;
pub mod joints;
pub mod message;
pub mod names;
pub mod odometry;
pub mod position;
pub mod rover;
pub mod settings;
pub mod transforms;

/// Topic, std_msgs/String, of the actions that a vehicle passes on its route.
pub const ROUTE_ACTION: &str = "route_action";
