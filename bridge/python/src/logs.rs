//! Identification and odometry from logs.

use crate::arguments::{file, from_json, number, object};
use crate::errors::{failed, guarded, invalid};
use crate::vehicle::Vehicle;
use pyo3::prelude::*;
use serde_json::Value;
use sidehill::identify::stage_fields;
use sidehill::odometry::figures;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::identification::{
    Estimate, IdentificationSettings, Segmentation, StageReport, identify_extension,
    identify_level_determined, identify_slope_determined,
};
use sidehill_plant::log::{ColumnMap, DriveLog};

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
pub fn identify(
    py: Python<'_>,
    level: Vec<Text>,
    slope: Vec<Text>,
    vehicle: &Bound<'_, PyAny>,
    segment_s: &Bound<'_, PyAny>,
    smoothing_s: &Bound<'_, PyAny>,
    columns: Option<&Bound<'_, PyAny>>,
) -> PyResult<Py<Identification>> {
    let mut vehicle = object::<Vehicle>("vehicle", vehicle)?.get().0.clone();
    let segment_s = number("segment_s", segment_s)?;
    let settings = IdentificationSettings {
        segmentation: Segmentation::of_length(segment_s).map_err(failed)?,
        attitude_smoothing_s: Bounds::new(0.0, 10.0, "s")
            .check("smoothing_s", number("smoothing_s", smoothing_s)?)
            .map_err(invalid)?,
    };
    let columns = column_map(columns)?;
    let (vehicle, reports) = guarded(py, || {
        let logs = |texts: &[Text]| -> PyResult<Vec<DriveLog>> {
            texts.iter().map(|text| read(text, &columns)).collect()
        };
        let (level, slope) = (logs(&level)?, logs(&slope)?);
        let mut reports = [None, None];
        if !level.is_empty() {
            let (fitted, report, unknown) = identify_level_determined(&level, &vehicle, &settings)
                .map_err(|error| invalid(format!("level: {error}")))?;
            (vehicle, reports[0]) = (fitted, Some(summary(&report, &unknown)));
        }
        if !slope.is_empty() {
            let (fitted, report, unknown) = identify_slope_determined(&slope, &vehicle, &settings)
                .map_err(|error| invalid(format!("slope: {error}")))?;
            (vehicle, reports[1]) = (fitted, Some(summary(&report, &unknown)));
        }
        // As in the program: what the two stages found holds where the terms cannot be tried.
        if let Ok((extension, _)) = identify_extension(&level, &slope, &vehicle, &settings) {
            vehicle.extension = extension;
            vehicle = vehicle.validated().map_err(invalid)?;
        }
        Ok((vehicle, reports))
    })?;
    let [level, slope] = reports;
    let identification = Identification { level, slope };
    let made = PyClassInitializer::from(Vehicle(vehicle)).add_subclass(identification);
    Py::new(py, made)
}

/// Returns what a stage found, with the names of what the logs do not determine, which stays as it was.
fn summary(report: &StageReport, undetermined: &[Estimate]) -> Value {
    let mut fields = stage_fields(report);
    let names = undetermined.iter().map(|estimate| estimate.name);
    fields.insert("undetermined".to_owned(), names.collect());
    Value::Object(fields)
}

/// An identified vehicle, with what each stage says of it.
#[pyclass(frozen, extends = Vehicle, module = "sidehill")]
pub struct Identification {
    level: Option<Value>,
    slope: Option<Value>,
}

impl Identification {
    fn report<'py>(py: Python<'py>, report: Option<&Value>) -> PyResult<Option<Bound<'py, PyAny>>> {
        report
            .map(|report| from_json(py, &report.to_string()))
            .transpose()
    }
}

#[pymethods]
impl Identification {
    /// Report of the level stage (ICRs, c_l, c_r), None without level logs: dict with `estimates` (by key:
    /// value, std, half_width_95 in the key's unit, None where the logs do not tell), `segments`, `poses`,
    /// `j_over_n` (13), `outlier_share`, `held_out` (RMS errors of segments left out, of the fit and of the
    /// model without its parameters, m and rad), `warnings`, and `undetermined`, the keys that the logs do not
    /// determine and that stay as they were.
    #[getter]
    fn level<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        Self::report(py, self.level.as_ref())
    }

    /// Report of the slope stage (lambda_1, lambda_2), None without slope logs; as `level`.
    #[getter]
    fn slope<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        Self::report(py, self.slope.as_ref())
    }

    /// The vehicle without the reports.
    #[getter]
    fn vehicle(slf: &Bound<'_, Self>) -> Vehicle {
        slf.as_super().get().clone()
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
