//! Settings of the controller server: the `ros2:` section of a run.

use super::costmap::CostmapConfig;
use crate::ros2::names::Names;
use crate::ros2::settings::topics::{CommandsConfig, Frames, InputsConfig};
use serde::{Deserialize, Serialize};
use sidehill_controller::path::SmoothingConfig;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// The `ros2:` section of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Ros2Config {
    /// Name of the node. `--ros-args -r __node:=NAME` overrides it.
    pub node: String,
    /// [Frames](#frames).
    pub frames: Frames,
    /// [Topics to subscribe to](#inputs).
    pub inputs: InputsConfig,
    /// [Commands](#commands), with `port: ros2`.
    pub commands: CommandsConfig,
    /// [The action](#followpath).
    pub follow_path: FollowPathConfig,
    /// [How the poses of a path become a curve](#path-smoothing).
    pub smoothing: SmoothingConfig,
    /// [Tolerances](#tolerances).
    pub tolerances: Tolerances,
    /// [Obstacles](#costmap). None: no costmap is subscribed to.
    pub costmap: Option<CostmapConfig>,
    /// Whether nav2_msgs/TrackingFeedback is published on `tracking_feedback` (Nav2 after jazzy).
    pub tracking_feedback: bool,
    /// Whether the estimate is published as the transform from `frames.odometry` to `frames.base`.
    pub publish_transform: bool,
    /// Whether time comes from `/clock`.
    pub use_sim_time: bool,
    /// Whether the node configures and activates itself, without a lifecycle manager.
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
            smoothing: SmoothingConfig::default(),
            tolerances: Tolerances::default(),
            costmap: None,
            tracking_feedback: false,
            publish_transform: false,
            use_sim_time: false,
            autostart: true,
        }
    }
}

/// The distribution whose nav2_msgs/FollowPath is served.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Definition {
    /// No progress checker id, no error code.
    Humble,
    /// With progress checker id and error code.
    Iron,
    /// Also with an error message; kilted has the same.
    #[default]
    #[serde(alias = "kilted")]
    Jazzy,
}

/// The action.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FollowPathConfig {
    /// Name of the action.
    pub action: String,
    /// ROS distribution whose definition of FollowPath is used.
    pub definition: Definition,
    /// Controller name that goals may ask for.
    pub controller_id: String,
    /// Goal checker name that goals may ask for.
    pub goal_checker_id: String,
    /// Progress checker name that goals may ask for.
    pub progress_checker_id: String,
    /// Whether poses that look backward mean reverse. Otherwise only sharp turns of the path do.
    pub use_orientations: bool,
    /// Whether to turn on the spot if the path begins behind the vehicle.
    pub turn_at_start: bool,
    /// Whether to pivot to the orientation of the last pose, unless the slope would carry the vehicle off the goal
    /// meanwhile.
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

/// Tolerances; the node has parameters of the same meaning that can be set while it runs.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerances {
    /// Largest distance from the goal.
    pub goal_xy_m: f64,
    /// Largest heading error at the goal. From pi on, any heading is accepted.
    pub goal_yaw_rad: f64,
    /// Least movement that counts as progress.
    pub progress_m: f64,
    /// Longest time without progress.
    pub progress_time_s: f64,
    /// Largest age of a transform or of odometry.
    pub transform_s: f64,
    /// Longest time with missing transforms or readings, or without a plan.
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
        let t = &self.tolerances;
        Bounds::new(0.01, 100.0, "m").check("ros2.tolerances.goal_xy_m", t.goal_xy_m)?;
        Bounds::new(0.02, 7.0, "rad").check("ros2.tolerances.goal_yaw_rad", t.goal_yaw_rad)?;
        Bounds::new(0.01, 100.0, "m").check("ros2.tolerances.progress_m", t.progress_m)?;
        Bounds::new(0.1, 1e4, "s").check("ros2.tolerances.progress_time_s", t.progress_time_s)?;
        Bounds::new(0.0, 10.0, "s").check("ros2.tolerances.transform_s", t.transform_s)?;
        Bounds::new(0.0, 60.0, "s").check("ros2.tolerances.failure_s", t.failure_s)?;
        let timeout_s = self.inputs.emergency_stop_timeout_s;
        Bounds::new(0.0, 10.0, "s").check("ros2.inputs.emergency_stop_timeout_s", timeout_s)?;
        self.inputs.joints.validate()?;
        if let Some(costmap) = &self.costmap {
            costmap.validate()?;
        }
        if let Some(treads) = &self.commands.treads {
            treads.joints.validate()?;
        }
        Ok(())
    }

    /// Checks that all names of topics and of the action are names of ROS.
    ///
    /// # Errors
    /// The key of the first that is none, and why.
    pub fn check_names(&self) -> Result<(), String> {
        let names = Names::new(&self.node, "/", &[]).map_err(|error| format!("node: {error}"))?;
        let (inputs, commands) = (&self.inputs, &self.commands);
        let mut topics = vec![
            ("inputs.odometry", &inputs.odometry),
            ("inputs.imu", &inputs.imu),
            ("inputs.joint_states", &inputs.joint_states),
            ("inputs.emergency_stop", &inputs.emergency_stop),
            ("inputs.speed_limit", &inputs.speed_limit),
            ("follow_path.action", &self.follow_path.action),
        ];
        if let Some(pose) = &inputs.pose {
            if !pose.topic.is_empty() {
                topics.push(("inputs.pose.topic", &pose.topic));
            }
            if let Some(heading) = &pose.heading {
                topics.push(("inputs.pose.heading.topic", &heading.topic));
            }
        }
        if !inputs.path.is_empty() {
            topics.push(("inputs.path", &inputs.path));
        }
        if let Some(twist) = &commands.twist {
            topics.push(("commands.twist.topic", &twist.topic));
        }
        if let Some(treads) = &commands.treads {
            topics.push(("commands.treads.topic", &treads.topic));
        }
        if let Some(motors) = &commands.motors {
            topics.push(("commands.motors.traction", &motors.traction));
            topics.push(("commands.motors.steer", &motors.steer));
        }
        for (key, topic) in topics {
            names
                .resolve(topic)
                .map_err(|error| format!("{key}: {error}; names have letters, digits, _ and /"))?;
        }
        Ok(())
    }
}
