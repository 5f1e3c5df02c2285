//! What the ROS 2 side of a controller and of a virtual vehicle share: a node made from
//! `--ros-args` and the environment, messages, qualities of service, and conversions.
//!
//! ROS 2 is spoken by `ros2-client` over RustDDS; no ROS installation is needed.

pub mod arguments;
pub mod checkers;
pub mod config;
pub mod convert;
mod emergency_stop;
pub mod executive;
mod follow_path;
pub mod goals;
mod inputs;
pub mod lifecycle;
pub mod message;
pub mod names;
pub mod node;
pub mod parameter_file;
pub mod parameters;
mod paths;
mod peers;
mod port;
pub mod qos;
pub mod route;
pub mod server;
mod services;
mod telemetry;
pub mod time;
pub mod transform;
pub mod vehicle;
mod worker;

pub use inputs::ListenError;
pub use port::Ros2Port;
