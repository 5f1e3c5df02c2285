//! nav_msgs, map_msgs, and of nav2_msgs what is a topic.

use super::geometry::{Pose, PoseStamped, PoseWithCovariance, TwistWithCovariance};
use super::standard::{Header, Time};
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
    /// Largest speed, m/s or per cent of the largest; 0 means no limit.
    SpeedLimit = "nav2_msgs" / "SpeedLimit" { header: Header, percentage: bool, speed_limit: f64 }
    /// Where the vehicle is on its path: positive to the left of it, and with a heading to the right of its.
    TrackingFeedback = "nav2_msgs" / "TrackingFeedback" {
        header: Header,
        position_tracking_error: f32,
        heading_tracking_error: f32,
        current_path_index: u32,
        robot_pose: PoseStamped,
        distance_to_goal: f32,
        speed: f32,
        remaining_path_length: f32,
    }
    /// Size and place of an [`OccupancyGrid`].
    MapMetaData {
        map_load_time: Time,
        resolution: f32,
        width: u32,
        height: u32,
        origin: Pose,
    }
    /// Costs from 0 to 100, row by row; -1 is unknown.
    OccupancyGrid = "nav_msgs" / "OccupancyGrid" {
        header: Header,
        info: MapMetaData,
        data: Vec<i8>,
    }
    /// Part of an [`OccupancyGrid`] that has changed.
    OccupancyGridUpdate = "map_msgs" / "OccupancyGridUpdate" {
        header: Header,
        x: i32,
        y: i32,
        width: u32,
        height: u32,
        data: Vec<i8>,
    }
    /// Size and place of a [`Costmap`].
    CostmapMetaData {
        map_load_time: Time,
        update_time: Time,
        layer: String,
        resolution: f32,
        size_x: u32,
        size_y: u32,
        origin: Pose,
    }
    /// Costs from 0 to 254, row by row; 255 is unknown.
    Costmap = "nav2_msgs" / "Costmap" {
        header: Header,
        metadata: CostmapMetaData,
        data: Vec<u8>,
    }
    /// Part of a [`Costmap`] that has changed.
    CostmapUpdate = "nav2_msgs" / "CostmapUpdate" {
        header: Header,
        x: u32,
        y: u32,
        size_x: u32,
        size_y: u32,
        data: Vec<i8>,
    }
}
