//! Scenarios: vehicle, ground, course, sensors and controllers of a simulation.

use crate::arguments::{file, from_json, html, keys, mapping};
use crate::errors::{failed, guarded};
use crate::vehicle::Vehicle;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::config::{Bundle, ConfigFile, Overrides, PlantKind, Prepared};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A scenario, checked with all that it names; immutable.
///
/// Keys are those of the YAML (config/scenarios/figure_eight.yaml), where each has its unit. Names of other
/// files are relative to the scenario's own, those of a dict to the working folder; they are read once.
///
/// Scenario(**keys) takes the YAML's keys, and objects and arrays in place of files: `vehicle` a Vehicle or a dict,
/// `path` an array (n, 2) of points (x_m, y_m) or (n, 3) with z_m in place of `course`, `terrain` a sidehill.Grid,
/// `contact` a dict of `vehicle` (see contact_from_geometry) and `identified` (a Vehicle). Without them it has the
/// paper's J8 on level ground with icrik-mpc, plant icrik, seed 1 and step_s 0.005; `path` or `course` is needed.
/// Raises ValueError with argument, or key, value and range, OSError where a file that it names cannot be read.
#[pyclass(frozen, module = "sidehill")]
pub struct Scenario {
    file: ConfigFile,
    prepared: Prepared,
    /// Texts of the files that it names, by their paths.
    files: Bundle,
}

/// Texts of files by their paths.
type Texts = BTreeMap<PathBuf, String>;

impl Scenario {
    /// Returns the scenario of a file, with those of the files that it names whose texts are known.
    fn checked(py: Python<'_>, file: ConfigFile, known: Texts) -> PyResult<Self> {
        guarded(py, || {
            let files = Arc::new(Mutex::new(known));
            let file = file.with_bundle(Arc::clone(&files));
            let prepared = prepare(&file, &Overrides::default())?;
            Ok(Self {
                file,
                prepared,
                files,
            })
        })
    }

    fn texts(&self) -> Texts {
        let files = self.files.lock();
        files.unwrap_or_else(PoisonError::into_inner).clone()
    }

    fn keys(&self) -> PyResult<serde_json::Value> {
        self.file.parse().map_err(failed)
    }

    /// Returns the keys of the YAML for those that are given.
    fn given<'py>(
        &self,
        py: Python<'py>,
        given: &Bound<'py, PyDict>,
    ) -> PyResult<Bound<'py, PyAny>> {
        py.import("sidehill._scenario")?
            .getattr("keys")?
            .call1((given, self.to_dict(py)?))
    }

    /// Returns its name in tables and plots.
    pub fn title(&self) -> &str {
        &self.prepared.name
    }

    /// Returns the file.
    pub fn file(&self) -> &ConfigFile {
        &self.file
    }

    /// Returns the scenario with everything read and built.
    pub fn prepare(&self, overrides: &Overrides) -> PyResult<Prepared> {
        prepare(&self.file, overrides)
    }

    /// Returns the scenario with another plant or seed than its own.
    ///
    /// A vehicle by ICRIK has the same ground and path with every seed, so nothing is read and built again.
    pub fn prepare_plant(&self, plant: Option<PlantKind>, seed: Option<u64>) -> PyResult<Prepared> {
        let own = self.prepared.plant.kind();
        if own == PlantKind::Icrik && plant.is_none_or(|plant| plant == own) {
            let mut prepared = self.prepared.clone();
            prepared.seed = seed.unwrap_or(prepared.seed);
            return Ok(prepared);
        }
        self.prepare(&Overrides {
            plant,
            seed,
            ..Overrides::default()
        })
    }
}

fn prepare(file: &ConfigFile, overrides: &Overrides) -> PyResult<Prepared> {
    let scenario = sidehill::config::Scenario::read(file.clone()).map_err(failed)?;
    scenario.prepare(overrides).map_err(failed)
}

/// Returns the texts within a value.
fn names(value: &serde_yaml::Value) -> Vec<&str> {
    match value {
        serde_yaml::Value::String(text) => vec![text],
        serde_yaml::Value::Mapping(mapping) => mapping.values().flat_map(names).collect(),
        _ => Vec::new(),
    }
}

#[pymethods]
impl Scenario {
    #[new]
    #[pyo3(signature = (**keys))]
    fn new(py: Python<'_>, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let given = keys.cloned().unwrap_or_else(|| PyDict::new(py));
        let module = py.import("sidehill._scenario")?;
        Self::from_dict(py, &module.getattr("of_new")?.call1((given,))?)
    }

