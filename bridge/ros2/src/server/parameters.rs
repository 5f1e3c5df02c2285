//! The parameters of the controller server, under the names that Nav2's has.

use crate::node::parameters::Parameters;
use ros2_client::parameters::{Parameter, ParameterValue};
use sidehill_bridge::ros2::settings::server::{FollowPathConfig, Ros2Config, Tolerances};
use std::f64::consts::PI;

/// The names of the parameters that belong to a controller or a checker.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ServerParameters {
    goal_xy: String,
    goal_yaw: String,
    progress_radius: String,
    progress_time: String,
    speed: String,
}

/// Nav2's goal checker that does not ask for a heading.
const POSITION_GOAL_CHECKER: &str = "PositionGoalChecker";

const TRANSFORM_TOLERANCE: &str = "transform_tolerance";
const FAILURE_TOLERANCE: &str = "failure_tolerance";
const MIN_X_VELOCITY: &str = "min_x_velocity_threshold";
const MIN_THETA_VELOCITY: &str = "min_theta_velocity_threshold";

impl ServerParameters {
    /// Returns the names for the ids of a configuration.
    pub(crate) fn new(ids: &FollowPathConfig) -> Self {
        let (goal, progress) = (&ids.goal_checker_id, &ids.progress_checker_id);
        Self {
            goal_xy: format!("{goal}.xy_goal_tolerance"),
            goal_yaw: format!("{goal}.yaw_goal_tolerance"),
            progress_radius: format!("{progress}.required_movement_radius"),
            progress_time: format!("{progress}.movement_time_allowance"),
            speed: format!("{}.desired_linear_vel", ids.controller_id),
        }
    }

    /// Returns the parameters of a configuration, for a control loop of `period_s` and a speed of
    /// `speed_m_s`.
    pub(crate) fn declare(&self, config: &Ros2Config, period_s: f64, speed_m_s: f64) -> Parameters {
        let mut parameters = Parameters::default();
        let t = &config.tolerances;
        for (name, value, range, description) in [
            (
                FAILURE_TOLERANCE,
                t.failure_s,
                0.0..=60.0,
                "s for which transforms, readings or plans may be missing",
            ),
            (
                TRANSFORM_TOLERANCE,
                t.transform_s,
                0.0..=10.0,
                "s, oldest transform that is used",
            ),
            (
                MIN_X_VELOCITY,
                0.0001,
                0.0..=1.0,
                "m/s, speed of the odometry that counts as 0 below",
            ),
            (
                MIN_THETA_VELOCITY,
                0.0001,
                0.0..=1.0,
                "rad/s, yaw rate of the odometry that counts as 0 below",
            ),
            (
                &self.goal_xy,
                t.goal_xy_m,
                0.01..=100.0,
                "m, distance from the goal at the end of the path",
            ),
            (
                &self.goal_yaw,
                t.goal_yaw_rad,
                0.02..=7.0,
                "rad, heading error at the end of the path; from pi on any heading will do",
            ),
            (
                &self.progress_radius,
                t.progress_m,
                0.01..=100.0,
                "m, movement that counts as progress",
            ),
            (
                &self.progress_time,
                t.progress_time_s,
                0.1..=1e4,
                "s within which there must be progress",
            ),
            (
                &self.speed,
                speed_m_s,
                0.01..=20.0,
                "m/s where the path and the motors allow it",
            ),
        ] {
            parameters.declare_double(name, value, range, description);
        }
        let text = |topic: &String| ParameterValue::String(topic.clone());
        let one = |id: &String| ParameterValue::StringArray(vec![id.clone()]);
        let (twist, ids) = (config.commands.twist.as_ref(), &config.follow_path);
        for (name, value, description) in [
            (
                "controller_frequency",
                ParameterValue::Double(1.0 / period_s),
                "Hz; cycle.period_s of the configuration",
            ),
            (
                "odom_topic",
                text(&config.inputs.odometry),
                "nav_msgs/Odometry",
            ),
            (
                "speed_limit_topic",
                text(&config.inputs.speed_limit),
                "nav2_msgs/SpeedLimit",
            ),
            (
                "use_sim_time",
                ParameterValue::Boolean(config.use_sim_time),
                "whether time is that of /clock",
            ),
            (
                "enable_stamped_cmd_vel",
                ParameterValue::Boolean(twist.is_some_and(|twist| twist.stamped)),
                "TwistStamped rather than Twist",
            ),
            (
                "controller_plugins",
                one(&ids.controller_id),
                "id that a goal may name",
            ),
            (
                "goal_checker_plugins",
                one(&ids.goal_checker_id),
                "id that a goal may name",
            ),
            (
                "progress_checker_plugins",
                one(&ids.progress_checker_id),
                "id that a goal may name",
            ),
        ] {
            parameters.declare_read_only(name, value, description);
        }
        parameters
    }

