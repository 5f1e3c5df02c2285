//! The node's parameters: what there is, what may be changed, and to what.

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
        for (name, value, description) in [
            ("odom_topic", &config.inputs.odometry, "nav_msgs/Odometry"),
            (
                "speed_limit_topic",
                &config.inputs.speed_limit,
                "nav2_msgs/SpeedLimit",
            ),
        ] {
            let value = ParameterValue::String(value.clone());
            parameters.declare(name, value, Rule::ReadOnly, description);
        }
        let stamped = config
            .commands
            .twist
            .as_ref()
            .is_some_and(|twist| twist.stamped);
        for (name, value, description) in [
            (
                "use_sim_time",
                config.use_sim_time,
                "whether time is that of /clock",
            ),
            (
                "enable_stamped_cmd_vel",
                stamped,
                "TwistStamped rather than Twist",
            ),
        ] {
            let value = ParameterValue::Boolean(value);
            parameters.declare(name, value, Rule::ReadOnly, description);
        }
        for (name, id) in [
            ("controller_plugins", controller),
            ("goal_checker_plugins", goal),
            ("progress_checker_plugins", progress),
        ] {
            let value = ParameterValue::StringArray(vec![id.clone()]);
            parameters.declare(name, value, Rule::ReadOnly, "what a goal may name");
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

/// Takes what files and arguments say of a run's configuration: what they say of other things is not
/// ours.
///
/// # Errors
/// The parameter that cannot have its value, and why.
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
    // Names of checkers are known now, and with them the names of what they tolerate.
    let mut parameters = Parameters::new(config, period_s, *speed_m_s);
    for Parameter { name, value } in given {
        let dynamic = matches!(
            parameters.entries.get(name).map(|entry| entry.rule),
            Some(Rule::Range(..))
        );
        if dynamic {
            // YAML writes whole numbers without a point.
            let value = match value {
                ParameterValue::Integer(whole) => ParameterValue::Double(*whole as f64),
                other => other.clone(),
            };
            parameters.set(name, value)?;
        }
    }
    config.tolerances = parameters.tolerances();
    *speed_m_s = parameters.speed_m_s();
    Ok(())
}

fn set_id(id: &mut String, given: &[String]) {
    if let Some(first) = given.first() {
        id.clone_from(first);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ParameterValue::{Boolean, Double, Integer, NotSet, StringArray};

    fn parameters() -> Parameters {
        Parameters::new(&Ros2Config::default(), 0.05, 0.5)
    }

    fn given(name: &str, value: ParameterValue) -> Parameter {
        Parameter {
            name: name.to_owned(),
            value,
        }
    }

    #[test]
    fn a_tolerance_is_set_within_its_range_and_refused_with_a_reason() {
        let mut parameters = parameters();
        let name = "general_goal_checker.xy_goal_tolerance";
        parameters.set(name, Double(0.4)).unwrap();
        assert_eq!(parameters.tolerances().goal_xy_m, 0.4);
        for (name, value, reason) in [
            (
                name,
                Double(-1.0),
                "-1 is out of range, must be from 0.01 to 100",
            ),
            (name, Double(f64::NAN), "out of range"),
            (name, Integer(1), "must be a double"),
            ("controller_frequency", Double(30.0), "read-only"),
            ("use_sim_time", Boolean(true), "read-only"),
            ("no_such", Double(1.0), "there is no parameter no_such"),
        ] {
            let error = parameters.set(name, value).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
        assert_eq!(parameters.tolerances().goal_xy_m, 0.4);
        // To set what it is already is no change.
        parameters.set("use_sim_time", Boolean(false)).unwrap();
    }

    #[test]
    fn several_are_set_all_or_none() {
        let mut parameters = parameters();
        let error = parameters.set_all(vec![
            given("failure_tolerance", Double(2.0)),
            given("transform_tolerance", Double(-2.0)),
        ]);
        assert!(error.unwrap_err().contains("transform_tolerance"));
        assert_eq!(parameters.tolerances().failure_s, 1.0);
        let both = vec![
            given("failure_tolerance", Double(2.0)),
            given("transform_tolerance", Double(0.2)),
        ];
        parameters.set_all(both).unwrap();
        let now = parameters.tolerances();
        assert_eq!((now.failure_s, now.transform_s), (2.0, 0.2));
    }

    #[test]
    fn what_there_is_can_be_listed_and_described() {
        let parameters = parameters();
        let of = |prefix: &str| parameters.list(&[prefix.to_owned()], 0);
        assert_eq!(of("progress_checker").len(), 2);
        assert!(of("progress").is_empty());
        assert_eq!(of("use_sim_time"), ["use_sim_time"]);
        let flat = parameters.list(&[], 1);
        assert!(flat.iter().all(|name| !name.contains('.')) && flat.len() > 5);
        assert_eq!(parameters.list(&[], 0).len(), parameters.all().len());
        let range = parameters
            .describe("failure_tolerance")
            .floating_point_range;
        assert_eq!((range[0].from_value, range[0].to_value), (0.0, 60.0));
        assert!(parameters.describe("controller_frequency").read_only);
        assert_eq!(parameters.get("no_such"), NotSet);
        assert_eq!(parameters.get("controller_frequency"), Double(20.0));
    }

    #[test]
    fn a_file_of_nav2_is_understood_where_it_is_ours() {
        let mut config = Ros2Config::default();
        let mut speed_m_s = 0.5;
        let file = [
            given("use_sim_time", Boolean(true)),
            given(
                "goal_checker_plugins",
                StringArray(vec!["precise".to_owned()]),
            ),
            given("precise.xy_goal_tolerance", Double(0.1)),
            given("progress_checker.movement_time_allowance", Integer(20)),
            given("FollowPath.desired_linear_vel", Double(0.3)),
            given("FollowPath.plugin", ParameterValue::String("x".to_owned())),
            given("controller_frequency", Double(100.0)),
        ];
        override_config(&mut config, &mut speed_m_s, 0.05, &file).unwrap();
        assert!(config.use_sim_time);
        assert_eq!(config.follow_path.goal_checker_id, "precise");
        assert_eq!(config.tolerances.goal_xy_m, 0.1);
        assert_eq!(config.tolerances.progress_time_s, 20.0);
        assert_eq!(speed_m_s, 0.3);
        let wrong = [given("failure_tolerance", Double(-1.0))];
        let error = override_config(&mut config, &mut speed_m_s, 0.05, &wrong).unwrap_err();
        assert!(error.contains("failure_tolerance: -1"), "{error}");
    }
}
