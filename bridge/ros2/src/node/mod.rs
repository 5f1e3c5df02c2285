//! A ROS 2 node on `ros2-client`: what `rclcpp` would give on top of it.
//!
//! | module | what it does |
//! |---|---|
//! | [`parameter_file`] | `--params-file` |
//! | [`qos`] | quality-of-service profiles |
//! | [`parameters`], [`lifecycle`], [`services`] | a managed node with its parameter and lifecycle services |
//! | [`action`], [`goals`] | an action server that keeps its results |
//! | [`time`] | the time of the graph |
//! | [`peers`], [`subscription`], [`demanded`], [`worker`] | discovery, non-blocking reads, publishing on demand, threads |
//!
//! Nothing in here depends on the rest of this crate. Names, arguments, messages and transforms, which need no middleware,
//! are [`sidehill_bridge::ros2`]'s.
//!
//! Upstream, these accessors are missing from `ros2-client` 0.12: `CancelGoalRequest` hides which goals it
//! names; an action server cannot answer a result twice; `Node` cannot offer parameter services under
//! Cyclone's service mapping; RustDDS has no setting for the samples kept of a topic.

pub mod action;
pub mod demanded;
pub mod goals;
pub mod lifecycle;
pub mod message;
pub mod parameter_file;
pub mod parameters;
pub mod peers;
pub mod qos;
mod ros_node;
pub mod services;
pub mod subscription;
pub mod time;
pub mod worker;

pub use ros_node::{NodeError, RosNode};
