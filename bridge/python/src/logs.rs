//! Identification and odometry from logs.

use crate::arguments::{file, from_json, number, object};
use crate::errors::{failed, guarded, invalid};
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use serde_json::Value;
use sidehill::identify::of_logs;
use sidehill::odometry::figures;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::identification::{IdentificationSettings, Segmentation};
use sidehill_plant::log::{ColumnMap, DriveLog};
use sidehill_plant::vehicle as model;

/// Name for messages, and the log as CSV; `sidehill._logs` makes them of paths, dicts and DataFrames.
type Text = (String, Vec<u8>);

fn read((name, csv): &Text, columns: &ColumnMap) -> PyResult<DriveLog> {
    DriveLog::read(csv.as_slice(), columns).map_err(|error| invalid(format!("{name}: {error}")))
}

fn column_map(columns: Option<&Bound<'_, PyAny>>) -> PyResult<ColumnMap> {
    columns.map_or_else(
        || Ok(ColumnMap::default()),
        |path| file("columns", path)?.parse().map_err(failed),
    )
}

/// Identifies from logs as text; `sidehill.identify` is the function for users.
#[pyfunction]
#[expect(clippy::too_many_arguments, reason = "named ones in Python")]
pub fn identify(
    py: Python<'_>,
    level: Vec<Text>,
    slope: Vec<Text>,
    vehicle: &Bound<'_, PyAny>,
    segment_s: &Bound<'_, PyAny>,
    smoothing_s: &Bound<'_, PyAny>,
    columns: Option<&Bound<'_, PyAny>>,
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
    let columns = column_map(columns)?;
    let (vehicle, report) = guarded(py, || {
        let logs = |texts: &[Text]| -> PyResult<Vec<DriveLog>> {
            texts.iter().map(|text| read(text, &columns)).collect()
        };
        let found =
            of_logs(logs(&level)?, logs(&slope)?, &vehicle, &settings, contact).map_err(failed)?;
        let mut report = found.json();
        report["text"] = Value::from(found.text());
        Ok((found.vehicle, report.to_string()))
    })?;
    Identification::make(py, vehicle, report)
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

/// Judges odometry of a log as text; `sidehill.odometry` is the function for users.
#[pyfunction]
pub fn odometry<'py>(
    py: Python<'py>,
    log: Text,
    vehicle: &Bound<'py, PyAny>,
    columns: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let vehicle = &object::<Vehicle>("vehicle", vehicle)?.get().0;
    let columns = column_map(columns)?;
    let found = guarded(py, || {
        let drive = read(&log, &columns)?;
        figures(&drive, vehicle).map_err(|error| invalid(format!("{}: {error:#}", log.0)))
    })?;
    from_json(py, &Value::Object(found).to_string())
}
