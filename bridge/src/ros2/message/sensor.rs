//! sensor_msgs.

use super::geometry::{Quaternion, Vector3};
use super::standard::Header;
use super::wire;

wire! {
    /// Orientation, rad/s and m/s^2 in the header's frame; covariances are row by row.
    Imu = "sensor_msgs" / "Imu" {
        header: Header,
        orientation: Quaternion,
        orientation_covariance: [f64; 9],
        angular_velocity: Vector3,
        angular_velocity_covariance: [f64; 9],
        linear_acceleration: Vector3,
        linear_acceleration_covariance: [f64; 9],
    }
    /// Angle, rad, velocity, rad/s, and torque, N m, of each joint, or none of a kind.
    JointState = "sensor_msgs" / "JointState" {
        header: Header,
        name: Vec<String>,
        position: Vec<f64>,
        velocity: Vec<f64>,
        effort: Vec<f64>,
    }
    /// Kind of a fix: `status` is -1 without one.
    NavSatStatus { status: i8, service: u16 }
    /// Latitude and longitude on WGS 84, deg, and height above its ellipsoid, m.
    NavSatFix = "sensor_msgs" / "NavSatFix" {
        header: Header,
        status: NavSatStatus,
        latitude: f64,
        longitude: f64,
        altitude: f64,
        position_covariance: [f64; 9],
        position_covariance_type: u8,
    }
}
