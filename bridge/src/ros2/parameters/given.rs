use super::Parameters;
use crate::ros2::config::Ros2Config;
use ros2_client::parameters::{Parameter, ParameterValue};

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
        if parameters.may_change(name) {
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
