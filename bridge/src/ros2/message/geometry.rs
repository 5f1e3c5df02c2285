//! geometry_msgs and tf2_msgs: metres, radians, m/s and rad/s.

use super::standard::Header;
use super::wire;

/// 6 x 6 covariance over x, y, z and rotations about them, row by row.
pub type Covariance6 = [[f64; 6]; 6];

/// A rotation; the default is none.
#[derive(Debug, Clone, Copy, PartialEq, serde::Serialize, serde::Deserialize)]
#[allow(missing_docs)]
pub struct Quaternion {
    pub x: f64,
    pub y: f64,
    pub z: f64,
    pub w: f64,
}

impl Default for Quaternion {
    fn default() -> Self {
        Self {
            x: 0.0,
            y: 0.0,
            z: 0.0,
            w: 1.0,
        }
    }
}

wire! {
    /// A place, m.
    Point { x: f64, y: f64, z: f64 }
    /// A vector.
    Vector3 { x: f64, y: f64, z: f64 }
    /// Place and rotation.
    Pose { position: Point, orientation: Quaternion }
    /// A rotation at a time in a frame.
    QuaternionStamped = "geometry_msgs" / "QuaternionStamped" { header: Header, quaternion: Quaternion }
    /// A pose at a time in a frame.
    PoseStamped = "geometry_msgs" / "PoseStamped" { header: Header, pose: Pose }
    /// A pose and how sure it is.
    PoseWithCovariance { pose: Pose, covariance: Covariance6 }
    /// The same at a time in a frame.
    PoseWithCovarianceStamped = "geometry_msgs" / "PoseWithCovarianceStamped" {
        header: Header,
        pose: PoseWithCovariance,
    }
    /// Velocity, m/s and rad/s.
    Twist = "geometry_msgs" / "Twist" { linear: Vector3, angular: Vector3 }
    /// Velocity at a time in a frame.
    TwistStamped = "geometry_msgs" / "TwistStamped" { header: Header, twist: Twist }
    /// Velocity and how sure it is.
    TwistWithCovariance { twist: Twist, covariance: Covariance6 }
    /// From the child's coordinates to the frame's.
    Transform { translation: Vector3, rotation: Quaternion }
    /// A transform at a time between two frames.
    TransformStamped { header: Header, child_frame_id: String, transform: Transform }
    /// Transforms, as on /tf and /tf_static.
    TfMessage = "tf2_msgs" / "TFMessage" { transforms: Vec<TransformStamped> }
}
