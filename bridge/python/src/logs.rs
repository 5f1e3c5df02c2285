//! Identification and odometry from logs, and from a Python object that is driven.

use crate::arguments::{from_json, number, object, path, whole};
use crate::errors::{failed, guarded, invalid};
use crate::plant::{Failure, PlantFailed, PythonPlant};
use crate::vehicle::Vehicle;
use anyhow::Context;
use pyo3::prelude::*;
use serde_json::Value;
use sidehill::drive_log::{LogArgs, LogReader};
use sidehill::identify::{IdentifiedDrives, Logs, NamedLog, of_logs};
use sidehill::odometry::figures;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::identification::{IdentificationSettings, Segmentation};
use sidehill_plant::vehicle as model;
use std::path::PathBuf;

/// A log by its name in messages; `sidehill._logs` makes it of what is given.
type Given = (String, Source);

#[derive(FromPyObject)]
pub enum Source {
    /// Of a dict or DataFrame.
    Csv(Vec<u8>),
    /// CSV, bag or recording.
    Path(PathBuf),
}

/// What columns and topics mean, and the largest size of a log: `columns`, `topics`, `max_bytes`.
type Maps<'py> = [Option<Bound<'py, PyAny>>; 3];

fn reader([columns, topics, max_bytes]: &Maps<'_>) -> PyResult<LogReader> {
    let file = |name, value: &Option<Bound<'_, PyAny>>| {
        let value = value.as_ref();
        value.map(|value| path(name, value)).transpose()
    };
    LogReader::new(&LogArgs {
        columns: file("columns", columns)?,
        topics: file("topics", topics)?,
        max_bytes: whole("max_bytes", max_bytes.as_ref())?,
    })
    .map_err(failed)
}

fn read(reader: &LogReader, (name, source): Given, notes: &mut Vec<String>) -> PyResult<NamedLog> {
    let note = |text| notes.push(text);
    match source {
        Source::Csv(csv) => reader
            .read_text(&name, csv.as_slice(), note)
            .map(|log| (name, log)),
        Source::Path(path) => reader
            .read(&path, note)
            .context(name)
            .map(|log| (path.display().to_string(), log)),
    }
    .map_err(failed)
}

/// Identifies from logs, or from a plant that is driven; `sidehill.identify` is the function for users.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "named ones in Python")]
pub fn identify(
    py: Python<'_>,
    level: Vec<Given>,
    slope: Vec<Given>,
    plant: Option<Bound<'_, PyAny>>,
    seed: &Bound<'_, PyAny>,
    vehicle: &Bound<'_, PyAny>,
    segment_s: &Bound<'_, PyAny>,
    smoothing_s: &Bound<'_, PyAny>,
    maps: Maps<'_>,
    contact: bool,
) -> PyResult<Py<Identification>> {
    let vehicle = object::<Vehicle>("vehicle", vehicle)?.get().0.clone();
    let segment_s = number("segment_s", segment_s)?;
    let settings = IdentificationSettings {
        segmentation: Segmentation::of_length(segment_s).map_err(failed)?,
        attitude_smoothing_s: Bounds::new(0.0, 10.0, "s")
            .check("smoothing_s", number("smoothing_s", smoothing_s)?)
            .map_err(invalid)?,
    };
    let reader = reader(&maps)?;
    let seed = whole("seed", Some(seed))?.unwrap_or(1);
    let plant = plant.map(Bound::unbind);
    let (vehicle, report) = guarded(py, || {
        let mut notes = Vec::new();
        let logs = match plant {
            Some(plant) => driven(&plant, &vehicle, seed)?,
            None => {
                let mut read_all = |given: Vec<Given>| -> PyResult<Vec<NamedLog>> {
                    let logs = given.into_iter();
                    logs.map(|log| read(&reader, log, &mut notes)).collect()
                };
                let (level, slope) = (read_all(level)?, read_all(slope)?);
                Logs::of_stages(level, slope, |text| notes.push(text)).map_err(failed)?
            }
        };
        let found = of_logs(&logs, &vehicle, &settings, contact).map_err(failed)?;
        let mut report = found.json();
        report["text"] = Value::from(found.text());
        report["notes"] = notes.into();
        Ok((found.vehicle, report.to_string()))
    })?;
    Identification::make(py, vehicle, report)
}

/// Time between the commands to a plant that is driven, s: what engines of physics can divide into their own steps.
const STEP_S: f64 = 0.01;

/// Returns the logs of a plant that is driven through the procedure.
fn driven(plant: &Py<PyAny>, vehicle: &model::Vehicle, seed: u64) -> PyResult<Logs> {
    let failure = Failure::default();
    let scale = vehicle.encoder_scale;
    let logs = Logs::driven(&scale, seed, |start| {
        let put = Python::attach(|py| {
            PythonPlant::new(plant.bind(py), start, STEP_S, scale, failure.clone())
        });
        put.map_err(|error| {
            failure.put(error);
            PlantFailed.into()
        })
    });
    match failure.take() {
        Some(error) => Err(error),
        None => logs.context("plant").map_err(failed),
    }
}

