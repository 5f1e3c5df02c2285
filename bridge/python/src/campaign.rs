//! Campaigns, for `sidehill.campaign` and for the engine in `sidehill.distributed`.

use crate::arguments::{file, mapping, path, shown};
use crate::errors::{failed, guarded, invalid};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use sidehill::campaign;
use sidehill::config::{self, ConfigFile};
use std::sync::Mutex;

/// Returns the file of a path, or of a dict with the YAML's keys.
pub fn campaign_file(campaign: &Bound<'_, PyAny>) -> PyResult<ConfigFile> {
    match mapping("campaign", campaign) {
        Ok(file) => Ok(file),
        Err(_) if path("campaign", campaign).is_ok() => file("campaign", campaign),
        Err(_) => Err(invalid(format!(
            "campaign: a path or a dict is needed, not {}",
            shown(campaign)
        ))),
    }
}

/// A campaign, checked with the scenario it names.
#[pyclass(frozen, module = "sidehill._sidehill")]
pub struct Campaign(config::Campaign);

#[pymethods]
impl Campaign {
    /// Returns the campaign of a YAML file, or of a dict with its keys, whose names of files are relative to
    /// the working folder. Raises OSError, or ValueError with file, key, value and range.
    #[staticmethod]
    fn read(py: Python<'_>, campaign: &Bound<'_, PyAny>) -> PyResult<Self> {
        let file = campaign_file(campaign)?;
        guarded(py, || {
            config::Campaign::read(&file).map(Self).map_err(failed)
        })
    }

    /// Returns the campaign of the text that `bundle` gave, on whatever machine.
    #[staticmethod]
    fn from_bundle(py: Python<'_>, bundle: &str) -> PyResult<Self> {
        guarded(py, || {
            config::Campaign::from_bundle(bundle)
                .map(Self)
                .map_err(failed)
        })
    }

    /// Returns the campaign with the files that it names, as text.
    fn bundle(&self, py: Python<'_>) -> PyResult<String> {
        guarded(py, || self.0.bundle().map_err(failed))
    }

    /// Name for tables.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Runs of each controller.
    #[getter]
    fn runs(&self) -> u32 {
        self.0.runs
    }

    /// Names of the controllers.
    #[getter]
    fn controllers(&self) -> Vec<&'static str> {
        self.0.controllers.iter().map(|kind| kind.name()).collect()
    }

    /// Keys that are drawn.
    #[getter]
    fn keys(&self) -> Vec<&str> {
        self.0.keys().collect()
    }

    /// Returns the results of the runs from start to stop - 1 as the text of a file, in order.
    #[pyo3(signature = (start, stop, threads=None))]
    fn csv<'py>(
        &self,
        py: Python<'py>,
        start: u32,
        stop: u32,
        threads: Option<usize>,
    ) -> PyResult<Bound<'py, PyBytes>> {
        let text = guarded(py, || {
            campaign::csv(&self.0, start..stop, threads).map_err(failed)
        })?;
        Ok(PyBytes::new(py, &text))
    }
}

/// A file of results that tasks fill, locked against a second campaign.
#[pyclass(frozen, module = "sidehill._sidehill")]
pub struct Results(Mutex<Option<campaign::Results>>);

impl Results {
    fn with<T>(&self, work: impl FnOnce(&campaign::Results) -> PyResult<T>) -> PyResult<T> {
        let results = self.0.lock().map_err(|_| closed())?;
        work(results.as_ref().ok_or_else(closed)?)
    }
}

fn closed() -> PyErr {
    PyRuntimeError::new_err("the results are finished")
}

#[pymethods]
impl Results {
    /// Opens a file of results or begins one; a torn last line is cut off.
    #[new]
    fn new(path: &Bound<'_, PyAny>, campaign: &Campaign) -> PyResult<Self> {
        let path = self::path("out", path)?;
        let results = campaign::Results::open(&path, &campaign.0).map_err(failed)?;
        Ok(Self(Mutex::new(Some(results))))
    }

    /// Returns which of the runs from start to stop - 1 lack a controller.
    fn missing(&self, campaign: &Campaign, start: u32, stop: u32) -> PyResult<Vec<u32>> {
        self.with(|results| {
            let kinds = &campaign.0.controllers;
            let lacks = |index: &u32| kinds.iter().any(|&kind| !results.holds(*index, kind));
            Ok((start..stop).filter(lacks).collect())
        })
    }

    /// Writes the rows of a text that `Campaign.csv` gave and waits until they are on the disk.
    fn append(&self, py: Python<'_>, csv: &[u8]) -> PyResult<()> {
        guarded(py, || {
            self.with(|results| results.append_csv(csv).map_err(failed))
        })
    }

    /// Replaces the file by its rows in order, each once, and closes it.
    fn finish(&self, py: Python<'_>) -> PyResult<()> {
        guarded(py, || {
            let results = self.0.lock().map_err(|_| closed())?.take();
            let results = results.ok_or_else(closed)?;
            results.finish().map(drop).map_err(failed)
        })
    }
}
