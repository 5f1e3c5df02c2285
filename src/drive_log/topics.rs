//! The meaning of a bag's topics.

use crate::config::{ConfigError, ConfigFile};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};
use sidehill_plant::log::Reversed;

/// Topics of tread speeds, attitude and poses in a bag. A source or topic that is left out is found by its type, if
/// there is exactly one of it.
///
/// ```yaml
/// tread_speeds: { kind: joint_states, topic: /joint_states, left: [front_left], right: [front_right], radius_m: 0.165 }
/// attitude: { kind: imu, topic: /imu/data }
/// pose: { kind: odometry, topic: /lidar/odometry }
/// time: stamp
/// base_frame: base_link
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TopicMap {
    /// Source of the [tread speeds](#tread-speeds-of-a-bag).
    pub tread_speeds: TreadSpeedTopic,
    /// Source of [roll and pitch](#attitude-of-a-bag). None: the only sensor_msgs/Imu.
    #[serde(default)]
    pub attitude: Option<AttitudeTopic>,
    /// Source of the [poses](#poses-of-a-bag). None: the only nav_msgs/Odometry, without one the only
    /// sensor_msgs/NavSatFix.
    #[serde(default)]
    pub pose: Option<PoseTopic>,
    /// Source of the [commands](#commands-of-a-bag), for `identify --drives`.
    #[serde(default)]
    pub commands: Option<CommandTopic>,
    /// Which time of a message counts: that of its header, or of recording.
    #[serde(default)]
    pub time: StampSource,
    /// Frame of the vehicle: poses of `tf` are its own, and `/tf_static` tells how the Imu is mounted in it.
    #[serde(default = "base_link")]
    pub base_frame: String,
    /// Added to the headings of the poses: by how much the antennas that measure them are turned clockwise.
    #[serde(default)]
    pub heading_offset_deg: f64,
}

/// Which time of a message counts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StampSource {
    /// That of its header.
    #[default]
    Stamp,
    /// When the recorder got it.
    Received,
}

/// Source of the tread speeds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum TreadSpeedTopic {
    /// Velocities of wheel joints, sensor_msgs/JointState.
    JointStates {
        /// sensor_msgs/JointState.
        #[serde(default)]
        topic: Option<String>,
        /// Joints of the left side, whose mean counts. Empty: wheels whose names say so, such as `left_wheel`,
        /// `fl_wheel` and `lf_motor`.
        #[serde(default)]
        left: Vec<String>,
        /// Joints of the right side. Empty: wheels whose names say so.
        #[serde(default)]
        right: Vec<String>,
        /// Tread speed divided by joint velocity: the radius of a wheel.
        radius_m: f64,
        /// Side whose joints count backwards.
        #[serde(default)]
        reversed: Reversed,
    },
    /// Twist of wheel odometry, nav_msgs/Odometry.
    Odometry {
        /// nav_msgs/Odometry of the wheels: its twist must come from the encoders alone.
        #[serde(default)]
        topic: Option<String>,
        /// Track width by which the base turned wheel speeds into that twist.
        track_width_m: f64,
    },
}

/// Source of the commands: geometry_msgs/Twist or TwistStamped.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CommandTopic {
    /// Topic.
    pub topic: String,
    /// Track width by which the base turns a twist into tread speeds.
    pub track_width_m: f64,
}

/// Source of roll and pitch.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum AttitudeTopic {
    /// Orientation of sensor_msgs/Imu.
    Imu {
        /// sensor_msgs/Imu.
        #[serde(default)]
        topic: Option<String>,
        /// Axes of the orientation: of REP-103, of aviation (north, east, down), or of REP-103 with the Imu turned by
        /// 180 deg about its x axis.
        #[serde(default)]
        axes: ImuAxes,
    },
    /// Orientation of geometry_msgs/PoseStamped or PoseWithCovarianceStamped.
    PoseStamped {
        /// geometry_msgs/PoseStamped or PoseWithCovarianceStamped.
        #[serde(default)]
        topic: Option<String>,
    },
    /// Orientation of the vehicle's frame on `/tf` and `/tf_static`.
    Tf {
        /// Frame whose z axis is up, such as `map`.
        frame: String,
    },
    /// Orientation of nav_msgs/Odometry.
    Odometry {
        /// nav_msgs/Odometry.
        #[serde(default)]
        topic: Option<String>,
    },
    /// No topic: the ground was level. Braces, as a variant without them would take any key.
    Level {},
}

