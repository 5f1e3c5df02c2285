//! What the controller offers and listens to on the ROS 2 graph.

use super::convert::TreadJoints;
use serde::{Deserialize, Serialize};
use sidehill_controller::path::Smoothing;
use sidehill_plant::vehicle::RangeError;

/// The `ros2:` section of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2Config {
    /// Name of the node, unless `__node` says otherwise.
    pub node: String,
    /// Frames.
    pub frames: Frames,
    /// What is listened to.
    pub inputs: InputsConfig,
    /// How the drives are told, where the port is ros2.
    pub commands: CommandsConfig,
    /// The action.
    pub follow_path: FollowPathConfig,
    /// How the poses of a path become a curve.
    pub smoothing: Smoothing,
    /// What is tolerated.
    pub tolerances: Tolerances,
    /// Whether time is that of /clock.
    pub use_sim_time: bool,
    /// Whether the node configures and activates itself, as without a lifecycle manager.
    pub autostart: bool,
}

impl Default for Ros2Config {
    fn default() -> Self {
        Self {
            node: "controller_server".to_owned(),
            frames: Frames::default(),
            inputs: InputsConfig::default(),
            commands: CommandsConfig::default(),
            follow_path: FollowPathConfig::default(),
            // Planners mean the corners they draw.
            smoothing: Smoothing {
                max_curvature_per_m: 2.0,
                ..Smoothing::default()
            },
            tolerances: Tolerances::default(),
            use_sim_time: false,
            autostart: true,
        }
    }
}

/// Names of coordinate frames.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Frames {
    /// In which odometry gives poses, and in which is driven.
    pub odometry: String,
    /// The vehicle's own.
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

/// Where roll and pitch come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttitudeSource {
    /// The orientation of an Imu in the vehicle's own frame.
    #[default]
    Imu,
    /// The orientation of odometry.
    Odometry,
}

/// Where the tread speeds come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SpeedSource {
    /// The twist of odometry, by the track width of the commands.
    #[default]
    Odometry,
    /// The velocities of two joints.
    JointStates,
}

/// Topics that are listened to.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct InputsConfig {
    /// nav_msgs/Odometry.
    pub odometry: String,
    /// sensor_msgs/Imu.
    pub imu: String,
    /// sensor_msgs/JointState.
    pub joint_states: String,
    /// Which of them give roll and pitch.
    pub attitude: AttitudeSource,
    /// Which of them give the tread speeds.
    pub speeds: SpeedSource,
    /// The treads' joints.
    pub joints: TreadJoints,
    /// std_msgs/Bool, true where the emergency stop is pressed.
    pub emergency_stop: String,
    /// Oldest word of the emergency stop that is driven on, s; 0 where it speaks only of changes.
    pub emergency_stop_timeout_s: f64,
    /// Latched nav_msgs/Path that is followed as soon as it comes; none where empty.
    pub path: String,
    /// nav2_msgs/SpeedLimit.
    pub speed_limit: String,
}

impl Default for InputsConfig {
    fn default() -> Self {
        Self {
            odometry: "odom".to_owned(),
            imu: "imu".to_owned(),
            joint_states: "joint_states".to_owned(),
            attitude: AttitudeSource::default(),
            speeds: SpeedSource::default(),
            joints: TreadJoints::default(),
            emergency_stop: "emergency_stop".to_owned(),
            emergency_stop_timeout_s: 0.0,
            path: String::new(),
            speed_limit: "speed_limit".to_owned(),
        }
    }
}

/// How the drives are told; each that is given is published.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CommandsConfig {
    /// As a twist.
    pub twist: Option<TwistConfig>,
    /// As velocities of the treads' joints.
    pub treads: Option<TreadsConfig>,
    /// As the speeds of two motors.
    pub motors: Option<MotorsConfig>,
    /// Width by which the vehicle's base makes treads of a twist, and odometry a twist of treads, m;
    /// the distance of the vehicle's tread ICRs where it is not given.
    pub track_width_m: Option<f64>,
}

