//! The parameters of a node: values, ranges and descriptions, and what may be changed.

use ros2_client::parameters::{Parameter, ParameterValue, raw};
use std::collections::BTreeMap;
use std::ops::RangeInclusive;

/// Whether and to what a parameter may be set.
#[derive(Debug, Clone, PartialEq)]
enum ParameterRule {
    /// Fixed once declared.
    ReadOnly,
    /// A double within a range.
    Range(RangeInclusive<f64>),
}

#[derive(Debug, Clone, PartialEq)]
struct Entry {
    value: ParameterValue,
    rule: ParameterRule,
    description: String,
}

/// The declared parameters of a node.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    entries: BTreeMap<String, Entry>,
}

impl Parameters {
    /// Declares a parameter that cannot be set later.
    pub fn declare_read_only(&mut self, name: &str, value: ParameterValue, description: &str) {
        self.declare(name, value, ParameterRule::ReadOnly, description);
    }

    /// Declares a double that may be set within a range.
    pub fn declare_double(
        &mut self,
        name: &str,
        value: f64,
        range: RangeInclusive<f64>,
        description: &str,
    ) {
        let value = ParameterValue::Double(value);
        self.declare(name, value, ParameterRule::Range(range), description);
    }

    fn declare(
        &mut self,
        name: &str,
        value: ParameterValue,
        rule: ParameterRule,
        description: &str,
    ) {
        let entry = Entry {
            value,
            rule,
            description: description.to_owned(),
        };
        self.entries.insert(name.to_owned(), entry);
    }

    /// Returns whether there is a parameter of that name that may be set.
    pub fn is_writable(&self, name: &str) -> bool {
        self.entries
            .get(name)
            .is_some_and(|entry| entry.rule != ParameterRule::ReadOnly)
    }

