//! Settings of the topics of drives and sensors.

use crate::ros2::joints::TreadJoints;
use nalgebra::Vector3;
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// Names of the coordinate frames.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Frames {
    /// Frame of the poses; the vehicle is controlled in it.
    pub odometry: String,
    /// Frame of the vehicle.
    pub base: String,
}

impl Default for Frames {
    fn default() -> Self {
        Self {
            odometry: "odom".to_owned(),
            base: "base_link".to_owned(),
        }
    }
}

/// Source of roll and pitch.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttitudeSource {
    /// The orientation of an Imu.
    #[default]
    Imu,
    /// The orientation of the odometry, or of [`InputsConfig::pose`].
    Odometry,
}

/// Source of the yaw rate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum YawRateSource {
    /// The angular velocity of an Imu.
    Imu,
    /// Not read. A yaw rate changes how the vehicle drives, so it has to be asked for.
    #[default]
    None,
}

/// Source of the tread speeds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedSource {
    /// The twist of the odometry, by the track width of the commands.
    #[default]
    Odometry,
    /// The velocities of two joints.
    JointStates,
    /// The commands: those of [`CommandsConfig::forwarded`] where they are read, otherwise the program's own.
    Commands,
}

/// Source of the poses.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PoseMessage {
    /// nav_msgs/Odometry, of which the twist is not read.
    #[default]
    Odometry,
    /// geometry_msgs/PoseWithCovarianceStamped, of the frame of the vehicle.
    PoseWithCovarianceStamped,
    /// `/tf`: the frame of the vehicle in that of the poses.
    Transform,
    /// sensor_msgs/NavSatFix: the place of an antenna.
    NavSatFix,
}

/// Poses from another topic than the speeds.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct PoseConfig {
    /// Topic. Its poses are those of `frames.base` in `frames.odometry`. Leave it out with `type: transform`.
    pub topic: String,
    /// nav_msgs/Odometry, of which the twist is not read; geometry_msgs/PoseWithCovarianceStamped; `frames.base` in
    /// `frames.odometry` by `/tf`; or sensor_msgs/NavSatFix, the place of an antenna.
    #[serde(rename = "type")]
    pub message: PoseMessage,
    /// [Source of the heading](#heading-of-fixes) of fixes. None: the motion of the vehicle.
    pub heading: Option<HeadingConfig>,
    /// [Place of the antenna](#antenna) of fixes. None: by TF from the frame of the fixes.
    pub antenna: Option<AntennaConfig>,
}

/// Message of a heading.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum OrientationMessage {
    /// The orientation of a sensor_msgs/Imu.
    #[default]
    Imu,
    /// geometry_msgs/QuaternionStamped.
    QuaternionStamped,
}

/// The heading of two antennas or of an IMU that knows north.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct HeadingConfig {
    /// Topic; required.
    pub topic: String,
    /// The orientation of a sensor_msgs/Imu, or geometry_msgs/QuaternionStamped.
    #[serde(rename = "type")]
    pub message: OrientationMessage,
    /// Added to the heading: by how much the antennas that measure it are turned clockwise. None: by TF from the frame
    /// of the message.
    pub offset_deg: Option<f64>,
    /// Whether the angle counts clockwise from north, as nmea_navsat_driver has it, rather than counter-clockwise from
    /// east.
    pub compass: bool,
}

/// Place of an antenna in the frame of the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct AntennaConfig {
    /// Forward of the origin.
    pub forward_m: f64,
    /// To the left of it.
    pub left_m: f64,
    /// Above it.
    pub up_m: f64,
}

impl AntennaConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        for (key, value) in [
            ("antenna.forward_m", self.forward_m),
            ("antenna.left_m", self.left_m),
            ("antenna.up_m", self.up_m),
        ] {
            Bounds::new(-20.0, 20.0, "m").check(key, value)?;
        }
        Ok(())
    }

    /// Returns the place in base_link, m.
    pub fn in_base(&self) -> Vector3<f64> {
        Vector3::new(self.forward_m, self.left_m, self.up_m)
    }
}

