//! A ROS 2 node on `ros2-client`: what `rclcpp` would give on top of it.
//!
//! | module | what it does |
//! |---|---|
//! | [`arguments`], [`parameter_file`] | `--ros-args`, environment variables, `--params-file` |
//! | [`names`], [`qos`] | names with namespaces and remaps, quality-of-service profiles |
//! | [`parameters`], [`lifecycle`], [`services`] | a managed node with its parameter and lifecycle services |
//! | [`action`], [`goals`] | an action server that keeps its results |
//! | [`time`], [`transforms`], [`conversions`] | stamps, interpolated transforms, `nalgebra` |
//! | [`peers`], [`subscription`], [`demanded`], [`worker`] | discovery, non-blocking reads, publishing on demand, threads |
//!
//! Nothing in here depends on the rest of this crate.
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
