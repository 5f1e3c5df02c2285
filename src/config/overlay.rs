use super::draws::put;
use serde_yaml::{Mapping, Value};

/// Replaces keys of `into` by those of `keys`, nested ones named with dots; `controller` is merged key by key.
pub(super) fn overlay(into: &mut Mapping, keys: &Mapping) {
    overlay_merging(into, keys, |key| key == "controller");
}

/// Returns `keys` with `changes`, nested ones named with dots or in mappings, which are merged key by key.
pub fn changed(mut keys: Mapping, changes: &Mapping) -> Mapping {
    overlay_merging(&mut keys, changes, |_| true);
    keys
}

fn overlay_merging(into: &mut Mapping, keys: &Mapping, merges: impl Fn(&Value) -> bool) {
    for (key, value) in keys {
        if let Some(dotted) = key.as_str().filter(|key| key.contains('.')) {
            put(into, dotted, value);
            continue;
        }
        match (into.get_mut(key), value) {
            (Some(Value::Mapping(old)), Value::Mapping(new)) if merges(key) => {
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
