//! A controller server and a virtual rover on the ROS 2 graph, without a ROS installation:
//! `ros2-client` over RustDDS is compiled in.
//!
//! ```text
//! client   sends goals to a server
//! server   FollowPath: goals, parameters, telemetry
//! odometry slope-corrected odometry without a controller
//! positions where the vehicle is, for recording a path
//! port     drives and sensors over topics
//! node     what rclcpp would give: names, arguments, QoS, parameters, lifecycle, time, transforms
//! ```
//!
//! Each part uses those below it only.

pub mod client;
pub mod node;
pub mod odometry;
pub mod port;
pub mod positions;
pub mod server;