    /// Checks whether a parameter may be set. Setting a read-only parameter to its value is allowed.
    ///
    /// # Errors
    /// The reason, for the caller of the service.
    pub fn check(&self, name: &str, value: &ParameterValue) -> Result<(), String> {
        let entry = self
            .entries
            .get(name)
            .ok_or_else(|| format!("there is no parameter {name}"))?;
        match (&entry.rule, &entry.value, value) {
            (ParameterRule::ReadOnly, now, value) if now == value => Ok(()),
            (ParameterRule::ReadOnly, ..) => {
                Err(format!("{name} is read-only: {}", entry.description))
            }
            (ParameterRule::Range(range), _, ParameterValue::Double(value)) => {
                if range.contains(value) {
                    Ok(())
                } else {
                    let (low, high) = (range.start(), range.end());
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

    /// Sets all of several parameters, or none.
    ///
    /// # Errors
    /// Why the first of those that may not be set cannot be.
    pub fn set_all(&mut self, parameters: Vec<Parameter>) -> Result<(), String> {
        for parameter in &parameters {
            self.check(&parameter.name, &parameter.value)?;
        }
        for Parameter { name, value } in parameters {
            self.set(&name, value)?;
        }
        Ok(())
    }

    /// Returns the value of a parameter; [`ParameterValue::NotSet`] where there is none.
    pub fn get(&self, name: &str) -> ParameterValue {
        let entry = self.entries.get(name);
        entry.map_or(ParameterValue::NotSet, |entry| entry.value.clone())
    }

    /// Returns the value of a double, or `default` where there is none.
    pub fn double(&self, name: &str, default: f64) -> f64 {
        match self.entries.get(name).map(|entry| &entry.value) {
            Some(ParameterValue::Double(value)) => *value,
            _ => default,
        }
    }

    /// Returns all parameters.
    pub fn all(&self) -> Vec<Parameter> {
        let all = self.entries.iter().map(|(name, entry)| Parameter {
            name: name.clone(),
            value: entry.value.clone(),
        });
        all.collect()
    }

    /// Returns the names below one of `prefixes`, or all without any, at most `depth` groups deep; 0 is
    /// any depth.
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

    /// Returns the descriptor of a parameter.
    pub fn describe(&self, name: &str) -> raw::ParameterDescriptor {
        let entry = self.entries.get(name);
        let value = entry.map_or(&ParameterValue::NotSet, |entry| &entry.value);
        let range = match entry.map(|entry| &entry.rule) {
            Some(ParameterRule::Range(range)) => vec![raw::FloatingPointRange {
                from_value: *range.start(),
                to_value: *range.end(),
                step: 0.0,
            }],
            _ => Vec::new(),
        };
        raw::ParameterDescriptor {
            name: name.to_owned(),
            r#type: ParameterValue::to_parameter_type_raw(value),
            description: entry.map_or_else(String::new, |entry| entry.description.clone()),
            additional_constraints: String::new(),
            read_only: entry.is_some_and(|entry| entry.rule == ParameterRule::ReadOnly),
            dynamic_typing: false,
            floating_point_range: range,
            integer_range: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ParameterValue::{Boolean, Double, Integer, NotSet};

    fn parameters() -> Parameters {
        let mut parameters = Parameters::default();
        parameters.declare_double("checker.tolerance", 0.25, 0.01..=100.0, "m");
        parameters.declare_double("checker.time", 10.0, 0.1..=60.0, "s");
        parameters.declare_read_only("use_sim_time", Boolean(false), "time of /clock");
        parameters
    }

    fn parameter(name: &str, value: f64) -> Parameter {
        Parameter {
            name: name.to_owned(),
            value: Double(value),
        }
    }

    #[test]
    fn a_double_is_set_within_its_range_and_refused_with_a_reason() {
        let mut parameters = parameters();
        let name = "checker.tolerance";
        parameters.set(name, Double(0.4)).unwrap();
        for (name, value, reason) in [
            (
                name,
                Double(-1.0),
                "-1 is out of range, must be from 0.01 to 100",
            ),
            (name, Double(f64::NAN), "out of range"),
            (name, Integer(1), "must be a double"),
            ("use_sim_time", Boolean(true), "read-only: time of /clock"),
            ("no_such", Double(1.0), "there is no parameter no_such"),
        ] {
            let error = parameters.set(name, value).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
        assert_eq!(parameters.double(name, 0.0), 0.4);
        parameters.set("use_sim_time", Boolean(false)).unwrap();
    }

    #[test]
    fn several_are_set_all_or_none() {
        let mut parameters = parameters();
        let error = parameters.set_all(vec![
            parameter("checker.tolerance", 2.0),
            parameter("checker.time", -2.0),
        ]);
        assert!(error.unwrap_err().contains("checker.time"));
        assert_eq!(parameters.get("checker.tolerance"), Double(0.25));
        let both = vec![
            parameter("checker.tolerance", 2.0),
            parameter("checker.time", 3.0),
        ];
        parameters.set_all(both).unwrap();
        assert_eq!(parameters.get("checker.tolerance"), Double(2.0));
        assert_eq!(parameters.get("checker.time"), Double(3.0));
    }

    #[test]
    fn parameters_are_listed_and_described() {
        let parameters = parameters();
        let below = |prefix: &str| parameters.list(&[prefix.to_owned()], 0);
        assert_eq!(below("checker").len(), 2);
        assert!(below("check").is_empty());
        assert_eq!(below("use_sim_time"), ["use_sim_time"]);
        assert_eq!(parameters.list(&[], 1), ["use_sim_time"]);
        assert_eq!(parameters.list(&[], 0).len(), parameters.all().len());
        let range = parameters.describe("checker.time").floating_point_range;
        assert_eq!((range[0].from_value, range[0].to_value), (0.1, 60.0));
        assert!(parameters.describe("use_sim_time").read_only);
        assert_eq!(parameters.get("no_such"), NotSet);
    }
}
