//! What sensors deliver to the controller in one cycle.

use crate::frames::{Attitude, Pose};
use crate::speeds::MeasuredTreadSpeeds;
use serde::{Deserialize, Serialize};

/// A reading with the instant at which it was true, which is earlier than when it arrived.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Stamped<T> {
    /// Instant of the reading on the cycle's clock, s.
    pub time_s: f64,
    /// The reading.
    pub value: T,
}

/// Everything that reached the controller since its previous cycle.
///
/// A field is `None` where no new reading arrived; an old reading is not repeated.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Sample {
    /// Instant of this cycle, s.
    pub time_s: f64,
    /// Newest tread speeds, as measured (before c_l, c_r).
    pub tread_speeds: Option<Stamped<MeasuredTreadSpeeds>>,
    /// Newest roll and pitch.
    pub attitude: Option<Stamped<Attitude>>,
    /// Newest yaw rate about the body's upward axis, rad/s, counter-clockwise positive, as a gyroscope reads it.
    #[serde(default)]
    pub yaw_rate: Option<Stamped<f64>>,
    /// Newest pose in the world, possibly late.
    pub pose: Option<Stamped<Pose>>,
}
