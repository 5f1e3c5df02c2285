//! Values that a campaign draws for keys of its scenario.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::Rng;
use serde::{Deserialize, Serialize};
use serde_yaml::{Mapping, Value};

/// The distribution of one key of the scenario.
#[derive(Debug, Clone, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Draw {
    /// Key of the scenario, with dots between nested ones.
    pub(super) key: String,
    /// Two numbers: drawn uniformly between them.
    #[serde(default)]
    uniform: Option<[f64; 2]>,
    /// Two positive numbers: drawn between them, with uniformly distributed logarithms.
    #[serde(default)]
    log_uniform: Option<[f64; 2]>,
    /// A list: each value is as likely as the others.
    #[serde(default)]
    pub(super) one_of: Option<Vec<Value>>,
}

impl Draw {
    /// Checks that something can be drawn.
    pub(super) fn check(&self) -> Result<(), String> {
        let key = &self.key;
        let several = [
            self.uniform.is_some(),
            self.log_uniform.is_some(),
            self.one_of.is_some(),
        ];
        if several.into_iter().filter(|given| *given).count() != 1 {
            return Err(format!(
                "draws: {key}: one of uniform, log_uniform and one_of is needed"
            ));
        }
        let wrong = |error: String| format!("draws: {key}: {error}");
        if let Some(range) = self.range() {
            return range.check().map_err(wrong);
        }
        match &self.one_of {
            Some(values) if !values.is_empty() => {
                values.iter().try_for_each(check_ranges).map_err(wrong)
            }
            _ => Err(wrong("one_of is empty".to_owned())),
        }
    }

    fn range(&self) -> Option<Range> {
        let uniform = self.uniform.map(Range::Uniform);
        uniform.or(self.log_uniform.map(Range::LogUniform))
    }

    /// Draws a value.
    pub(super) fn value(&self, random: &mut ChaCha8Rng) -> Value {
        // A number in [0, 1) has 53 bits.
        let mut share = || (random.next_u64() >> 11) as f64 * (-53.0_f64).exp2();
        match (self.range(), &self.one_of) {
            (Some(range), _) => Value::from(range.at(share())),
            (None, Some(values)) => {
                let chosen = &values[(share() * values.len() as f64) as usize];
                with_numbers(chosen, &mut share)
            }
            (None, None) => Value::Null,
        }
    }

    /// Returns each value of `one_of` with the middle of the ranges in it.
    pub(super) fn choices(&self) -> impl Iterator<Item = Value> {
        let values = self.one_of.iter().flatten();
        values.map(|value| with_numbers(value, &mut || 0.5))
    }
}

/// A distribution of a number.
enum Range {
    Uniform([f64; 2]),
    LogUniform([f64; 2]),
}

impl Range {
    /// Returns the range that a value stands for, if it is a mapping with its name alone.
    fn of(value: &Value) -> Option<Self> {
        let mapping = value.as_mapping().filter(|mapping| mapping.len() == 1)?;
        let (key, numbers) = mapping.iter().next()?;
        let kind = match key.as_str()? {
            "uniform" => Self::Uniform,
            "log_uniform" => Self::LogUniform,
            _ => return None,
        };
        let numbers: Option<Vec<f64>> = numbers.as_sequence()?.iter().map(Value::as_f64).collect();
        // Anything else is out of range.
        Some(kind(numbers?.try_into().unwrap_or([f64::NAN; 2])))
    }

    fn check(&self) -> Result<(), String> {
        match self {
            Self::Uniform([from, to]) if !(from.is_finite() && to.is_finite() && from <= to) => {
                Err(format!(
                    "uniform [{from}, {to}] is out of range, must be two numbers in order"
                ))
            }
            Self::LogUniform([from, to]) if !(*from > 0.0 && to.is_finite() && from <= to) => {
                Err(format!(
                    "log_uniform [{from}, {to}] is out of range, must be two positive numbers in order"
                ))
            }
            _ => Ok(()),
        }
    }