/// Axes of an Imu's orientation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImuAxes {
    /// Those of REP-103: x forward, y left, z up in a world of east, north and up.
    #[default]
    Enu,
    /// Those of aviation: x forward, y right, z down in a world of north, east and down.
    Ned,
    /// Those of REP-103, of an Imu that hangs upside down: turned by 180 deg about its x axis.
    UpsideDown,
}

/// Source of the poses.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case", deny_unknown_fields)]
pub enum PoseTopic {
    /// Pose of nav_msgs/Odometry.
    Odometry {
        /// nav_msgs/Odometry: from a better source than the wheels.
        #[serde(default)]
        topic: Option<String>,
    },
    /// Pose of geometry_msgs/PoseStamped or PoseWithCovarianceStamped.
    PoseStamped {
        /// geometry_msgs/PoseStamped or PoseWithCovarianceStamped.
        #[serde(default)]
        topic: Option<String>,
    },
    /// The vehicle's frame on `/tf` and `/tf_static`.
    Tf {
        /// Frame in which the poses are, such as `map`.
        frame: String,
    },
    /// Positions of sensor_msgs/NavSatFix, projected to the plane that touches WGS 84 at the first fix, with the
    /// heading of an Imu.
    Navsat {
        /// sensor_msgs/NavSatFix.
        #[serde(default)]
        topic: Option<String>,
        /// sensor_msgs/Imu for the heading; its yaw is 0 towards east (REP-103).
        #[serde(default)]
        heading_topic: Option<String>,
        /// The antenna, forward of the vehicle's origin.
        #[serde(default)]
        antenna_forward_m: f64,
        /// The antenna, to the left of it.
        #[serde(default)]
        antenna_left_m: f64,
        /// The antenna, above it.
        #[serde(default)]
        antenna_up_m: f64,
    },
    /// None.
    None {},
}

fn base_link() -> String {
    "base_link".to_owned()
}

impl TopicMap {
    /// Reads a map.
    ///
    /// # Errors
    /// Names the file, key and range.
    pub fn read(file: &ConfigFile) -> Result<Self, ConfigError> {
        let map: Self = file.parse()?;
        map.validate().map_err(|error| file.error(error))?;
        Ok(map)
    }

    fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(-180.0, 180.0, "deg").check("heading_offset_deg", self.heading_offset_deg)?;
        match self.tread_speeds {
            TreadSpeedTopic::JointStates { radius_m, .. } => {
                let key = "tread_speeds.radius_m";
                Bounds::new(0.01, 10.0, "m").check(key, radius_m)?;
            }
            TreadSpeedTopic::Odometry { track_width_m, .. } => {
                let key = "tread_speeds.track_width_m";
                Bounds::new(0.05, 20.0, "m").check(key, track_width_m)?;
            }
        }
        if let Some(commands) = &self.commands {
            let key = "commands.track_width_m";
            Bounds::new(0.05, 20.0, "m").check(key, commands.track_width_m)?;
        }
        if let Some(PoseTopic::Navsat {
            antenna_forward_m,
            antenna_left_m,
            antenna_up_m,
            ..
        }) = self.pose
        {
            for (key, value) in [
                ("pose.antenna_forward_m", antenna_forward_m),
                ("pose.antenna_left_m", antenna_left_m),
                ("pose.antenna_up_m", antenna_up_m),
            ] {
                Bounds::new(-20.0, 20.0, "m").check(key, value)?;
            }
        }
        Ok(())
    }
}