    /// Returns the scenario of a YAML file.
    ///
    /// Raises OSError where a file cannot be read, ValueError with file, key, value and range where its
    /// content is wrong.
    #[staticmethod]
    fn load(py: Python<'_>, path: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::checked(py, file("path", path)?, Texts::new())
    }

    /// Returns the scenario of a dict with the YAML's keys.
    ///
    /// Raises ValueError with key, value and range, OSError where a file that it names cannot be read.
    #[staticmethod]
    fn from_dict(py: Python<'_>, keys: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::checked(py, mapping("keys", keys)?, Texts::new())
    }

    /// Returns a dict with the YAML's keys, as they are given: what is left out has its default.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &self.keys()?.to_string())
    }

    /// Returns the scenario with these keys in place of its own, objects and arrays as in Scenario(). Of
    /// `controller`, which is a dict, only what is given is replaced, and of a name with dots the one key. Example:
    /// scenario.with_(seed=2, controller={"motor_lag_s": 0.1}, **{"terrain.slope_deg": 8}).
    ///
    /// Raises ValueError with key, value and range.
    #[pyo3(signature = (**keys))]
    fn with_(&self, py: Python<'_>, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let given = keys.cloned().unwrap_or_else(|| PyDict::new(py));
        let keys = self::keys("keys", &self.given(py, &given)?)?;
        let file = self.file.with_keys(&keys).map_err(failed)?;
        // A file that is named anew is read anew.
        let mut known = self.texts();
        for name in keys.values().flat_map(names) {
            known.remove(&file.path_of(Path::new(name)));
        }
        Self::checked(py, file, known)
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

    /// Returns the height of the ground at each place of arrays x_m and y_m of one shape, m, NaN where none is known.
    fn height_m<'py>(
        &self,
        py: Python<'py>,
        x_m: &Bound<'py, PyAny>,
        y_m: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let named = PyDict::new(py);
        named.set_item("x_m", x_m)?;
        named.set_item("y_m", y_m)?;
        let broadcast = py.import("sidehill._arrays")?.getattr("broadcast")?;
        let (shape, [x, y]): (Bound<'py, PyAny>, [PyReadonlyArray1<'py, f64>; 2]) =
            broadcast.call1((named,))?.extract()?;
        let (x, y) = (x.as_slice()?, y.as_slice()?);
        let terrain = &self.prepared.terrain;
        let heights = guarded(py, || {
            let height = |(x, y): (&f64, &f64)| {
                let surface = terrain.surface(*x, *y);
                surface.map_or(f64::NAN, |surface| surface.height_m)
            };
            Ok(x.iter().zip(y).map(height).collect())
        })?;
        PyArray1::from_vec(py, heights).call_method1("reshape", (shape,))
    }

    /// Pickles the texts of the file and of those that it names: another machine needs none of them.
    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (String, String, Texts))> {
        let make = py.get_type::<Self>().getattr("_of_text")?;
        let path = self.file.path().display().to_string();
        Ok((make, (path, self.file.text().to_owned(), self.texts())))
    }

    #[staticmethod]
    fn _of_text(py: Python<'_>, path: &str, text: String, files: Texts) -> PyResult<Self> {
        Self::checked(py, ConfigFile::with_text(Path::new(path), text), files)
    }

    /// Equal are scenarios with equal keys whose files, by their names and texts, are the same.
    fn __eq__(&self, other: &Bound<'_, PyAny>) -> PyResult<bool> {
        let Ok(other) = other.cast::<Self>() else {
            return Ok(false);
        };
        let other = other.get();
        let folder = |scenario: &Self| scenario.file.path().parent().map(Path::to_owned);
        let (own, others) = (self.texts(), other.texts());
        // A scenario made from another one has the texts of that one's files as well.
        let same =
            |(path, text): (&PathBuf, &String)| others.get(path).is_none_or(|other| other == text);
        Ok(self.keys()? == other.keys()? && folder(self) == folder(other) && own.iter().all(same))
    }

    fn __copy__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __deepcopy__<'py>(slf: Bound<'py, Self>, _memo: &Bound<'py, PyAny>) -> Bound<'py, Self> {
        slf
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        let mut keys = self.keys()?;
        if let Some(keys) = keys.as_object_mut() {
            keys.remove("files");
        }
        html("Scenario", &from_json(py, &keys.to_string())?)
    }

    fn __repr__(&self) -> String {
        format!(
            "<sidehill.Scenario {} of {}>",
            self.name(),
            self.file.name()
        )
    }
}
