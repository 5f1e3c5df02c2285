//! Scenarios: vehicle, ground, course, sensors and controllers of a simulation.

use crate::arguments::{file, from_json, kind, mapping};
use crate::errors::{failed, guarded};
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::config::{ConfigFile, Overrides, Prepared};
use sidehill_controller::config::ControllerKind;
use std::path::Path;

/// A scenario, checked with all that it names; immutable.
///
/// Keys are those of the YAML (config/scenarios/figure_eight.yaml), where each has its unit. Names of other
/// files are relative to the scenario's own, those of a dict to the working folder.
#[pyclass(frozen, module = "sidehill")]
pub struct Scenario {
    file: ConfigFile,
    prepared: Prepared,
}

impl Scenario {
    fn checked(py: Python<'_>, file: ConfigFile) -> PyResult<Self> {
        guarded(py, || {
            let prepared = prepare(&file, &Overrides::default())?;
            Ok(Self { file, prepared })
        })
    }

    /// Returns the file.
    pub fn file(&self) -> &ConfigFile {
        &self.file
    }

    /// Returns the scenario with everything read and built.
    pub fn prepare(&self, overrides: &Overrides) -> PyResult<Prepared> {
        prepare(&self.file, overrides)
    }
}

fn prepare(file: &ConfigFile, overrides: &Overrides) -> PyResult<Prepared> {
    let scenario = sidehill::config::Scenario::read(file.clone()).map_err(failed)?;
    scenario.prepare(overrides).map_err(failed)
}

/// Returns the controllers of an argument, none for those of the scenario.
pub fn kinds(value: Option<&Bound<'_, PyAny>>) -> PyResult<Vec<ControllerKind>> {
    let Some(value) = value else {
        return Ok(Vec::new());
    };
    if value.extract::<String>().is_ok() {
        return Ok(vec![kind("controllers", value)?]);
    }
    let names: Vec<Bound<'_, PyAny>> = value
        .extract()
        .map_err(|_| crate::errors::invalid("controllers: a list of names is needed"))?;
    names.iter().map(|name| kind("controllers", name)).collect()
}

#[pymethods]
impl Scenario {
    /// Returns the scenario of a YAML file.
    ///
    /// Raises OSError where a file cannot be read, ValueError with file, key, value and range where its
    /// content is wrong.
    #[staticmethod]
    fn load(py: Python<'_>, path: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::checked(py, file("path", path)?)
    }

    /// Returns the scenario of a dict with the YAML's keys.
    ///
    /// Raises ValueError with key, value and range, OSError where a file that it names cannot be read.
    #[staticmethod]
    fn from_dict(py: Python<'_>, keys: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::checked(py, mapping("keys", keys)?)
    }

    /// Returns a dict with the YAML's keys, as they are given: what is left out has its default.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let keys: serde_json::Value = self.file.parse().map_err(failed)?;
        from_json(py, &keys.to_string())
    }

    /// Returns the scenario with these keys in place of its own; of `controller`, which is a dict, only
    /// what is given is replaced. Example: scenario.with_(seed=2, controller={"motor_lag_s": 0.1}).
    ///
    /// Raises ValueError with key, value and range.
    #[pyo3(signature = (**keys))]
    fn with_(&self, py: Python<'_>, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let Some(keys) = keys else {
            return Self::checked(py, self.file.clone());
        };
        let keys = mapping("keys", keys)?.parse().map_err(failed)?;
        Self::checked(py, self.file.with_keys(&keys).map_err(failed)?)
    }

    /// Name in tables and plots.
    #[getter]
    fn name(&self) -> &str {
        &self.prepared.name
    }

    /// The vehicle, as controllers know it.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        Vehicle(self.prepared.vehicle.clone())
    }

    /// Names of the scenario's controllers.
    #[getter]
    fn controllers(&self) -> Vec<&'static str> {
        let kinds = self.prepared.controllers.iter();
        kinds.map(|kind| kind.name()).collect()
    }

    /// What moves the vehicle: icrik or contact.
    #[getter]
    fn plant(&self) -> &'static str {
        self.prepared.plant.kind().name()
    }

    /// Seed of everything random.
    #[getter]
    fn seed(&self) -> u64 {
        self.prepared.seed
    }

    /// Control period, s.
    #[getter]
    fn period_s(&self) -> f64 {
        self.prepared.controller.period_s
    }

    /// Step of the simulation, s.
    #[getter]
    fn step_s(&self) -> f64 {
        self.prepared.step_s
    }

    /// Pose (x_m, y_m, z_m, yaw_rad) at which the vehicle starts.
    #[getter]
    fn start_pose(&self) -> PyResult<(f64, f64, f64, f64)> {
        let simulation = self.prepared.simulation().map_err(failed)?;
        let pose = simulation.state().pose;
        Ok((pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad))
    }

    /// Attitude (roll_rad, pitch_rad) of the ground where the vehicle starts.
    #[getter]
    fn start_attitude_rad(&self) -> PyResult<(f64, f64)> {
        let simulation = self.prepared.simulation().map_err(failed)?;
        let attitude = simulation.state().attitude;
        Ok((attitude.roll_rad, attitude.pitch_rad))
    }

    /// Pickles name and text of the file: another process of this machine reads what it names.
    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, (String, String))> {
        let make = py.get_type::<Self>().getattr("_of_text")?;
        let path = self.file.path().display().to_string();
        Ok((make, (path, self.file.text().to_owned())))
    }

    #[staticmethod]
    fn _of_text(py: Python<'_>, path: &str, text: String) -> PyResult<Self> {
        Self::checked(py, ConfigFile::with_text(Path::new(path), text))
    }

    fn __repr__(&self) -> String {
        format!(
            "<sidehill.Scenario {} of {}>",
            self.name(),
            self.file.name()
        )
    }
}
