//! A scenario with its controllers, side by side.

use crate::arguments::{from_json, kind, object, shown, whole};
use crate::errors::{failed, guarded, invalid};
use crate::measured;
use crate::plant::{Failure, PythonPlant};
use crate::scenario::Scenario;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use sidehill::closed_loop::{self, LoggedState, RunNames};
use sidehill::config::{Overrides, PlantKind, Prepared};
use sidehill::record;
use sidehill::report::write_csv;
use sidehill_controller::closed_loop::OwnLaw;
use sidehill_controller::config::ControllerKind;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::simulation::{Plant, TrueState};
use sidehill_plant::speeds::MotorSpeeds;

/// Runs each controller through the scenario, one after the other, and returns a SimulationResult.
///
/// controllers: names, instead of the scenario's, and callables: each is called in every control cycle with what is
///     measured (a Measured) and returns (v_left_m_s, v_right_m_s), told to the drives in what their encoders count.
/// plant: "icrik" or "contact", instead of the scenario's; or an object with reset(pose, attitude) and
///     step(v_left_m_s, v_right_m_s, dt_s), which is then the vehicle (see docs/python.md).
/// seed: instead of the scenario's.
///
/// The same scenario and seed give the figures of the program `sidehill simulate` bit for bit, but for times.
/// Raises ValueError naming the argument or setting; what a plant object or a callable raises comes through as it is.
#[pyfunction]
#[pyo3(signature = (scenario, controllers=None, plant=None, seed=None))]
pub fn simulate<'py>(
    py: Python<'py>,
    scenario: &Bound<'py, PyAny>,
    controllers: Option<&Bound<'py, PyAny>>,
    plant: Option<&Bound<'py, PyAny>>,
    seed: Option<&Bound<'py, PyAny>>,
) -> PyResult<SimulationResult> {
    let given = object::<Scenario>("scenario", scenario)?;
    let scenario = given.get();
    let (plant, object) = match plant {
        None => (None, None),
        Some(plant) if plant.extract::<String>().is_ok() => (Some(plant_kind(plant)?), None),
        Some(plant) => (None, Some(plant)),
    };
    let laws = laws(controllers)?;
    let kinds = laws.iter().filter_map(|law| match law {
        Law::Kind(kind) => Some(*kind),
        Law::Own(_) => None,
    });
    let overrides = Overrides {
        path: None,
        plant,
        seed: whole("seed", seed)?,
        controllers: kinds.collect(),
        other_vehicle: object.is_some(),
    };
    let prepared = guarded(py, || scenario.prepare(&overrides))?;
    let laws = match laws.is_empty() {
        true => prepared
            .controllers
            .iter()
            .copied()
            .map(Law::Kind)
            .collect(),
        false => laws,
    };
    let runs = laws.into_iter().map(|law| {
        py.check_signals()?;
        Py::new(py, Run(run(&prepared, law, object, py)?))
    });
    Ok(SimulationResult {
        runs: runs.collect::<PyResult<_>>()?,
        scenario: given.clone().unbind(),
    })
}

/// What drives a run.
enum Law<'py> {
    Kind(ControllerKind),
    Own(Bound<'py, PyAny>),
}

/// Returns the controllers of an argument, none for those of the scenario.
fn laws<'py>(value: Option<&Bound<'py, PyAny>>) -> PyResult<Vec<Law<'py>>> {
    let Some(value) = value else {
        return Ok(Vec::new());
    };
    let law = |value: &Bound<'py, PyAny>| match value.is_callable() {
        true => Ok(Law::Own(value.clone())),
        false => kind("controllers", value).map(Law::Kind),
    };
    if value.is_callable() || value.extract::<String>().is_ok() {
        return Ok(vec![law(value)?]);
    }
    let each: Vec<Bound<'_, PyAny>> = value
        .extract()
        .map_err(|_| invalid("controllers: a list of names and callables is needed"))?;
    each.iter().map(law).collect()
}

