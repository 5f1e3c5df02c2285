//! Values that a campaign draws for keys of its scenario.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;
use serde::{Deserialize, Serialize};
use serde_yaml::{Mapping, Value};

/// The distribution of one key of the scenario.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Draw {
    /// The key, nested keys separated by dots.
    pub(super) key: String,
    /// Uniformly distributed from the first to the second number.
    #[serde(default)]
    uniform: Option<[f64; 2]>,
    /// One of these, all equally likely.
    #[serde(default)]
    pub(super) one_of: Option<Vec<Value>>,
}

impl Draw {
    /// Checks that something can be drawn.
    pub(super) fn check(&self) -> Result<(), String> {
        let key = &self.key;
        match (&self.uniform, &self.one_of) {
            (Some([from, to]), None) if from.is_finite() && to.is_finite() && from <= to => Ok(()),
            (Some([from, to]), None) => Err(format!(
                "draws: {key}: uniform [{from}, {to}] is out of range, must be two numbers in order"
            )),
            (None, Some(values)) if !values.is_empty() => Ok(()),
            _ => Err(format!(
                "draws: {key}: either uniform or one_of is needed, with something in it"
            )),
        }
    }

    /// Draws a value.
    pub(super) fn value(&self, random: &mut ChaCha8Rng) -> Value {
        // A number in [0, 1) has 53 bits.
        let share = (random.next_u64() >> 11) as f64 * (-53.0_f64).exp2();
        match (&self.uniform, &self.one_of) {
            (Some([from, to]), _) => Value::from(from + share * (to - from)),
            (None, Some(values)) => values[(share * values.len() as f64) as usize].clone(),
            (None, None) => Value::Null,
        }
    }
}

/// Sets a nested key, given with dots, and adds missing mappings.
pub(crate) fn put(keys: &mut Mapping, key: &str, value: &Value) {
    let Some((first, rest)) = key.split_once('.') else {
        keys.insert(Value::from(key), value.clone());
        return;
    };
    let inner = keys
        .entry(Value::from(first))
        .or_insert_with(|| Value::Mapping(Mapping::new()));
    if !inner.is_mapping() {
        *inner = Value::Mapping(Mapping::new());
    }
    if let Value::Mapping(inner) = inner {
        put(inner, rest, value);
    }
}

/// Returns the value of a nested key, given with dots.
pub(crate) fn find<'a>(keys: &'a Mapping, key: &str) -> Option<&'a Value> {
    match key.split_once('.') {
        None => keys.get(key),
        Some((first, rest)) => find(keys.get(first)?.as_mapping()?, rest),
    }
}
