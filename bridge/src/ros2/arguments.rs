//! `--ros-args` and the environment variables of ROS 2.

use std::path::PathBuf;

/// What is wrong with an argument or a variable.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ArgumentError {
    /// An argument that is not known.
    #[error("--ros-args: {argument} is not known")]
    Unknown {
        /// The argument.
        argument: String,
    },
    /// An argument without its value.
    #[error("--ros-args: {argument} needs a value")]
    NoValue {
        /// The argument.
        argument: String,
    },
    /// A value that is not of the form it must have.
    #[error("--ros-args: {argument} {value} must be {form}")]
    Form {
        /// The argument.
        argument: String,
        /// Its value.
        value: String,
        /// What it must be.
        form: &'static str,
    },
    /// An environment variable with a value that cannot be used.
    #[error("{variable}={value} must be {allowed}")]
    Variable {
        /// Its name.
        variable: &'static str,
        /// Its value.
        value: String,
        /// What is allowed.
        allowed: &'static str,
    },
}

/// `[node:]from:=to`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Rule {
    /// The node it is for; every node where there is none.
    pub node: Option<String>,
    /// What is renamed or set.
    pub from: String,
    /// Its new name, or its value as YAML.
    pub to: String,
}

/// The arguments after `--ros-args`.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct RosArguments {
    /// `-r`, among them `__node` and `__ns`.
    pub remaps: Vec<Rule>,
    /// `--params-file`, in their order.
    pub parameter_files: Vec<PathBuf>,
    /// `-p`, in their order; stronger than files.
    pub parameters: Vec<Rule>,
}

/// Returns a program's own arguments and those of ROS, which stand from `--ros-args` to `--` or to
/// the end.
pub fn split(arguments: impl IntoIterator<Item = String>) -> (Vec<String>, Vec<String>) {
    let (mut own, mut ros, mut in_ros) = (Vec::new(), Vec::new(), false);
    for argument in arguments {
        match argument.as_str() {
            "--ros-args" => in_ros = true,
            "--" if in_ros => in_ros = false,
            _ if in_ros => ros.push(argument),
            _ => own.push(argument),
        }
    }
    (own, ros)
}

impl RosArguments {
    /// Reads what [`split`] has found. Arguments about logging and enclaves are read and have no
    /// effect.
    ///
    /// # Errors
    /// [`ArgumentError`] with the argument that is wrong.
    pub fn parse(arguments: &[String]) -> Result<Self, ArgumentError> {
        let mut parsed = Self::default();
        let mut rest = arguments.iter();
        while let Some(argument) = rest.next() {
            // `--remap=x` is `--remap x`.
            let (name, attached) = match argument.split_once('=') {
                Some((name, value)) if name.starts_with("--") && !name.ends_with(':') => {
                    (name, Some(value.to_owned()))
                }
                _ => (argument.as_str(), None),
            };
            let mut value = || {
                attached
                    .clone()
                    .or_else(|| rest.next().cloned())
                    .ok_or_else(|| ArgumentError::NoValue {
                        argument: name.to_owned(),
                    })
            };
            match name {
                "-r" | "--remap" => parsed.remaps.push(rule(name, &value()?)?),
                "-p" | "--param" => parsed.parameters.push(rule(name, &value()?)?),
                "--params-file" => parsed.parameter_files.push(value()?.into()),
                "-e" | "--enclave" | "--log-level" | "--log-config-file" | "--log-file-name" => {
                    value()?;
                }
                "--enable-rosout-logs"
                | "--disable-rosout-logs"
                | "--enable-stdout-logs"
                | "--disable-stdout-logs"
                | "--enable-external-lib-logs"
                | "--disable-external-lib-logs" => {}
                _ => {
                    return Err(ArgumentError::Unknown {
                        argument: argument.clone(),
                    });
                }
            }
        }
        Ok(parsed)
    }
}

fn rule(argument: &str, text: &str) -> Result<Rule, ArgumentError> {
    let fault = || ArgumentError::Form {
        argument: argument.to_owned(),
        value: text.to_owned(),
        form: "[NODE:]NAME:=VALUE",
    };
    let (left, to) = text.split_once(":=").ok_or_else(fault)?;
    let (node, from) = match left.split_once(':') {
        Some((node, from)) => (Some(node.to_owned()), from),
        None => (None, left),
    };
    if from.is_empty() || to.is_empty() || node.as_deref() == Some("") {
        return Err(fault());
    }
    Ok(Rule {
        node,
        from: from.to_owned(),
        to: to.to_owned(),
    })
}

/// How a service is mapped to topics, which differs by the middleware of its peers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ServiceMapping {
    /// As Fast DDS.
    Enhanced,
    /// As Cyclone DDS.
    Cyclone,
}

/// What the environment says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RosEnvironment {
    /// `ROS_DOMAIN_ID`, 0 where there is none.
    pub domain_id: u16,
    /// How services are mapped to topics, by `RMW_IMPLEMENTATION`; that of Fast DDS, the default of
    /// ROS 2, where there is none.
    pub service_mapping: ServiceMapping,
    /// Whether to reach this machine only.
    pub loopback_only: bool,
}

