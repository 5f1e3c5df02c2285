//! ROS 2 messages as on the wire: plain structs with the fields of their `.msg` files in order.
//!
//! DDS has no empty structs: an empty message is one byte.

pub mod cdr;
pub mod diagnostic;
pub mod geometry;
pub mod nav;
pub mod sensor;
pub mod standard;

pub use diagnostic::{DiagnosticArray, DiagnosticStatus, KeyValue};
pub use geometry::{
    Covariance6, Point, Pose, PoseStamped, PoseWithCovariance, PoseWithCovarianceStamped,
    Quaternion, QuaternionStamped, TfMessage, Transform, TransformStamped, Twist, TwistStamped,
    TwistWithCovariance, Vector3,
};
pub use nav::{
    Costmap, CostmapMetaData, CostmapUpdate, MapMetaData, OccupancyGrid, OccupancyGridUpdate,
    Odometry, Path, SpeedLimit, TrackingFeedback,
};
pub use sensor::{Imu, JointState, NavSatFix, NavSatStatus};
pub use standard::{
    Bool, Clock, Empty, Float64, Float64MultiArray, Header, MultiArrayDimension, MultiArrayLayout,
    Text, Time,
};

/// A message of a topic, with the name of its type.
pub trait TopicMessage: serde::Serialize + serde::de::DeserializeOwned {
    /// Package, such as `nav_msgs`.
    const PACKAGE: &'static str;
    /// Type, such as `Odometry`.
    const TYPE: &'static str;
}

/// Defines message structs; with `= "package" / "Type"` they are messages of topics.
#[macro_export]
macro_rules! wire {
    ($($(#[$meta:meta])* $name:ident $(= $package:literal / $type:literal)? { $($field:ident: $kind:ty),* $(,)? })+) => {$(
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Default, serde::Serialize, serde::Deserialize)]
        pub struct $name {
            $(#[allow(missing_docs)] pub $field: $kind),*
        }
        $(impl $crate::ros2::message::TopicMessage for $name {
            const PACKAGE: &'static str = $package;
            const TYPE: &'static str = $type;
        })?
    )+};
}
pub use wire;
