//! Names of a node, its topics and its services after namespaces and remaps.

use super::arguments::Rule;

/// An invalid name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{name}: {reason}")]
pub struct NameError {
    /// The name.
    pub name: String,
    /// Why it is invalid.
    pub reason: String,
}

/// The name of a node and its namespace, which begins with a slash.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct NodeName {
    namespace: String,
    base_name: String,
}

impl NodeName {
    /// Returns the name of a node in a namespace.
    ///
    /// # Errors
    /// [`NameError`] where one of them is invalid.
    pub fn new(namespace: &str, base_name: &str) -> Result<Self, NameError> {
        let whole = format!("{namespace} {base_name}");
        let inside = match namespace {
            "/" => None,
            _ => Some(namespace.strip_prefix('/').unwrap_or("")),
        };
        let tokens = inside.into_iter().flat_map(|inside| inside.split('/'));
        for token in tokens.chain([base_name]) {
            check_token(&whole, token)?;
        }
        Ok(Self {
            namespace: namespace.to_owned(),
            base_name: base_name.to_owned(),
        })
    }

    /// Returns the namespace.
    pub fn namespace(&self) -> &str {
        &self.namespace
    }

    /// Returns the name without its namespace.
    pub fn base_name(&self) -> &str {
        &self.base_name
    }

    /// Returns the name with its namespace, such as `/j8/front`.
    pub fn fully_qualified_name(&self) -> String {
        below(&self.namespace, &self.base_name)
    }
}

/// Checks one of the parts of `name` between slashes.
fn check_token(name: &str, token: &str) -> Result<(), NameError> {
    let allowed = |c: &char| c.is_ascii_alphanumeric() || *c == '_';
    let reason = if token.is_empty() {
        "a part between slashes is empty".to_owned()
    } else if let Some(bad) = token.chars().find(|c| !allowed(c)) {
        format!("the character {bad:?} is not allowed")
    } else if token.starts_with(|c: char| c.is_ascii_digit()) {
        format!("`{token}` begins with a digit")
    } else {
        return Ok(());
    };
    Err(NameError {
        name: name.to_owned(),
        reason,
    })
}

fn below(folder: &str, name: &str) -> String {
    match folder {
        "/" => format!("/{name}"),
        _ => format!("{folder}/{name}"),
    }
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
        let node = NodeName::new(namespace, base)?;
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
    pub fn resolve(&self, name: &str) -> Result<String, NameError> {
        let whole = self.expand(name);
        let renamed = self
            .remaps
            .iter()
            .find(|rule| self.expand(&rule.from) == whole)
            .map_or(whole, |rule| self.expand(&rule.to));
        let inside = renamed.strip_prefix('/').unwrap_or(&renamed);
        for token in inside.split('/') {
            check_token(&renamed, token)?;
        }
        if renamed.contains("__") {
            return Err(NameError {
                name: renamed,
                reason: "two underscores follow each other".to_owned(),
            });
        }
        Ok(renamed)
    }

    fn expand(&self, name: &str) -> String {
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
        assert_eq!(names.resolve(name).unwrap(), whole);
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