impl RosEnvironment {
    /// Reads the variables that `get` knows by name.
    ///
    /// # Errors
    /// [`ArgumentError::Variable`] for a value that cannot be used.
    pub fn from_variables(
        get: impl Fn(&'static str) -> Option<String>,
    ) -> Result<Self, ArgumentError> {
        let read = |variable| get(variable).filter(|value| !value.is_empty());
        let fault = |variable, value, allowed| ArgumentError::Variable {
            variable,
            value,
            allowed,
        };
        let domain_id = match read("ROS_DOMAIN_ID") {
            None => 0,
            Some(value) => match value.trim().parse() {
                Ok(id @ 0..=232) => id,
                _ => {
                    return Err(fault("ROS_DOMAIN_ID", value, "a number from 0 to 232"));
                }
            },
        };
        let service_mapping = match read("RMW_IMPLEMENTATION") {
            None => ServiceMapping::Enhanced,
            Some(value) => match value.as_str() {
                "rmw_fastrtps_cpp" | "rmw_fastrtps_dynamic_cpp" => ServiceMapping::Enhanced,
                "rmw_cyclonedds_cpp" => ServiceMapping::Cyclone,
                _ => {
                    return Err(fault(
                        "RMW_IMPLEMENTATION",
                        value,
                        "rmw_fastrtps_cpp, rmw_fastrtps_dynamic_cpp or rmw_cyclonedds_cpp",
                    ));
                }
            },
        };
        let localhost_only = match read("ROS_LOCALHOST_ONLY").as_deref() {
            None | Some("0") => false,
            Some("1") => true,
            Some(value) => {
                return Err(fault("ROS_LOCALHOST_ONLY", value.to_owned(), "0 or 1"));
            }
        };
        let range = match read("ROS_AUTOMATIC_DISCOVERY_RANGE").as_deref() {
            None | Some("SUBNET" | "SYSTEM_DEFAULT") => false,
            Some("LOCALHOST") => true,
            Some(value) => {
                return Err(fault(
                    "ROS_AUTOMATIC_DISCOVERY_RANGE",
                    value.to_owned(),
                    "LOCALHOST, SUBNET or SYSTEM_DEFAULT",
                ));
            }
        };
        Ok(Self {
            domain_id,
            service_mapping,
            loopback_only: localhost_only || range,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn words(text: &str) -> Vec<String> {
        text.split_whitespace().map(str::to_owned).collect()
    }

    #[test]
    fn what_a_launch_file_passes_is_split_and_read() {
        let (own, ros) = split(words(
            "run x.yaml --ros-args -r __node:=c --remap=cmd_vel:=/out --params-file /tmp/p.yaml \
             -p a.b:=1.5 -p other:use_sim_time:=true --log-level info -- --arm",
        ));
        assert_eq!(own, words("run x.yaml --arm"));
        let read = RosArguments::parse(&ros).unwrap();
        assert_eq!(read.remaps.len(), 2);
        assert_eq!(read.remaps[1].from, "cmd_vel");
        assert_eq!(read.remaps[1].to, "/out");
        assert_eq!(read.parameter_files, [PathBuf::from("/tmp/p.yaml")]);
        assert_eq!(read.parameters[0].from, "a.b");
        assert_eq!(read.parameters[1].node.as_deref(), Some("other"));
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (text, named) in [
            ("--no-such", "--no-such"),
            ("-r", "-r needs a value"),
            ("-r cmd_vel=/out", "cmd_vel=/out must be"),
            ("-p :=1", ":=1 must be"),
        ] {
            let error = RosArguments::parse(&words(text)).unwrap_err().to_string();
            assert!(error.contains(named), "{error}");
        }
    }

    #[test]
    fn the_environment_chooses_domain_mapping_and_reach() {
        let with = |pairs: &'static [(&str, &str)]| {
            RosEnvironment::from_variables(move |name| {
                let found = pairs.iter().find(|(variable, _)| *variable == name);
                found.map(|(_, value)| (*value).to_owned())
            })
        };
        let plain = with(&[]).unwrap();
        assert_eq!(plain.domain_id, 0);
        assert_eq!(plain.service_mapping, ServiceMapping::Enhanced);
        assert!(!plain.loopback_only);
        let set = with(&[
            ("ROS_DOMAIN_ID", "42"),
            ("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp"),
            ("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST"),
        ])
        .unwrap();
        assert_eq!(set.domain_id, 42);
        assert_eq!(set.service_mapping, ServiceMapping::Cyclone);
        assert!(set.loopback_only);
        for (wrong, named) in [
            (with(&[("ROS_DOMAIN_ID", "233")]), "ROS_DOMAIN_ID=233"),
            (
                with(&[("RMW_IMPLEMENTATION", "rmw_zenoh_cpp")]),
                "rmw_zenoh_cpp",
            ),
        ] {
            assert!(wrong.unwrap_err().to_string().contains(named));
        }
    }
}
