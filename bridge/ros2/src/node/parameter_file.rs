//! Parameter files of ROS 2: values by node, with wildcards, as nested maps.

pub use ros2_client::{Parameter, ParameterValue};

use serde::Deserialize;
use sidehill_bridge::ros2::names::NodeName;
use std::collections::BTreeMap;

/// A file: nodes by name or namespace, and below `ros__parameters` their parameters.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(transparent)]
pub struct ParameterFile(BTreeMap<String, FileEntry>);

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
enum FileEntry {
    #[allow(non_snake_case)]
    Parameters {
        ros__parameters: BTreeMap<String, Tree>,
    },
    Namespace(BTreeMap<String, FileEntry>),
}

#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
enum Tree {
    Value(Value),
    Group(BTreeMap<String, Tree>),
}

/// A value as YAML spells it.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// `true` or `false`.
    Boolean(bool),
    /// A whole number.
    Integer(i64),
    /// A number.
    Double(f64),
    /// Text.
    String(String),
    /// Whole numbers.
    Integers(Vec<i64>),
    /// Numbers.
    Doubles(Vec<f64>),
    /// Truth values.
    Booleans(Vec<bool>),
    /// Texts.
    Strings(Vec<String>),
}

impl From<Value> for ParameterValue {
    fn from(value: Value) -> Self {
        match value {
            Value::Boolean(value) => Self::Boolean(value),
            Value::Integer(value) => Self::Integer(value),
            Value::Double(value) => Self::Double(value),
            Value::String(value) => Self::String(value),
            Value::Integers(value) => Self::IntegerArray(value),
            Value::Doubles(value) => Self::DoubleArray(value),
            Value::Booleans(value) => Self::BooleanArray(value),
            Value::Strings(value) => Self::StringArray(value),
        }
    }
}

impl ParameterFile {
    /// Returns the parameters for a node, groups joined by dots; what is named more closely comes
    /// later and so is stronger.
    pub fn for_node(&self, node: &NodeName) -> Vec<Parameter> {
        let whole = node.fully_qualified_name();
        let whole: Vec<&str> = whole.split('/').filter(|part| !part.is_empty()).collect();
        let mut found = Vec::new();
        collect(&self.0, "", &mut |pattern, parameters| {
            if matches(pattern, &whole) {
                // More literal parts are a closer name.
                let closeness = pattern.iter().filter(|part| !part.contains('*')).count();
                found.push((closeness, parameters.clone()));
            }
        });
        found.sort_by_key(|(closeness, _)| *closeness);
        let mut out = Vec::new();
        for (_, parameters) in found {
            flatten("", parameters, &mut out);
        }
        out
    }
}

fn collect(
    entries: &BTreeMap<String, FileEntry>,
    above: &str,
    take: &mut impl FnMut(&[&str], &BTreeMap<String, Tree>),
) {
    for (name, entry) in entries {
        let path = format!("{above}/{}", name.trim_matches('/'));
        match entry {
            FileEntry::Parameters { ros__parameters } => {
                let parts: Vec<&str> = path.split('/').filter(|part| !part.is_empty()).collect();
                take(&parts, ros__parameters);
            }
            FileEntry::Namespace(below) => collect(below, &path, take),
        }
    }
}

/// Whether a name fits a pattern in which `*` is one part and `**` any number of parts.
fn matches(pattern: &[&str], name: &[&str]) -> bool {
    match (pattern, name) {
        ([], []) => true,
        (["**", rest @ ..], _) => (0..=name.len()).any(|skip| matches(rest, &name[skip..])),
        ([part, rest @ ..], [first, others @ ..]) => {
            (*part == "*" || part == first) && matches(rest, others)
        }
        _ => false,
    }
}

fn flatten(above: &str, tree: BTreeMap<String, Tree>, out: &mut Vec<Parameter>) {
    for (key, tree) in tree {
        let name = if above.is_empty() {
            key
        } else {
            format!("{above}.{key}")
        };
        match tree {
            Tree::Value(value) => out.push(Parameter {
                name,
                value: value.into(),
            }),
            Tree::Group(group) => flatten(&name, group, out),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "
/**:
  ros__parameters: {use_sim_time: true, odom_topic: odom}
controller_server:
  ros__parameters:
    controller_frequency: 20.0
    odom_topic: odometry
    goal_checker: {plugin: x, xy_goal_tolerance: 0.25, names: [a, b]}
j8:
  controller_server:
    ros__parameters: {here: 1}
other:
  ros__parameters: {controller_frequency: 5}
";

    fn read(namespace: &str) -> Vec<(String, ParameterValue)> {
        let file: ParameterFile = serde_yaml::from_str(FILE).unwrap();
        file.for_node(&NodeName::new(namespace, "controller_server").unwrap())
            .into_iter()
            .map(|parameter| (parameter.name, parameter.value))
            .collect()
    }

    #[test]
    fn a_node_gets_what_is_for_all_and_what_is_for_it() {
        let found = read("/");
        let get = |name: &str| {
            let last = found.iter().rev().find(|(found, _)| found == name);
            last.map(|(_, value)| value.clone())
        };
        assert_eq!(get("use_sim_time"), Some(ParameterValue::Boolean(true)));
        assert_eq!(
            get("controller_frequency"),
            Some(ParameterValue::Double(20.0))
        );
        assert_eq!(
            get("odom_topic"),
            Some(ParameterValue::String("odometry".to_owned()))
        );
        assert_eq!(
            get("goal_checker.xy_goal_tolerance"),
            Some(ParameterValue::Double(0.25))
        );
        assert_eq!(
            get("goal_checker.names"),
            Some(ParameterValue::StringArray(vec![
                "a".to_owned(),
                "b".to_owned()
            ]))
        );
        assert_eq!(get("here"), None);
    }

    #[test]
    fn namespaces_are_maps_too() {
        let found = read("/j8");
        assert!(found.contains(&("here".to_owned(), ParameterValue::Integer(1))));
        assert!(found.iter().any(|(name, _)| name == "use_sim_time"));
        assert!(!found.iter().any(|(name, _)| name == "controller_frequency"));
    }
}
