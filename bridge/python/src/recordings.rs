//! Replay and report of recordings, and the path of a recorded drive, with the program's arguments by their names.

use crate::arguments::{from_json, json};
use crate::errors::{failed, guarded, invalid};
use pyo3::prelude::*;
use sidehill::{drive_report, replay as replaying, route as routing};

/// Replays a recording; `sidehill.replay` documents it.
#[pyfunction]
pub fn replay<'py>(py: Python<'py>, given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let args = serde_json::from_str(&json(given)?).map_err(invalid)?;
    let found = guarded(py, || replaying::facts(&args).map_err(failed))?;
    from_json(py, &found)
}

/// Reports a recording; `sidehill.report` documents it.
#[pyfunction]
pub fn report<'py>(py: Python<'py>, given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let args = serde_json::from_str(&json(given)?).map_err(invalid)?;
    let found = guarded(py, || drive_report::facts(&args).map_err(failed))?;
    from_json(py, &found)
}

/// Writes the path of a recorded drive; `sidehill.route` documents it.
#[pyfunction]
pub fn route<'py>(py: Python<'py>, given: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
    let args = serde_json::from_str(&json(given)?).map_err(invalid)?;
    let found = guarded(py, || {
        let mut notes = Vec::new();
        let written = routing::write(&args, |note| notes.push(note)).map_err(failed)?;
        let mut written = serde_json::to_value(written).map_err(failed)?;
        written["notes"] = notes.into();
        Ok(written.to_string())
    })?;
    from_json(py, &found)
}