/// Identifies drives; `sidehill.identify_drives` is the function for users.
#[pyfunction]
pub fn identify_drives<'py>(
    py: Python<'py>,
    logs: Vec<Given>,
    vehicle: &Bound<'py, PyAny>,
    maps: Maps<'py>,
) -> PyResult<Bound<'py, PyAny>> {
    let scale = object::<Vehicle>("vehicle", vehicle)?.get().0.encoder_scale;
    let reader = reader(&maps)?;
    let found = guarded(py, || {
        let mut notes = Vec::new();
        let read = |(name, source): Given| {
            let note = |text| notes.push(text);
            match source {
                Source::Csv(csv) => {
                    reader.read_commands_of_text(&name, csv.as_slice(), &scale, note)
                }
                Source::Path(path) => reader.read_commands(&path, &scale, note).context(name),
            }
        };
        let records: Vec<_> = logs
            .into_iter()
            .map(read)
            .collect::<Result<_, _>>()
            .map_err(failed)?;
        let drives = IdentifiedDrives::of_records(&records)
            .context("logs")
            .map_err(failed)?;
        let mut found = drives.json().map_err(failed)?;
        found["text"] = drives.text().into();
        found["notes"] = notes.into();
        Ok(found.to_string())
    })?;
    from_json(py, &found)
}

/// An identified vehicle, with what each stage says of it, as JSON.
#[pyclass(frozen, extends = Vehicle, module = "sidehill")]
pub struct Identification(String);

impl Identification {
    fn make(py: Python<'_>, vehicle: model::Vehicle, report: String) -> PyResult<Py<Self>> {
        let made = PyClassInitializer::from(Vehicle(vehicle)).add_subclass(Self(report));
        Py::new(py, made)
    }

    fn part<'py>(&self, py: Python<'py>, key: &str) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.0)?.get_item(key)
    }
}

#[pymethods]
impl Identification {
    /// Report of the level stage (ICRs, c_l, c_r), None without level logs: dict with `estimates` (by key:
    /// value, std, half_width_95 in the key's unit, None where the logs do not tell), `segments`, `poses`,
    /// `j_over_n` (13), `outlier_share`, `held_out` (RMS errors of segments left out, of the fit and of the
    /// model without its parameters, m and rad), `warnings`, and `undetermined` (by key: the same and `kept`, the value
    /// of the start, which stays as the logs do not determine it).
    #[getter]
    fn level<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "level")
    }

    /// Report of the slope stage (lambda_1, lambda_2), None without slope logs; as `level`.
    #[getter]
    fn slope<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "slope")
    }

    /// Report of the terms beyond ICRIK, None where there were too few segments: dict with `terms` (by key of the vehicle's
    /// `extension`: `verdict`, which is supported, not_told_apart, negative, out_of_range or not_supported, with `value` and
    /// `half_width_95`, `instead` or `reason`, and `improvement`, the fall of the held-out misfit as a share of it, with
    /// `improvement_half_width_95`), `segments`, `held_out` (RMS errors, m and rad, of `icrhk`, `icrik` and `extended`) and
    /// `not_used`, why the vehicle is without them, None where it has them.
    #[getter]
    fn extension_report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "extension")
    }

    /// Report of the vehicle on wheels, None where it was not asked for: dict with `estimates` (by key: value,
    /// interval_95, determined), `not_told_apart`, `segments`, `settled`, `nearer_than_geometry_alone`.
    #[getter]
    fn contact_report<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "contact")
    }

    /// How far to trust it: dict with `max_slope_deg`, the steepest slope on which to drive with it, deg, 0 where it is
    /// not good enough to drive at all, and `reasons`, a list of texts.
    #[getter]
    fn verdict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "verdict")
    }

    /// What `sidehill identify` prints: tables of the stages, and the verdict.
    #[getter]
    fn text<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "text")
    }

    /// What reading the logs left out, and what in them looks wrong: a list of texts.
    #[getter]
    fn notes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.part(py, "notes")
    }

    /// The vehicle without the reports.
    #[getter]
    fn vehicle(slf: &Bound<'_, Self>) -> Vehicle {
        slf.as_super().get().clone()
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, (Vehicle, String))> {
        let make = slf.py().get_type::<Self>().getattr("_of")?;
        Ok((make, (Self::vehicle(slf), slf.get().0.clone())))
    }

    #[staticmethod]
    fn _of(py: Python<'_>, vehicle: &Bound<'_, PyAny>, report: String) -> PyResult<Py<Self>> {
        let vehicle = object::<Vehicle>("vehicle", vehicle)?.get().0.clone();
        Self::make(py, vehicle, report)
    }
}

/// Judges odometry of a log; `sidehill.odometry` is the function for users.
#[pyfunction]
pub fn odometry<'py>(
    py: Python<'py>,
    log: Given,
    vehicle: &Bound<'py, PyAny>,
    maps: Maps<'py>,
) -> PyResult<Bound<'py, PyAny>> {
    let vehicle = &object::<Vehicle>("vehicle", vehicle)?.get().0;
    let reader = reader(&maps)?;
    let found = guarded(py, || {
        let mut notes = Vec::new();
        let (name, drive) = read(&reader, log, &mut notes)?;
        let mut found = figures(&drive, vehicle).context(name).map_err(failed)?;
        found.insert("notes".into(), notes.into());
        Ok(found)
    })?;
    from_json(py, &Value::Object(found).to_string())
}
