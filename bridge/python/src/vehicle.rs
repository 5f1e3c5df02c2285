//! Parameters of a vehicle, and its instantaneous centres of rotation.

use crate::arguments::{file, from_json, html, keys, mapping, number, object, path, shown};
use crate::errors::{failed, guarded, invalid};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::config::{ConfigFile, changed, to_yaml};
use sidehill::icr::IcrInput;
use sidehill::init::{OwnRobot, robot_name};
use sidehill_plant::bounds::RangeError;
use sidehill_plant::frames::BodyVelocity;
use sidehill_plant::icr::TreadIcrs;
use sidehill_plant::vehicle as model;
use std::path::Path;

/// A skid-steer vehicle as the ICR models know it; immutable.
///
/// Attributes have the names of the YAML's keys (config/vehicles/j8.yaml): ICRs in m in the body frame
/// (x right, y forward), slide gains in s/rad, speeds in m/s. Source: Table I of the paper.
///
/// Vehicle(**keys) takes all of the keys that the YAML must have, and raises ValueError with key, value and range.
#[pyclass(frozen, subclass, eq, module = "sidehill")]
#[derive(Clone, PartialEq)]
pub struct Vehicle(pub model::Vehicle);

#[pymethods]
impl Vehicle {
    #[new]
    #[pyo3(signature = (**keys))]
    fn new(py: Python<'_>, keys: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let keys = keys.cloned().unwrap_or_else(|| PyDict::new(py));
        Self::from_dict(&keys)
    }

    /// Returns the Argo J8 of the paper's Table I, a rover of about one tonne with eight wheels.
    #[staticmethod]
    fn j8() -> Self {
        Self(model::Vehicle::j8())
    }

    /// Returns the first guess of a vehicle from its measures, as `sidehill init` makes it: it is driven through the
    /// procedure of identification on wheels with friction, with assumptions for the rest, in simulation. Takes seconds.
    ///
    /// length_m: distance between the first and the last axle, m; width_m: between the middles of the left and the
    /// right wheels; wheel_radius_m; mass_kg, with payload; axles: their number, evenly spaced; speed_m_s: largest
    /// speed of the wheels. Raises ValueError naming the argument.
    #[staticmethod]
    #[pyo3(signature = (length_m, width_m, wheel_radius_m, mass_kg, axles=None, speed_m_s=None, name=None))]
    #[expect(clippy::too_many_arguments, reason = "named ones in Python")]
    fn from_geometry(
        py: Python<'_>,
        length_m: &Bound<'_, PyAny>,
        width_m: &Bound<'_, PyAny>,
        wheel_radius_m: &Bound<'_, PyAny>,
        mass_kg: &Bound<'_, PyAny>,
        axles: Option<&Bound<'_, PyAny>>,
        speed_m_s: Option<&Bound<'_, PyAny>>,
        name: Option<String>,
    ) -> PyResult<Self> {
        let robot = robot(
            length_m,
            width_m,
            wheel_radius_m,
            mass_kg,
            axles,
            speed_m_s,
            name,
        )?;
        guarded(py, || robot.first_guess().map(Self).map_err(of_measure))
    }

    /// Returns the vehicle with other values of some keys: nested ones in a dict, which is merged key by key, or by
    /// names with dots, as in with_(**{"contact.half_width_m": 0.5}). A key of the value None is left out.
    ///
    /// Raises ValueError with key, value and range.
    #[pyo3(signature = (**changes))]
    fn with_(&self, changes: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let Some(changes) = changes else {
            return Ok(self.clone());
        };
        let own = serde_yaml::to_value(&self.0).and_then(serde_yaml::from_value);
        let all = changed(own.map_err(failed)?, &keys("changes", changes)?);
        let text = serde_json::to_string(&all).map_err(failed)?;
        ConfigFile::with_text(Path::new("changes"), text)
            .parse()
            .map(Self)
            .map_err(failed)
    }

    /// Returns the vehicle of a YAML file.
    ///
    /// Raises OSError where the file cannot be read, ValueError with file, key, value and range where its
    /// content is wrong.
    #[staticmethod]
    fn load(path: &Bound<'_, PyAny>) -> PyResult<Self> {
        file("path", path)?.parse().map(Self).map_err(failed)
    }

    /// Returns the vehicle of a dict with the YAML's keys, all of them and no others.
    ///
    /// Raises ValueError with key, value and range.
    #[staticmethod]
    fn from_dict(keys: &Bound<'_, PyAny>) -> PyResult<Self> {
        mapping("keys", keys)?.parse().map(Self).map_err(failed)
    }

