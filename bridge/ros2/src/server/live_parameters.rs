//! The node's parameters in the live view: shown there, and set by the checks of the node.

use crate::node::RosNode;
use crate::node::parameters::Parameters;
use crate::node::services::NodeServices;
use ros2_client::parameters::{Parameter, ParameterValue};
use serde_json::{Value, json};
use sidehill_recording::live::{ParameterOwner, Values};

/// Answers the requests of live clients, and shows the parameters after each change; returns whether one was
/// set. `changed` says whether a ROS client has set one.
pub(super) fn serve(
    owner: &ParameterOwner,
    services: &mut NodeServices,
    node: &mut RosNode,
    changed: bool,
) -> bool {
    let mut set = false;
    while let Some(request) = owner.next_request() {
        let given = read(&request.values, &services.parameters);
        let result = services.set(node, given);
        if result.is_ok() {
            set = true;
            // Before the answer, after which the client looks.
            owner.publish(values(&services.parameters));
        }
        request.answer(result);
    }
    if changed {
        owner.publish(values(&services.parameters));
    }
    set
}

/// Returns the parameters as the live view shows them.
pub(super) fn values(parameters: &Parameters) -> Values {
    let all = parameters.all().into_iter();
    all.map(|Parameter { name, value }| (name, to_json(value)))
        .collect()
}

/// Returns what was given with the types that the parameters have: JSON has one type of numbers.
fn read(given: &Values, parameters: &Parameters) -> Vec<Parameter> {
    let given = given.iter().map(|(name, value)| {
        let now = parameters.get(name);
        let value = match (&now, value) {
            (ParameterValue::Double(_), Value::Number(number)) => {
                number.as_f64().map(ParameterValue::Double)
            }
            (_, value) if to_json(now.clone()) == *value => Some(now),
            (_, Value::Bool(on)) => Some(ParameterValue::Boolean(*on)),
            (_, Value::String(text)) => Some(ParameterValue::String(text.clone())),
            (_, Value::Number(number)) => number.as_i64().map(ParameterValue::Integer),
            _ => None,
        };
        Parameter {
            name: name.clone(),
            value: value.unwrap_or(ParameterValue::NotSet),
        }
    });
    given.collect()
}

fn to_json(value: ParameterValue) -> Value {
    match value {
        ParameterValue::NotSet => Value::Null,
        ParameterValue::Boolean(on) => json!(on),
        ParameterValue::Integer(whole) => json!(whole),
        ParameterValue::Double(number) => json!(number),
        ParameterValue::String(text) => json!(text),
        ParameterValue::ByteArray(bytes) => json!(bytes),
        ParameterValue::BooleanArray(all) => json!(all),
        ParameterValue::IntegerArray(all) => json!(all),
        ParameterValue::DoubleArray(all) => json!(all),
        ParameterValue::StringArray(all) => json!(all),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_read_as_the_parameter_has_them() {
        let mut parameters = Parameters::default();
        parameters.declare_double("speed", 1.0, 0.01..=20.0, "m/s");
        parameters.declare_read_only("use_sim_time", ParameterValue::Boolean(false), "");
        assert_eq!(values(&parameters)["speed"], json!(1.0));
        for (name, value, allowed) in [
            ("speed", json!(2), true),
            ("speed", json!(0.5), true),
            ("speed", json!(50), false),
            ("speed", json!("fast"), false),
            ("speed", json!(null), false),
            ("use_sim_time", json!(false), true),
            ("use_sim_time", json!(true), false),
            ("arm", json!(true), false),
        ] {
            let given = Values::from([(name.to_owned(), value.clone())]);
            let given = read(&given, &parameters);
            let result = parameters.set_all(given);
            assert_eq!(result.is_ok(), allowed, "{name} {value}");
        }
        assert_eq!(parameters.double("speed", 0.0), 0.5);
    }
}