    /// Returns the tolerances as they are set.
    pub(crate) fn tolerances(&self, values: &Parameters) -> Tolerances {
        let default = Tolerances::default();
        Tolerances {
            goal_xy_m: values.double(&self.goal_xy, default.goal_xy_m),
            goal_yaw_rad: values.double(&self.goal_yaw, default.goal_yaw_rad),
            progress_m: values.double(&self.progress_radius, default.progress_m),
            progress_time_s: values.double(&self.progress_time, default.progress_time_s),
            transform_s: values.double(TRANSFORM_TOLERANCE, default.transform_s),
            failure_s: values.double(FAILURE_TOLERANCE, default.failure_s),
        }
    }

    /// Returns the desired speed, m/s.
    pub(crate) fn speed_m_s(&self, values: &Parameters) -> f64 {
        values.double(&self.speed, 0.01)
    }

    /// Returns the speed, m/s, and the yaw rate, rad/s, below which odometry counts as 0.
    pub(crate) fn velocity_thresholds(values: &Parameters) -> [f64; 2] {
        [MIN_X_VELOCITY, MIN_THETA_VELOCITY].map(|name| values.double(name, 0.0))
    }
}

/// Overrides a configuration by the parameters that files and arguments give to the node; parameters that
/// this server does not have are ignored.
///
/// # Errors
/// The parameter that cannot have its value, and the reason.
pub fn override_config(
    config: &mut Ros2Config,
    speed_m_s: &mut f64,
    period_s: f64,
    given: &[Parameter],
) -> Result<(), String> {
    for Parameter { name, value } in given {
        match (name.as_str(), value) {
            ("odom_topic", ParameterValue::String(topic)) => {
                config.inputs.odometry.clone_from(topic)
            }
            ("speed_limit_topic", ParameterValue::String(topic)) => {
                config.inputs.speed_limit.clone_from(topic);
            }
            ("use_sim_time", ParameterValue::Boolean(on)) => config.use_sim_time = *on,
            ("enable_stamped_cmd_vel", ParameterValue::Boolean(on)) => {
                if let Some(twist) = &mut config.commands.twist {
                    twist.stamped = *on;
                }
            }
            ("controller_plugins", ParameterValue::StringArray(ids)) => {
                set_id(&mut config.follow_path.controller_id, ids);
            }
            ("goal_checker_plugins", ParameterValue::StringArray(ids)) => {
                set_id(&mut config.follow_path.goal_checker_id, ids);
            }
            ("progress_checker_plugins", ParameterValue::StringArray(ids)) => {
                set_id(&mut config.follow_path.progress_checker_id, ids);
            }
            _ => {}
        }
    }
    let plugin = format!("{}.plugin", config.follow_path.goal_checker_id);
    let position_only = given.iter().any(|parameter| {
        parameter.name == plugin
            && matches!(&parameter.value, ParameterValue::String(kind) if kind.ends_with(POSITION_GOAL_CHECKER))
    });
    // The ids are known now, and with them the names of their parameters.
    let names = ServerParameters::new(&config.follow_path);
    let mut parameters = names.declare(config, period_s, *speed_m_s);
    for Parameter { name, value } in given {
        if parameters.is_writable(name) {
            // YAML writes whole numbers without a decimal point.
            let value = match value {
                ParameterValue::Integer(whole) => ParameterValue::Double(*whole as f64),
                other => other.clone(),
            };
            parameters.set(name, value)?;
        }
    }
    config.tolerances = names.tolerances(&parameters);
    if position_only {
        config.tolerances.goal_yaw_rad = PI;
    }
    *speed_m_s = names.speed_m_s(&parameters);
    Ok(())
}

fn set_id(id: &mut String, given: &[String]) {
    if let Some(first) = given.first() {
        id.clone_from(first);
    }
}

#[cfg(test)]
mod tests;
