//! nav_msgs, and of nav2_msgs what is a topic.

use super::geometry::{PoseStamped, PoseWithCovariance, TwistWithCovariance};
use super::standard::Header;
use super::wire;

wire! {
    /// Pose in the header's frame and velocity in the child's.
    Odometry = "nav_msgs" / "Odometry" {
        header: Header,
        child_frame_id: String,
        pose: PoseWithCovariance,
        twist: TwistWithCovariance,
    }
    /// A path.
    Path = "nav_msgs" / "Path" { header: Header, poses: Vec<PoseStamped> }
    /// Largest speed, m/s or per cent of the largest; 0 is no limit.
    SpeedLimit = "nav2_msgs" / "SpeedLimit" { header: Header, percentage: bool, speed_limit: f64 }
}