impl PoseConfig {
    /// Checks ranges, and that a topic and nothing without effect is given.
    ///
    /// # Errors
    /// The key and what is wrong.
    pub fn validate(&self) -> Result<(), String> {
        let is_fix = self.message == PoseMessage::NavSatFix;
        let is_transform = self.message == PoseMessage::Transform;
        if self.topic.is_empty() != is_transform {
            return Err(match is_transform {
                true => "ros2.inputs.pose.topic: a transform is on /tf, leave it out",
                false => "ros2.inputs.pose.topic: it is missing",
            }
            .to_owned());
        }
        for (key, given) in [
            ("heading", self.heading.is_some()),
            ("antenna", self.antenna.is_some()),
        ] {
            if given && !is_fix {
                return Err(format!(
                    "ros2.inputs.pose.{key}: it is for type: nav_sat_fix only"
                ));
            }
        }
        if let Some(heading) = &self.heading {
            if heading.topic.is_empty() {
                return Err("ros2.inputs.pose.heading.topic: it is missing".to_owned());
            }
            Bounds::new(-180.0, 180.0, "deg")
                .check(
                    "ros2.inputs.pose.heading.offset_deg",
                    heading.offset_deg.unwrap_or(0.0),
                )
                .map_err(|error| error.to_string())?;
        }
        self.antenna
            .unwrap_or_default()
            .validate()
            .map_err(|error| format!("ros2.inputs.pose.{error}"))
    }
}

/// Topics that are subscribed to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputsConfig {
    /// nav_msgs/Odometry: poses, and speeds from its twist.
    pub odometry: String,
    /// [Poses from another topic](#poses) than the speeds. With `port: ros2` only.
    pub pose: Option<PoseConfig>,
    /// sensor_msgs/Imu.
    pub imu: String,
    /// sensor_msgs/JointState.
    pub joint_states: String,
    /// Source of roll and pitch: the Imu, or the orientation of odometry; with `pose` that of its message.
    pub attitude: AttitudeSource,
    /// Source of the [yaw rate](ros2.md#the-yaw-rate-of-an-imu): the angular velocity of the Imu. With `port: ros2`
    /// only.
    pub yaw_rate: YawRateSource,
    /// Source of the tread speeds: the twist of odometry, two joints, or the commands, where there is nothing else:
    /// those of `commands.forwarded` if given, otherwise Sidehill's own.
    pub speeds: SpeedSource,
    /// [Joints](#joints) of the treads.
    pub joints: TreadJoints,
    /// std_msgs/Bool, true while the emergency stop is pressed.
    pub emergency_stop: String,
    /// Silence of the emergency stop that counts as pressed; 0 for a stop that is published on changes only.
    pub emergency_stop_timeout_s: f64,
    /// nav_msgs/Path, transient local, followed as soon as it arrives.
    pub path: String,
    /// nav2_msgs/SpeedLimit.
    pub speed_limit: String,
}

impl Default for InputsConfig {
    fn default() -> Self {
        Self {
            odometry: "odom".to_owned(),
            pose: None,
            imu: "imu".to_owned(),
            joint_states: "joint_states".to_owned(),
            attitude: AttitudeSource::default(),
            yaw_rate: YawRateSource::default(),
            speeds: SpeedSource::default(),
            joints: TreadJoints::default(),
            emergency_stop: "emergency_stop".to_owned(),
            emergency_stop_timeout_s: 0.0,
            path: String::new(),
            speed_limit: "speed_limit".to_owned(),
        }
    }
}

/// Commands to the drives; each that is given is published.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandsConfig {
    /// [As a twist](#twist-commands). This is the default.
    pub twist: Option<TwistConfig>,
    /// [As velocities of the treads' joints](#tread-commands).
    pub treads: Option<TreadsConfig>,
    /// [As the speeds of two motors](#motor-commands).
    pub motors: Option<MotorsConfig>,
    /// [The command that reaches the drives](#twist-commands), where a collision monitor or smoother may slow it down:
    /// feedback is compared with it. Listened to, not published.
    pub forwarded: Option<TwistConfig>,
    /// Track width by which a differential-drive base converts between twist and tread speeds. None: the distance of
    /// the vehicle's tread ICRs.
    pub track_width_m: Option<f64>,
}

impl Default for CommandsConfig {
    fn default() -> Self {
        Self {
            twist: Some(TwistConfig::default()),
            treads: None,
            motors: None,
            forwarded: None,
            track_width_m: None,
        }
    }
}

/// cmd_vel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TwistConfig {
    /// Topic.
    pub topic: String,
    /// Publish geometry_msgs/TwistStamped instead of Twist.
    pub stamped: bool,
}

impl Default for TwistConfig {
    fn default() -> Self {
        Self {
            topic: "cmd_vel".to_owned(),
            stamped: false,
        }
    }
}

/// std_msgs/Float64MultiArray of the velocities of the left and the right joint.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TreadsConfig {
    /// Topic.
    pub topic: String,
    /// [The joints](#joints).
    pub joints: TreadJoints,
}

/// std_msgs/Float64 for each motor, m/s.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorsConfig {
    /// Topic of the traction.
    pub traction: String,
    /// Topic of the steer.
    pub steer: String,
}