/// Returns the run of a law with the scenario's plant, or with an object as the vehicle.
fn run(
    prepared: &Prepared,
    law: Law<'_>,
    object: Option<&Bound<'_, PyAny>>,
    py: Python<'_>,
) -> PyResult<record::Run> {
    let failure = Failure::default();
    let Some(object) = object else {
        let name = prepared.plant.kind().name();
        let plant = guarded(py, || prepared.simulation().map_err(failed))?;
        return run_plant(prepared, law, plant, name, failure, py);
    };
    let start = *prepared.simulation().map_err(failed)?.state();
    let scale = prepared.plant.encoder_scale();
    let plant = PythonPlant::new(object, &start, prepared.step_s, scale, failure.clone())?;
    let name = object.get_type().name()?.to_string();
    run_plant(prepared, law, plant, &name, failure, py)
}

fn run_plant<P: Plant + Send>(
    prepared: &Prepared,
    law: Law<'_>,
    plant: P,
    name: &str,
    failure: Failure,
    py: Python<'_>,
) -> PyResult<record::Run> {
    let run = match law {
        Law::Kind(kind) => guarded(py, || {
            closed_loop::run_plant(prepared, kind, plant, name, |_| {}, None).map_err(failed)
        }),
        Law::Own(callable) => {
            let own = callable.getattr("__name__").or_else(|_| {
                let class = callable.get_type();
                class.name().map(Bound::into_any)
            })?;
            let own = own.str()?.to_string();
            let names = RunNames {
                controller: &own,
                plant: name,
            };
            let config = prepared.controller.clone();
            let vehicle = prepared.vehicle.clone();
            let law = measured::law(callable.unbind(), vehicle, config.period_s, failure.clone());
            let law = OwnLaw::new(config, prepared.reference.clone(), law);
            guarded(py, || {
                closed_loop::run_law(prepared, law, plant, names).map_err(failed)
            })
        }
    }?;
    match failure.take() {
        Some(error) => Err(error),
        None => Ok(run),
    }
}

/// Returns the figures of a log against a scenario's reference; `sidehill.metrics` is the function for users.
#[pyfunction]
pub fn figures_of_log<'py>(
    py: Python<'py>,
    scenario: &Bound<'py, PyAny>,
    time_s: PyReadonlyArray1<'py, f64>,
    pose: [PyReadonlyArray1<'py, f64>; 4],
    attitude_rad: [PyReadonlyArray1<'py, f64>; 2],
    command_m_s: Option<[PyReadonlyArray1<'py, f64>; 2]>,
) -> PyResult<Bound<'py, PyAny>> {
    let scenario = object::<Scenario>("scenario", scenario)?.get();
    let [x, y, z, yaw] = pose.each_ref().map(PyReadonlyArray1::as_array);
    let [roll, pitch] = attitude_rad.each_ref().map(PyReadonlyArray1::as_array);
    let command = command_m_s.as_ref();
    let command = command.map(|columns| columns.each_ref().map(PyReadonlyArray1::as_array));
    let rows: Vec<LoggedState> = (0..time_s.len()?)
        .zip(time_s.as_array())
        .map(|(i, time_s)| LoggedState {
            state: TrueState {
                time_s: *time_s,
                pose: Pose {
                    x_m: x[i],
                    y_m: y[i],
                    z_m: z[i],
                    yaw_rad: yaw[i],
                },
                attitude: Attitude {
                    roll_rad: roll[i],
                    pitch_rad: pitch[i],
                },
                ..TrueState::default()
            },
            command: command.as_ref().map(|[traction, steer]| MotorSpeeds {
                traction_m_s: traction[i],
                steer_m_s: steer[i],
            }),
        })
        .collect();
    let figures = guarded(py, || {
        let prepared = scenario.prepare(&Overrides::default())?;
        Ok(closed_loop::figures_of_log(&prepared, &rows))
    })?;
    from_json(py, &serde_json::to_string(&figures).map_err(failed)?)
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

/// The runs of a simulation.
#[pyclass(frozen, module = "sidehill")]
pub struct SimulationResult {
    runs: Vec<Py<Run>>,
    scenario: Py<Scenario>,
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

    /// Returns a matplotlib figure: tracks on contours of the ground, cross-track and heading errors, commands, and the
    /// friction that a controller learns with its 95 % interval. Raises ImportError without matplotlib.
    fn plot<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyAny>> {
        let plot = slf.py().import("sidehill._plot")?.getattr("plot")?;
        plot.call1((slf, &slf.get().scenario))
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
