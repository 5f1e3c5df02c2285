//! Settings of nodes and topics, as in configuration files.

pub mod costmap;
pub mod odometry;
pub mod server;
pub mod topics;
