use serde_yaml::{Mapping, Value};

/// Replaces keys of `into` by those of `keys`; `controller` is merged key by key.
pub(super) fn overlay(into: &mut Mapping, keys: &Mapping) {
    for (key, value) in keys {
        match (into.get_mut(key), value) {
            (Some(Value::Mapping(old)), Value::Mapping(new)) if key == "controller" => {
                merge(old, new);
            }
            _ => {
                into.insert(key.clone(), value.clone());
            }
        }
    }
}

/// Merges `new` into `old`, key by key, down to single values.
fn merge(old: &mut Mapping, new: &Mapping) {
    for (key, value) in new {
        match (old.get_mut(key), value) {
            (Some(Value::Mapping(old)), Value::Mapping(new)) => merge(old, new),
            _ => {
                old.insert(key.clone(), value.clone());
            }
        }
    }
}
