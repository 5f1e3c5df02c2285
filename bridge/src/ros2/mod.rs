//! What the ROS 2 side of a controller and of a virtual vehicle share: a node made from
//! `--ros-args` and the environment, messages, qualities of service, and conversions.
//!
//! ROS 2 is spoken by `ros2-client` over RustDDS; no ROS installation is needed.

pub mod arguments;
pub mod convert;
pub mod message;
pub mod names;
pub mod node;
pub mod parameter_file;
pub mod qos;
