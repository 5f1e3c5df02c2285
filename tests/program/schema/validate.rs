//! Whether a value fits a schema.

use serde_json::Value;

/// Returns why a value does not match a schema, if it does not; supports the features used here.
pub(super) fn misfit(root: &Value, schema: &Value, value: &Value, at: &str) -> Option<String> {
    for (keyword, rule) in schema.as_object().unwrap() {
        let misfit = match keyword.as_str() {
            "$schema" | "title" | "description" | "definitions" => None,
            "$ref" => {
                let name = rule.as_str().unwrap().strip_prefix("#").unwrap();
                misfit(root, root.pointer(name).unwrap(), value, at)
            }
            "anyOf" => {
                let tried: Vec<_> = rule
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(|schema| misfit(root, schema, value, at))
                    .collect();
                tried
                    .iter()
                    .all(Option::is_some)
                    .then(|| format!("{at}: {tried:?}"))
            }
            "type" => {
                let fits = match rule.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "string" => value.is_string(),
                    "boolean" => value.is_boolean(),
                    "number" => value.is_number(),
                    "integer" => value.is_i64() || value.is_u64(),
                    other => panic!("type {other}"),
                };
                (!fits).then(|| format!("{at}: {value} is no {rule}"))
            }
            "enum" => (!rule.as_array().unwrap().contains(value))
                .then(|| format!("{at}: {value} is not in {rule}")),
            "minimum" => value
                .as_f64()
                .filter(|n| *n < rule.as_f64().unwrap())
                .map(|n| format!("{at}: {n} < {rule}")),
            "maximum" => value
                .as_f64()
                .filter(|n| *n > rule.as_f64().unwrap())
                .map(|n| format!("{at}: {n} > {rule}")),
            "items" => value.as_array().and_then(|items| {
                items
                    .iter()
                    .enumerate()
                    .find_map(|(i, item)| misfit(root, rule, item, &format!("{at}.{i}")))
            }),
            "properties" => value.as_object().and_then(|value| {
                value.iter().find_map(|(key, value)| {
                    misfit(root, rule.get(key)?, value, &format!("{at}.{key}"))
                })
            }),
            "required" => {
                let keys = rule.as_array().unwrap().iter();
                keys.filter(|key| value.get(key.as_str().unwrap()).is_none())
                    .map(|key| format!("{at}: {key} is missing"))
                    .next()
            }
            "additionalProperties" => value.as_object().and_then(|value| {
                let known = schema["properties"].as_object().unwrap();
                value
                    .keys()
                    .find(|key| !known.contains_key(*key))
                    .map(|key| format!("{at}: {key} is not known"))
            }),
            other => panic!("keyword {other}"),
        };
        if misfit.is_some() {
            return misfit;
        }
    }
    None
}