impl Default for CommandsConfig {
    fn default() -> Self {
        Self {
            twist: Some(TwistConfig::default()),
            treads: None,
            motors: None,
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
    /// geometry_msgs/TwistStamped rather than Twist.
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

/// std_msgs/Float64MultiArray of the left and the right joint's velocity.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TreadsConfig {
    /// Topic.
    pub topic: String,
    /// The joints.
    pub joints: TreadJoints,
}

/// std_msgs/Float64, m/s, of each motor.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MotorsConfig {
    /// Topic of the traction.
    pub traction: String,
    /// Topic of the steer.
    pub steer: String,
}

/// Whose definition of nav2_msgs/FollowPath.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Definition {
    /// Without progress checker and error code.
    Humble,
    /// With both.
    Iron,
    /// And with a message; kilted too.
    #[default]
    #[serde(alias = "kilted")]
    Jazzy,
}

/// The action.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FollowPathConfig {
    /// Its name.
    pub action: String,
    /// Whose definition.
    pub definition: Definition,
    /// The controller that a goal may name.
    pub controller_id: String,
    /// The goal checker that a goal may name.
    pub goal_checker_id: String,
    /// The progress checker that a goal may name.
    pub progress_checker_id: String,
    /// Whether the poses' orientations tell where a path is driven in reverse; else only its sharp
    /// turns do.
    pub use_orientations: bool,
    /// Whether the vehicle turns on the spot where the path leads off behind it.
    pub turn_at_start: bool,
    /// Whether the vehicle turns on the spot where the path has ended and the last pose looks
    /// elsewhere.
    pub turn_at_goal: bool,
}

impl Default for FollowPathConfig {
    fn default() -> Self {
        Self {
            action: "follow_path".to_owned(),
            definition: Definition::default(),
            controller_id: "FollowPath".to_owned(),
            goal_checker_id: "general_goal_checker".to_owned(),
            progress_checker_id: "progress_checker".to_owned(),
            use_orientations: false,
            turn_at_start: true,
            turn_at_goal: true,
        }
    }
}

/// What is tolerated; parameters of the node of the same meaning can change it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerances {
    /// Distance from the goal, m.
    pub goal_xy_m: f64,
    /// Heading off the goal's, rad.
    pub goal_yaw_rad: f64,
    /// Movement that counts as progress, m.
    pub progress_m: f64,
    /// Time within which there must be progress, s.
    pub progress_time_s: f64,
    /// Age of a transform or of odometry beyond which it is no longer looked up, s.
    pub transform_s: f64,
    /// Time for which transforms and readings may be missing and plans fail, s.
    pub failure_s: f64,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self {
            goal_xy_m: 0.25,
            goal_yaw_rad: 0.25,
            progress_m: 0.5,
            progress_time_s: 10.0,
            transform_s: 0.5,
            failure_s: 1.0,
        }
    }
}

impl Ros2Config {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let check = RangeError::check;
        let t = &self.tolerances;
        check(
            "ros2.tolerances.goal_xy_m",
            t.goal_xy_m,
            0.01,
            100.0,
            "from 0.01 to 100 m",
        )?;
        check(
            "ros2.tolerances.goal_yaw_rad",
            t.goal_yaw_rad,
            0.02,
            3.2,
            "from 0.02 to 3.2 rad",
        )?;
        check(
            "ros2.tolerances.progress_m",
            t.progress_m,
            0.02,
            100.0,
            "from 0.01 to 100 m",
        )?;
        check(
            "ros2.tolerances.progress_time_s",
            t.progress_time_s,
            0.1,
            1e4,
            "from 0.1 to 10000 s",
        )?;
        check(
            "ros2.tolerances.transform_s",
            t.transform_s,
            0.0,
            10.0,
            "from 0 to 10 s",
        )?;
        check(
            "ros2.tolerances.failure_s",
            t.failure_s,
            0.0,
            60.0,
            "from 0 to 60 s",
        )?;
        let timeout_s = self.inputs.emergency_stop_timeout_s;
        check(
            "ros2.inputs.emergency_stop_timeout_s",
            timeout_s,
            0.0,
            10.0,
            "from 0 to 10 s",
        )?;
        self.inputs.joints.validate()?;
        if let Some(treads) = &self.commands.treads {
            treads.joints.validate()?;
        }
        Ok(())
    }
}