    /// Returns a dict with the YAML's keys.
    fn to_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        from_json(py, &serde_json::to_string(&self.0).map_err(failed)?)
    }

    /// Writes the vehicle to a YAML file, which replaces one of that name.
    ///
    /// Raises OSError where it cannot be written.
    #[pyo3(name = "save")]
    fn save(&self, path: &Bound<'_, PyAny>) -> PyResult<()> {
        let path = self::path("path", path)?;
        let text = format!(
            "# Vehicle: ICRs and base in m in the body frame (x right, y forward), slide gains in s/rad, speed\n\
             # in m/s, factors from measured to effective tread speed.\n{}",
            to_yaml(&self.0).map_err(failed)?
        );
        std::fs::write(&path, text)
            .map_err(|error| failed(anyhow::Error::new(error).context(path.display().to_string())))
    }

    /// Name in tables and plots.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Left tread's ICR on level ground, m to the right of the origin, so negative.
    #[getter]
    fn x_icr_left_m(&self) -> f64 {
        self.0.icrs.left_m
    }

    /// Right tread's ICR on level ground, m to the right of the origin.
    #[getter]
    fn x_icr_right_m(&self) -> f64 {
        self.0.icrs.right_m
    }

    /// Both treads' ICR on level ground, m ahead of the origin.
    #[getter]
    fn y_icr_m(&self) -> f64 {
        self.0.icrs.forward_m
    }

    /// lambda_1, s/rad: shift of all ICRs with roll and pitch.
    #[getter]
    fn lambda_1_s_per_rad(&self) -> f64 {
        self.0.slide.shift_s_per_rad
    }

    /// lambda_2, s/rad: further shift of one tread when pointing mostly up or down.
    #[getter]
    fn lambda_2_s_per_rad(&self) -> f64 {
        self.0.slide.aggravated_s_per_rad
    }

    /// v_y^m, m/s: largest longitudinal speed of the identification.
    #[getter]
    fn speed_max_m_s(&self) -> f64 {
        self.0.speed_max_m_s
    }

    /// x_m, m: half width of the rectangle of the wheels' contact points.
    #[getter]
    fn base_half_width_m(&self) -> f64 {
        self.0.base_half_width_m
    }

    /// y_m, m: half length of that rectangle.
    #[getter]
    fn base_half_length_m(&self) -> f64 {
        self.0.base_half_length_m
    }

    /// c_l, from measured to effective speed of the left tread, equation (11).
    #[getter]
    fn correction_left(&self) -> f64 {
        self.0.encoder_scale.left
    }

    /// c_r, from measured to effective speed of the right tread, equation (11).
    #[getter]
    fn correction_right(&self) -> f64 {
        self.0.encoder_scale.right
    }

    /// What is known of it as a vehicle on wheels, from which contact-mpc starts: a dict, or None.
    #[getter]
    fn contact<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let keys = serde_json::to_value(&self.0).map_err(failed)?;
        from_json(py, &keys["contact"].to_string())
    }

    fn __copy__(slf: Bound<'_, Self>) -> Bound<'_, Self> {
        slf
    }

    fn __deepcopy__<'py>(slf: Bound<'py, Self>, _memo: &Bound<'py, PyAny>) -> Bound<'py, Self> {
        slf
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        html("Vehicle", &self.to_dict(py)?)
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        Ok(format!("Vehicle.from_dict({})", self.to_dict(py)?.repr()?))
    }

    fn __reduce__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<(Bound<'py, PyAny>, (Bound<'py, PyAny>,))> {
        let make = py.get_type::<Self>().getattr("from_dict")?;
        Ok((make, (self.to_dict(py)?,)))
    }
}

/// Returns the vehicle on wheels with friction of such measures, a dict with the keys of a contact vehicle's file
/// (config/vehicles/j8_contact.yaml): what a scenario's plant `contact` drives. As `sidehill init` writes it.
///
/// Arguments and errors are those of `Vehicle.from_geometry`.
#[pyfunction]
#[pyo3(signature = (length_m, width_m, wheel_radius_m, mass_kg, axles=None, name=None))]
pub fn contact_from_geometry<'py>(
    py: Python<'py>,
    length_m: &Bound<'py, PyAny>,
    width_m: &Bound<'py, PyAny>,
    wheel_radius_m: &Bound<'py, PyAny>,
    mass_kg: &Bound<'py, PyAny>,
    axles: Option<&Bound<'py, PyAny>>,
    name: Option<String>,
) -> PyResult<Bound<'py, PyAny>> {
    let robot = robot(
        length_m,
        width_m,
        wheel_radius_m,
        mass_kg,
        axles,
        None,
        name,
    )?;
    let wheels = robot.on_wheels().map_err(of_measure)?;
    from_json(py, &serde_json::to_string(&wheels).map_err(failed)?)
}

