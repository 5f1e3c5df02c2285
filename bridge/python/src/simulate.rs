//! A scenario with its controllers, side by side.

use crate::arguments::{from_json, object, seed, shown};
use crate::errors::{failed, guarded, invalid};
use crate::plant::PythonPlant;
use crate::scenario::{Scenario, kinds};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use sidehill::closed_loop;
use sidehill::config::{Overrides, PlantKind, Prepared};
use sidehill::record;
use sidehill::report::write_csv;
use sidehill_controller::config::ControllerKind;

/// Runs each controller through the scenario, one after the other, and returns a SimulationResult.
///
/// controllers: names, instead of the scenario's.
/// plant: "icrik" or "contact", instead of the scenario's; or an object with reset(pose, attitude) and
///     step(v_left_m_s, v_right_m_s, dt_s), which is then the vehicle (see docs/python.md).
/// seed: instead of the scenario's.
///
/// The same scenario and seed give the figures of the program `sidehill simulate` bit for bit, but for times.
/// Raises ValueError naming the argument or setting; what a plant object raises comes through as it is.
#[pyfunction]
#[pyo3(signature = (scenario, controllers=None, plant=None, seed=None))]
pub fn simulate<'py>(
    py: Python<'py>,
    scenario: &Bound<'py, PyAny>,
    controllers: Option<&Bound<'py, PyAny>>,
    plant: Option<&Bound<'py, PyAny>>,
    seed: Option<&Bound<'py, PyAny>>,
) -> PyResult<SimulationResult> {
    let scenario = object::<Scenario>("scenario", scenario)?.get();
    let (plant, object) = match plant {
        None => (None, None),
        Some(plant) if plant.extract::<String>().is_ok() => (Some(plant_kind(plant)?), None),
        Some(plant) => (None, Some(plant)),
    };
    let overrides = Overrides {
        path: None,
        plant,
        seed: self::seed(seed)?,
        controllers: kinds(controllers)?,
        other_vehicle: object.is_some(),
    };
    let prepared = guarded(py, || scenario.prepare(&overrides))?;
    let runs = prepared.controllers.iter().map(|&kind| {
        py.check_signals()?;
        let run = match object {
            None => guarded(py, || {
                closed_loop::run(&prepared, kind, |_| {}, None).map_err(failed)
            }),
            Some(object) => run_object(&prepared, kind, object),
        };
        Py::new(py, Run(run?))
    });
    Ok(SimulationResult {
        runs: runs.collect::<PyResult<_>>()?,
    })
}

/// Returns the plant of that name.
pub fn plant_kind(value: &Bound<'_, PyAny>) -> PyResult<PlantKind> {
    let name: Option<String> = value.extract().ok();
    [PlantKind::Icrik, PlantKind::Contact]
        .into_iter()
        .find(|kind| name.as_deref() == Some(kind.name()))
        .ok_or_else(|| {
            invalid(format!(
                "plant: {} is neither icrik, contact nor an object with reset and step",
                shown(value)
            ))
        })
}

fn run_object(
    prepared: &Prepared,
    kind: ControllerKind,
    object: &Bound<'_, PyAny>,
) -> PyResult<record::Run> {
    let py = object.py();
    let start = *prepared.simulation().map_err(failed)?.state();
    let scale = prepared.plant.encoder_scale();
    let plant = PythonPlant::new(object, &start, prepared.step_s, scale)?;
    let failure = plant.failure();
    let name = object.get_type().name()?.to_string();
    let run = guarded(py, || {
        closed_loop::run_plant(prepared, kind, plant, &name, |_| {}, None).map_err(failed)
    })?;
    match failure.take() {
        Some(error) => Err(error),
        None => Ok(run),
    }
}

/// The runs of a simulation.
#[pyclass(frozen, module = "sidehill")]
pub struct SimulationResult {
    runs: Vec<Py<Run>>,
}

#[pymethods]
impl SimulationResult {
    /// The runs, in the order of the controllers.
    #[getter]
    fn runs<'py>(&self, py: Python<'py>) -> Vec<Bound<'py, Run>> {
        self.runs.iter().map(|run| run.bind(py).clone()).collect()
    }

    /// The figures of all runs, {"runs": [...]}, as `sidehill simulate --format json` prints them.
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let summaries: Vec<_> = self.runs.iter().map(|run| &run.get().0.summary).collect();
        from_json(py, &serde_json::json!({ "runs": summaries }).to_string())
    }

    fn __repr__(&self) -> String {
        format!("<sidehill.SimulationResult of {} runs>", self.runs.len())
    }
}

/// One controller's run.
#[pyclass(frozen, module = "sidehill")]
pub struct Run(record::Run);

#[pymethods]
impl Run {
    /// Name of the controller.
    #[getter]
    fn controller(&self) -> &str {
        &self.0.summary.controller
    }

    /// Its figures, as one entry of `sidehill simulate --format json`.
    #[getter]
    fn metrics<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &serde_json::to_string(&self.0.summary).map_err(failed)?)
    }

    /// A row a control cycle: dict of numpy arrays of one length, with the columns of the CSV files that
    /// `sidehill simulate --out` writes; status, reason and learned_unobserved are lists of strings. NaN where there is no
    /// estimate. Made anew at each access.
    #[getter]
    fn log<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let mut csv = Vec::new();
        write_csv(&self.0, &mut csv).map_err(failed)?;
        let columns = py.import("sidehill._table")?.getattr("columns")?;
        let words = ("status", "reason", "learned_unobserved");
        columns.call1((PyBytes::new(py, &csv), words))
    }

    fn __repr__(&self) -> String {
        let summary = &self.0.summary;
        format!(
            "<sidehill.Run of {}: cross-track RMS {} m>",
            summary.controller, summary.cross_track_rms_m
        )
    }
}
