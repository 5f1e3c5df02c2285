//! Names of a node, its topics and its services after namespaces and remaps.

use super::arguments::Rule;
use ros2_client::{Name, NodeName};

/// An invalid name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct NameError {
    /// The name.
    pub name: String,
    /// Why it is invalid.
    pub reason: String,
}

/// A node's name and its remap rules.
#[derive(Debug, Clone)]
pub struct Names {
    node: NodeName,
    remaps: Vec<Rule>,
}

impl Names {
    /// Returns the names of a node called `name` in `namespace` unless a rule renames it.
    ///
    /// # Errors
    /// [`NameError`] where the node's name or namespace is invalid.
    pub fn new(name: &str, namespace: &str, remaps: &[Rule]) -> Result<Self, NameError> {
        let find = |special: &[&str]| {
            remaps
                .iter()
                .find(|rule| {
                    special.contains(&rule.from.as_str())
                        && rule.node.as_deref().is_none_or(|node| node == name)
                })
                .map(|rule| rule.to.as_str())
        };
        let base = find(&["__node", "__name"]).unwrap_or(name);
        let namespace = find(&["__ns"]).unwrap_or(namespace);
        let node = NodeName::new(namespace, base).map_err(|error| NameError {
            name: format!("{namespace} {base}"),
            reason: error.to_string(),
        })?;
        let remaps = remaps
            .iter()
            .filter(|rule| !rule.from.starts_with("__"))
            .filter(|rule| {
                let for_node = rule.node.as_deref();
                for_node.is_none_or(|for_node| for_node == base || for_node == name)
            })
            .cloned()
            .collect();
        Ok(Self { node, remaps })
    }

    /// Returns the node's name.
    pub fn node(&self) -> &NodeName {
        &self.node
    }

    /// Returns the fully qualified name of a topic, service or action after remaps: `/x` is absolute, `x`
    /// in the namespace, `~/x` below the node.
    ///
    /// # Errors
    /// [`NameError`] for an invalid name.
    pub fn resolve(&self, name: &str) -> Result<Name, NameError> {
        let whole = self.expand(name);
        let renamed = self
            .remaps
            .iter()
            .find(|rule| self.expand(&rule.from) == whole)
            .map_or(whole, |rule| self.expand(&rule.to));
        Name::parse(&renamed).map_err(|error| NameError {
            name: renamed,
            reason: error.to_string(),
        })
    }

    fn expand(&self, name: &str) -> String {
        let below = |folder: &str, name: &str| match folder {
            "/" => format!("/{name}"),
            _ => format!("{folder}/{name}"),
        };
        match name.strip_prefix('~') {
            Some(private) => below(
                &self.node.fully_qualified_name(),
                private.trim_start_matches('/'),
            ),
            None if name.starts_with('/') => name.to_owned(),
            None => below(self.node.namespace(), name),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::arguments::RosArguments;
    use super::*;

    fn names(rules: &[&str]) -> Names {
        let words: Vec<_> = rules
            .iter()
            .flat_map(|rule| ["-r".to_owned(), (*rule).to_owned()])
            .collect();
        Names::new("rover", "/", &RosArguments::parse(&words).unwrap().remaps).unwrap()
    }

    #[track_caller]
    fn becomes(names: &Names, name: &str, whole: &str) {
        assert_eq!(names.resolve(name).unwrap().to_string(), whole);
    }

    #[test]
    fn names_follow_namespace_node_and_remaps() {
        let plain = names(&[]);
        becomes(&plain, "odom", "/odom");
        becomes(&plain, "~/state", "/rover/state");
        let moved = names(&[
            "__ns:=/j8",
            "__node:=front",
            "odom:=/odometry/filtered",
            "front:imu:=ahrs",
            "other:imu:=wrong",
            "/tf:=tf",
        ]);
        assert_eq!(moved.node().fully_qualified_name(), "/j8/front");
        becomes(&moved, "odom", "/odometry/filtered");
        becomes(&moved, "/j8/odom", "/odometry/filtered");
        becomes(&moved, "imu", "/j8/ahrs");
        becomes(&moved, "/tf", "/j8/tf");
        becomes(&moved, "~/state", "/j8/front/state");
    }

    #[test]
    fn an_invalid_name_is_reported() {
        let fault = names(&["odom:=a//b"]).resolve("odom").unwrap_err();
        assert!(fault.to_string().contains("/a//b"), "{fault}");
        assert!(Names::new("no-dash", "/", &[]).is_err());
    }
}