fn robot(
    length_m: &Bound<'_, PyAny>,
    width_m: &Bound<'_, PyAny>,
    wheel_radius_m: &Bound<'_, PyAny>,
    mass_kg: &Bound<'_, PyAny>,
    axles: Option<&Bound<'_, PyAny>>,
    speed_m_s: Option<&Bound<'_, PyAny>>,
    name: Option<String>,
) -> PyResult<OwnRobot> {
    let axles = axles.map_or(Ok(2), |axles| {
        let count = axles.extract().ok().filter(|count| AXLES.contains(count));
        count.ok_or_else(|| {
            invalid(format!(
                "axles: {} is not a whole number from {} to {}",
                shown(axles),
                AXLES.start(),
                AXLES.end()
            ))
        })
    })?;
    Ok(OwnRobot {
        length: number("length_m", length_m)?,
        width: number("width_m", width_m)?,
        wheel_radius: number("wheel_radius_m", wheel_radius_m)?,
        mass: number("mass_kg", mass_kg)?,
        speed: speed_m_s.map_or(Ok(1.0), |speed| number("speed_m_s", speed))?,
        name: name
            .map(|name| {
                robot_name(&name).map_err(|error| invalid(format!("name: {name:?} {error}")))
            })
            .transpose()?,
        axles,
    })
}

/// Axles of a vehicle.
const AXLES: std::ops::RangeInclusive<usize> = 2..=64;

/// Returns the error with the argument's name in place of the option's.
fn of_measure(error: anyhow::Error) -> PyErr {
    let Some(range) = error.downcast_ref::<RangeError>() else {
        return failed(error);
    };
    let key = match range.key {
        "--length" => "length_m",
        "--width" => "width_m",
        "--wheel-radius" => "wheel_radius_m",
        "--mass" => "mass_kg",
        "--speed" => "speed_m_s",
        other => other,
    };
    invalid(RangeError { key, ..*range })
}

/// Names of what [`icr`] gives for each model.
const COLUMNS: [&str; 6] = [
    "x_icr_left_m",
    "x_icr_right_m",
    "y_icr_m",
    "v_x_m_s",
    "v_y_m_s",
    "omega_z_rad_s",
];

/// Evaluates both models at each index of arrays of one length; `sidehill.icr` broadcasts for it.
#[pyfunction]
pub fn icr<'py>(
    py: Python<'py>,
    vehicle: &Bound<'py, PyAny>,
    roll_rad: PyReadonlyArray1<'py, f64>,
    pitch_rad: PyReadonlyArray1<'py, f64>,
    v_left_m_s: PyReadonlyArray1<'py, f64>,
    v_right_m_s: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyDict>> {
    let vehicle = &object::<Vehicle>("vehicle", vehicle)?.get().0;
    let arrays = [&roll_rad, &pitch_rad, &v_left_m_s, &v_right_m_s];
    let mut slices = [&[][..]; 4];
    for (slice, array) in slices.iter_mut().zip(arrays) {
        *slice = array.as_slice()?;
    }
    let [roll, pitch, left, right] = slices;
    let columns = guarded(py, || {
        let mut columns: [Vec<f64>; 12] = std::array::from_fn(|_| Vec::with_capacity(roll.len()));
        let mut push = |first: usize, icrs: TreadIcrs, velocity: BodyVelocity| {
            let values = [
                icrs.left_m,
                icrs.right_m,
                icrs.forward_m,
                velocity.right_m_s,
                velocity.forward_m_s,
                velocity.yaw_rate_rad_s,
            ];
            for (column, value) in columns[first..].iter_mut().zip(values) {
                column.push(value);
            }
        };
        let inputs = roll.iter().zip(pitch).zip(left.iter().zip(right));
        for (index, ((roll, pitch), (left, right))) in inputs.enumerate() {
            let input = IcrInput {
                roll_rad: *roll,
                pitch_rad: *pitch,
                v_left_m_s: *left,
                v_right_m_s: *right,
            };
            let (attitude, treads) = input
                .checked()
                .map_err(|error| invalid(format!("{error}, at index {index}")))?;
            for (first, icrs) in [(0, vehicle.icrik(attitude, treads)), (6, vehicle.icrhk())] {
                push(first, icrs, icrs.body_velocity(treads));
            }
        }
        Ok(columns)
    })?;
    let names = COLUMNS.map(str::to_owned);
    let level = COLUMNS.map(|name| format!("icrhk_{name}"));
    let out = PyDict::new(py);
    for (name, column) in names.into_iter().chain(level).zip(columns) {
        out.set_item(name, PyArray1::from_vec(py, column))?;
    }
    Ok(out)
}
