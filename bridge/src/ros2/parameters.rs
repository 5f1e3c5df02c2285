//! The node's parameters: what there is, what may be changed, and to what.

mod given;

pub use given::override_config;

use super::config::{Ros2Config, Tolerances};
use ros2_client::parameters::{Parameter, ParameterValue, raw};
use std::collections::BTreeMap;

/// What may become of a parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Rule {
    /// It holds from the start on.
    ReadOnly,
    /// Any number from the first to the second.
    Range(f64, f64),
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    value: ParameterValue,
    rule: Rule,
    description: &'static str,
}

/// The parameters of a controller server, under the names that Nav2's has.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    entries: BTreeMap<String, Entry>,
    goal_checker: String,
    progress_checker: String,
    controller: String,
}

impl Parameters {
    /// Returns the parameters as a configuration has them, for a cycle of `period_s` and a speed of
    /// `speed_m_s`.
    pub fn new(config: &Ros2Config, period_s: f64, speed_m_s: f64) -> Self {
        let ids = &config.follow_path;
        let mut parameters = Self {
            entries: BTreeMap::new(),
            goal_checker: ids.goal_checker_id.clone(),
            progress_checker: ids.progress_checker_id.clone(),
            controller: ids.controller_id.clone(),
        };
        let t = &config.tolerances;
        let (goal, progress) = (&ids.goal_checker_id, &ids.progress_checker_id);
        let controller = &ids.controller_id;
        for (name, value, rule, description) in [
            (
                "controller_frequency".to_owned(),
                1.0 / period_s,
                Rule::ReadOnly,
                "Hz; cycle.period_s of the configuration",
            ),
            (
                "failure_tolerance".to_owned(),
                t.failure_s,
                Rule::Range(0.0, 60.0),
                "s for which transforms and readings may be missing and plans fail",
            ),
            (
                "transform_tolerance".to_owned(),
                t.transform_s,
                Rule::Range(0.0, 10.0),
                "s, age of a transform that is still looked up",
            ),
            (
                "min_x_velocity_threshold".to_owned(),
                0.0001,
                Rule::Range(0.0, 1.0),
                "m/s below which the speed of odometry is taken to be 0",
            ),
            (
                "min_theta_velocity_threshold".to_owned(),
                0.0001,
                Rule::Range(0.0, 1.0),
                "rad/s below which the yaw rate of odometry is taken to be 0",
            ),
            (
                format!("{goal}.xy_goal_tolerance"),
                t.goal_xy_m,
                Rule::Range(0.01, 100.0),
                "m from the goal at the path's end",
            ),
            (
                format!("{goal}.yaw_goal_tolerance"),
                t.goal_yaw_rad,
                Rule::Range(0.02, 3.2),
                "rad off the goal's heading at the path's end",
            ),
            (
                format!("{progress}.required_movement_radius"),
                t.progress_m,
                Rule::Range(0.01, 100.0),
                "m that count as progress",
            ),
            (
                format!("{progress}.movement_time_allowance"),
                t.progress_time_s,
                Rule::Range(0.1, 1e4),
                "s within which there must be progress",
            ),
            (
                format!("{controller}.desired_linear_vel"),
                speed_m_s,
                Rule::Range(0.01, 20.0),
                "m/s on the open stretch",
            ),
        ] {
            parameters.declare(&name, ParameterValue::Double(value), rule, description);
        }
        let text = |topic: &String| ParameterValue::String(topic.clone());
        let one = |id: &String| ParameterValue::StringArray(vec![id.clone()]);
        let twist = config.commands.twist.as_ref();
        for (name, value, description) in [
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
                one(controller),
                "what a goal may name",
            ),
            ("goal_checker_plugins", one(goal), "what a goal may name"),
            (
                "progress_checker_plugins",
                one(progress),
                "what a goal may name",
            ),
        ] {
            parameters.declare(name, value, Rule::ReadOnly, description);
        }
        parameters
    }

    fn declare(
        &mut self,
        name: &str,
        value: ParameterValue,
        rule: Rule,
        description: &'static str,
    ) {
        let entry = Entry {
            value,
            rule,
            description,
        };
        self.entries.insert(name.to_owned(), entry);
    }

    /// Returns whether there is a parameter of that name that may be set to something else.
    fn may_change(&self, name: &str) -> bool {
        self.entries
            .get(name)
            .is_some_and(|entry| entry.rule != Rule::ReadOnly)
    }

    /// Checks whether a parameter may be set.
    ///
    /// # Errors
    /// Why not.
    pub fn check(&self, name: &str, value: &ParameterValue) -> Result<(), String> {
        let entry = self
            .entries
            .get(name)
            .ok_or_else(|| format!("there is no parameter {name}"))?;
        match (entry.rule, &entry.value, value) {
            (Rule::ReadOnly, now, value) if now == value => Ok(()),
            (Rule::ReadOnly, ..) => Err(format!("{name} is read-only: {}", entry.description)),
            (Rule::Range(low, high), _, ParameterValue::Double(value)) => {
                if (low..=high).contains(value) {
                    Ok(())
                } else {
                    Err(format!(
                        "{name}: {value} is out of range, must be from {low} to {high}"
                    ))
                }
            }
            _ => Err(format!("{name} must be a double")),
        }
    }

    /// Sets a parameter.
    ///
    /// # Errors
    /// Why it may not be set; nothing has changed then.
    pub fn set(&mut self, name: &str, value: ParameterValue) -> Result<(), String> {
        self.check(name, &value)?;
        if let Some(entry) = self.entries.get_mut(name) {
            entry.value = value;
        }
        Ok(())
    }

    /// Sets several, or none.
    ///
    /// # Errors
    /// Why the first that may not be set may not.
    pub fn set_all(&mut self, parameters: Vec<Parameter>) -> Result<(), String> {
        for parameter in &parameters {
            self.check(&parameter.name, &parameter.value)?;
        }
        for Parameter { name, value } in parameters {
            self.set(&name, value)?;
        }
        Ok(())
    }

    /// Returns the value of a parameter; not set where there is none.
    pub fn get(&self, name: &str) -> ParameterValue {
        let entry = self.entries.get(name);
        entry.map_or(ParameterValue::NotSet, |entry| entry.value.clone())
    }

    /// Returns all parameters.
    pub fn all(&self) -> Vec<Parameter> {
        let all = self.entries.iter().map(|(name, entry)| Parameter {
            name: name.clone(),
            value: entry.value.clone(),
        });
        all.collect()
    }

    /// Returns the names below one of `prefixes`, or all where there is none, no deeper than `depth`
    /// groups; 0 is any depth.
    pub fn list(&self, prefixes: &[String], depth: u64) -> Vec<String> {
        let within = |rest: &str| depth == 0 || (rest.matches('.').count() as u64) < depth;
        let below = |name: &str, prefix: &str| {
            name == prefix
                || name
                    .strip_prefix(prefix)
                    .and_then(|rest| rest.strip_prefix('.'))
                    .is_some_and(within)
        };
        let names = self.entries.keys().filter(|name| {
            if prefixes.is_empty() {
                within(name)
            } else {
                prefixes.iter().any(|prefix| below(name, prefix))
            }
        });
        names.cloned().collect()
    }

    /// Returns what is said of a parameter.
    pub fn describe(&self, name: &str) -> raw::ParameterDescriptor {
        let entry = self.entries.get(name);
        let value = entry.map_or(&ParameterValue::NotSet, |entry| &entry.value);
        let range = match entry.map(|entry| entry.rule) {
            Some(Rule::Range(from_value, to_value)) => vec![raw::FloatingPointRange {
                from_value,
                to_value,
                step: 0.0,
            }],
            _ => Vec::new(),
        };
        raw::ParameterDescriptor {
            name: name.to_owned(),
            r#type: ParameterValue::to_parameter_type_raw(value),
            description: entry.map_or("", |entry| entry.description).to_owned(),
            additional_constraints: String::new(),
            read_only: entry.is_some_and(|entry| entry.rule == Rule::ReadOnly),
            dynamic_typing: false,
            floating_point_range: range,
            integer_range: Vec::new(),
        }
    }

    /// Returns the tolerances as they are now.
    pub fn tolerances(&self) -> Tolerances {
        let now = Tolerances::default();
        let (goal, progress) = (&self.goal_checker, &self.progress_checker);
        Tolerances {
            goal_xy_m: self.number(&format!("{goal}.xy_goal_tolerance"), now.goal_xy_m),
            goal_yaw_rad: self.number(&format!("{goal}.yaw_goal_tolerance"), now.goal_yaw_rad),
            progress_m: self.number(
                &format!("{progress}.required_movement_radius"),
                now.progress_m,
            ),
            progress_time_s: self.number(
                &format!("{progress}.movement_time_allowance"),
                now.progress_time_s,
            ),
            transform_s: self.number("transform_tolerance", now.transform_s),
            failure_s: self.number("failure_tolerance", now.failure_s),
        }
    }

    /// Returns the speed wanted on the open stretch, m/s.
    pub fn speed_m_s(&self) -> f64 {
        self.number(&format!("{}.desired_linear_vel", self.controller), 0.01)
    }

    /// Returns the speed, m/s, and the yaw rate, rad/s, below which odometry says 0.
    pub fn thresholds(&self) -> [f64; 2] {
        ["min_x_velocity_threshold", "min_theta_velocity_threshold"]
            .map(|name| self.number(name, 0.0))
    }

    fn number(&self, name: &str, otherwise: f64) -> f64 {
        match self.entries.get(name).map(|entry| &entry.value) {
            Some(ParameterValue::Double(value)) => *value,
            _ => otherwise,
        }
    }
}

#[cfg(test)]
mod tests;