    /// Returns the number at a share of the distribution.
    fn at(&self, share: f64) -> f64 {
        match self {
            Self::Uniform([from, to]) => from + share * (to - from),
            Self::LogUniform([from, to]) => from * (to / from).powf(share),
        }
    }
}

fn check_ranges(value: &Value) -> Result<(), String> {
    if let Some(range) = Range::of(value) {
        return range.check();
    }
    match value {
        Value::Mapping(mapping) => mapping.values().try_for_each(check_ranges),
        Value::Sequence(values) => values.iter().try_for_each(check_ranges),
        _ => Ok(()),
    }
}

/// Returns a value with a number in place of each range.
fn with_numbers(value: &Value, share: &mut impl FnMut() -> f64) -> Value {
    if let Some(range) = Range::of(value) {
        return Value::from(range.at(share()));
    }
    match value {
        Value::Mapping(mapping) => {
            let entries = mapping.iter();
            let drawn = entries.map(|(key, value)| (key.clone(), with_numbers(value, share)));
            Value::Mapping(drawn.collect())
        }
        Value::Sequence(values) => values
            .iter()
            .map(|value| with_numbers(value, share))
            .collect(),
        other => other.clone(),
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

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::SeedableRng;

    fn drawn(yaml: &str) -> Vec<Value> {
        let draw: Draw = serde_yaml::from_str(yaml).unwrap();
        draw.check().unwrap();
        let mut random = ChaCha8Rng::seed_from_u64(1);
        (0..4000).map(|_| draw.value(&mut random)).collect()
    }

    #[test]
    fn log_uniform_numbers_have_as_many_in_each_factor() {
        let numbers = drawn("{key: a, log_uniform: [0.01, 100]}");
        let numbers: Vec<f64> = numbers
            .iter()
            .map(|value| value.as_f64().unwrap())
            .collect();
        assert!(numbers.iter().all(|number| (0.01..=100.0).contains(number)));
        for decade in [0.01, 0.1, 1.0, 10.0] {
            let within = numbers
                .iter()
                .filter(|n| (decade..10.0 * decade).contains(*n))
                .count();
            // Four standard deviations of a binomial are 110.
            assert!(within.abs_diff(1000) < 110, "{decade}: {within}");
        }
    }

    #[test]
    fn ranges_within_a_choice_are_drawn_with_it() {
        let values = drawn(
            "{key: a, one_of: [{shape: b, speed: {log_uniform: [1, 2]}}, {shape: c, d: [{uniform: [5, 6]}]}]}",
        );
        let of = |shape: &str, key: &str| -> Vec<Value> {
            let own = values.iter().filter(|value| value["shape"] == shape);
            own.map(|value| value[key].clone()).collect()
        };
        let (speeds, lists) = (of("b", "speed"), of("c", "d"));
        assert!(speeds.len().abs_diff(2000) < 130 && speeds[0] != speeds[1]);
        assert!(
            speeds
                .iter()
                .all(|v| (1.0..=2.0).contains(&v.as_f64().unwrap()))
        );
        assert!(
            lists
                .iter()
                .all(|v| (5.0..=6.0).contains(&v[0].as_f64().unwrap()))
        );
    }

    #[test]
    fn what_cannot_be_drawn_is_refused() {
        let error = |yaml: &str| {
            serde_yaml::from_str::<Draw>(yaml)
                .unwrap()
                .check()
                .unwrap_err()
        };
        assert!(error("{key: a, log_uniform: [0, 1]}").contains("two positive numbers"));
        assert!(error("{key: a, one_of: [{b: {uniform: [2, 1]}}]}").contains("in order"));
        assert!(error("{key: a, one_of: [{b: {log_uniform: [2]}}]}").contains("log_uniform"));
        assert!(error("{key: a, uniform: [1, 2], log_uniform: [1, 2]}").contains("one of uniform"));
    }
}
