//! Where a vehicle is, of a topic.

use super::message::{NavSatFix, Odometry};

/// The topic of the positions, by its name before remaps.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum PositionTopic {
    /// nav_msgs/Odometry, of which the pose is used.
    Odometry(String),
    /// sensor_msgs/NavSatFix.
    Fix(String),
}

impl PositionTopic {
    /// Returns the name.
    pub fn name(&self) -> &str {
        match self {
            Self::Odometry(name) | Self::Fix(name) => name,
        }
    }
}

/// A message with a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AnyPosition<'a> {
    /// Pose of the vehicle in the frame of the header.
    Odometry(&'a Odometry),
    /// Place of a satellite receiver's antenna.
    Fix(&'a NavSatFix),
}
