//! Settings of the odometry node.

use crate::ros2::joints::TreadJoints;
use crate::ros2::settings::topics::{AttitudeSource, Frames, InputsConfig, SpeedSource};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// The `ros2:` section of `sidehill odometry --live`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct OdometryConfig {
    /// Name of the node. `--ros-args -r __node:=NAME` overrides it.
    pub node: String,
    /// [Frames](#frames) of the wheel odometry and of the result.
    pub frames: Frames,
    /// nav_msgs/Odometry, the result.
    pub topic: String,
    /// Whether to publish the transform from `frames.odometry` to `frames.base` too.
    pub publish_transform: bool,
    /// nav_msgs/Odometry of the wheels, of which the twist is used, with `speeds: odometry`.
    pub odometry: String,
    /// sensor_msgs/Imu.
    pub imu: String,
    /// sensor_msgs/JointState, with `speeds: joint_states`.
    pub joint_states: String,
    /// Source of roll and pitch.
    pub attitude: AttitudeSource,
    /// Source of the tread speeds.
    pub speeds: SpeedSource,
    /// [Joints](#joints) of the treads.
    pub joints: TreadJoints,
    /// Track width by which the base computes a twist from tread speeds. None: the distance of the vehicle's tread
    /// ICRs.
    pub track_width_m: Option<f64>,
    /// Longest gap in the readings that is integrated over.
    pub timeout_s: f64,
    /// Whether time comes from `/clock`.
    pub use_sim_time: bool,
}

impl Default for OdometryConfig {
    fn default() -> Self {
        let inputs = InputsConfig::default();
        Self {
            node: "slope_odometry".to_owned(),
            frames: Frames::default(),
            topic: "~/odometry".to_owned(),
            publish_transform: false,
            odometry: inputs.odometry,
            imu: inputs.imu,
            joint_states: inputs.joint_states,
            attitude: inputs.attitude,
            speeds: inputs.speeds,
            joints: inputs.joints,
            track_width_m: None,
            timeout_s: 0.5,
            use_sim_time: false,
        }
    }
}

impl OdometryConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.05, 5.0, "s").check("ros2.timeout_s", self.timeout_s)?;
        self.joints.validate()
    }

    /// Returns the topics as those of a port.
    pub fn inputs(&self) -> InputsConfig {
        InputsConfig {
            odometry: self.odometry.clone(),
            imu: self.imu.clone(),
            joint_states: self.joint_states.clone(),
            attitude: self.attitude,
            speeds: self.speeds,
            joints: self.joints.clone(),
            ..InputsConfig::default()
        }
    }
}
