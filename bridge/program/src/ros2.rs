//! Settings of a node from `--ros-args` and the environment.

use sidehill::config::{ConfigError, ConfigFile};
use sidehill_bridge::ros2::arguments::{ArgumentError, RosArguments, RosEnvironment};
use sidehill_bridge::ros2::names::Names;
use sidehill_ros2::node::parameter_file::{Parameter, ParameterFile, Value};

/// Returns the ROS 2 environment of this process.
///
/// # Errors
/// [`ArgumentError`] for an invalid variable.
pub fn environment() -> Result<RosEnvironment, ArgumentError> {
    RosEnvironment::from_variables(|name| std::env::var(name).ok())
}

/// Returns the parameters of a node from files and `-p`; later ones take precedence.
///
/// # Errors
/// [`ConfigError`] with the file or argument that is wrong.
pub fn parameters(arguments: &RosArguments, names: &Names) -> Result<Vec<Parameter>, ConfigError> {
    let mut parameters = Vec::new();
    for path in &arguments.parameter_files {
        let file: ParameterFile = ConfigFile::read(path)?.parse()?;
        parameters.extend(file.for_node(names.node()));
    }
    let own = names.node().base_name();
    for rule in &arguments.parameters {
        if rule.node.as_deref().is_none_or(|node| node == own) {
            let name = format!("-p {}", rule.from);
            let value: Value = ConfigFile::with_text(name.as_ref(), rule.to.clone()).parse()?;
            parameters.push(Parameter {
                name: rule.from.clone(),
                value: value.into(),
            });
        }
    }
    Ok(parameters)
}
