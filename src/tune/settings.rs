//! The searched settings of a controller.

use crate::config::{find, put};
use anyhow::{Context, Result, bail};
use serde::Serialize;
use serde_yaml::{Mapping, Value};

/// Settings searched by default: how strongly the MPC corrects errors, how calmly it steers, and how fast its estimate
/// follows the poses.
pub const DEFAULT_KEYS: [&str; 6] = [
    "weights.cross_per_m2",
    "weights.speed",
    "weights.steer_change_s3_per_m2",
    "weights.heading_per_rad2",
    "estimator.slide_sigma_m_per_sqrt_s",
    "estimator.yaw_sigma_rad_per_sqrt_s",
];

/// A setting with its value before and after.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Setting {
    /// Key within the section `controller`, with dots.
    pub key: String,
    /// Present value.
    pub before: f64,
    /// Value found.
    pub after: f64,
}

impl Setting {
    /// Returns the settings with these keys and their values in `present`, the settings of the controller. `is_drawn`
    /// tells whether a campaign draws a key.
    ///
    /// # Errors
    /// Names the key that is unknown, is not a positive number, is drawn by the campaign, or occurs twice.
    pub fn all(
        present: &Mapping,
        keys: &[String],
        is_drawn: impl Fn(&str) -> bool,
    ) -> Result<Vec<Self>> {
        keys.iter()
            .enumerate()
            .map(|(index, key)| {
                let value = find(present, key)
                    .with_context(|| format!("--key {key}: there is no such setting"))?;
                let before = value.as_f64().filter(|value| *value > 0.0).with_context(|| {
                    let shown = serde_json::to_string(value).unwrap_or_default();
                    format!("--key {key}: {shown} is no positive number")
                })?;
                if value.is_u64() || value.is_i64() {
                    bail!("--key {key}: {before} is a whole number; only continuous settings are searched");
                }
                let whole = format!("controller.{key}");
                if is_drawn(&whole) {
                    bail!("--key {key}: the campaign draws controller.{key}");
                }
                if keys[..index].contains(key) {
                    bail!("--key {key}: given twice");
                }
                Ok(Self {
                    key: key.clone(),
                    before,
                    after: before,
                })
            })
            .collect()
    }

    /// Returns the value times a factor; unchanged if the factor is 1.
    pub fn at(&self, factor: f64) -> f64 {
        if factor == 1.0 {
            self.before
        } else {
            self.times(factor).after
        }
    }

    /// Returns the setting changed by a factor, rounded to four digits.
    pub fn times(&self, factor: f64) -> Self {
        Self {
            after: rounded(self.before * factor),
            ..self.clone()
        }
    }
}

/// Four digits, so that typing in the printed value gives the same results.
fn rounded(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}

/// Returns the keys of a scenario with these settings, each times its factor; unchanged if the factor is 1.
pub fn mapping(settings: &[Setting], factors: &[f64]) -> Mapping {
    let mut keys = Mapping::new();
    for (setting, factor) in settings.iter().zip(factors) {
        let key = format!("controller.{}", setting.key);
        put(&mut keys, &key, &Value::from(setting.at(*factor)));
    }
    keys
}
