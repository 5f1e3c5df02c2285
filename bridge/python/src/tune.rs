//! Search of settings.

use crate::arguments::{from_json, kind, shown};
use crate::campaign::campaign_file;
use crate::errors::{failed, guarded, invalid};
use crate::scenario::Scenario;
use pyo3::prelude::*;
use sidehill::config::Campaign;
use sidehill::tune::{DEFAULT_KEYS, Options, tune as search};
use std::cell::Cell;

/// Searches settings as `sidehill tune` does; `sidehill.tune` documents it.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "named ones in Python")]
pub fn tune<'py>(
    py: Python<'py>,
    campaign: &Bound<'py, PyAny>,
    controller: &Bound<'py, PyAny>,
    keys: Option<Vec<String>>,
    factor: f64,
    calmness: f64,
    training: u32,
    held_out: u32,
    tries: u32,
    minutes: f64,
    threads: Option<usize>,
) -> PyResult<Bound<'py, PyAny>> {
    let file = match campaign.cast::<Scenario>() {
        Ok(scenario) => scenario.get().file().clone(),
        Err(_) => campaign_file(campaign)?,
    };
    let keys = keys.unwrap_or_else(|| DEFAULT_KEYS.map(str::to_owned).into());
    if keys.is_empty() {
        return Err(invalid(format!(
            "keys: {} is empty",
            shown(&keys.into_pyobject(py)?)
        )));
    }
    let options = Options {
        controller: Some(kind("controller", controller)?),
        keys,
        factor,
        calmness,
        training,
        held_out,
        tries,
        minutes,
        threads,
    };
    let outcome = guarded(py, || {
        let campaign = Campaign::read_any(&file).map_err(failed)?;
        let interrupt = Cell::new(None);
        let found = search(&campaign, &options, None, |_, _| {
            Python::attach(|py| py.check_signals()).map_err(|error| {
                interrupt.set(Some(error));
                anyhow::anyhow!("interrupted")
            })
        });
        match interrupt.take() {
            Some(error) => Err(error),
            None => found.map_err(failed),
        }
    })?;
    from_json(py, &serde_json::to_string(&outcome).map_err(failed)?)
}
