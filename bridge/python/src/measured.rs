//! What a control law of Python's own is given, and references over a horizon.

use crate::arguments::number;
use crate::errors::invalid;
use crate::plant::Failure;
use crate::vehicle::Vehicle;
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use sidehill_controller::reference::{Progress, Reference};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::{MeasuredMotorSpeeds, MeasuredTreadSpeeds, MotorSpeeds};
use sidehill_plant::vehicle as model;

/// What is measured in a control cycle, each reading as it came last, and the reference to follow.
#[pyclass(frozen, module = "sidehill")]
pub struct Measured {
    sample: Sample,
    reference: Reference,
    progress: Option<Progress>,
    vehicle: model::Vehicle,
    period_s: f64,
}

#[pymethods]
impl Measured {
    /// Instant of the cycle, s.
    #[getter]
    fn time_s(&self) -> f64 {
        self.sample.time_s
    }

    /// Time until the next cycle, s.
    #[getter]
    fn period_s(&self) -> f64 {
        self.period_s
    }

    /// (x_m, y_m, z_m, yaw_rad) in the world, true at pose_time_s; None before the first.
    #[getter]
    fn pose(&self) -> Option<(f64, f64, f64, f64)> {
        let pose = self.sample.pose?.value;
        Some((pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad))
    }

    /// Instant at which the pose was true, s.
    #[getter]
    fn pose_time_s(&self) -> Option<f64> {
        self.sample.pose.map(|pose| pose.time_s)
    }

    /// (roll, pitch), rad, right side down and nose up positive.
    #[getter]
    fn attitude_rad(&self) -> Option<(f64, f64)> {
        let attitude = self.sample.attitude?.value;
        Some((attitude.roll_rad, attitude.pitch_rad))
    }

    /// (left, right) as the encoders count them, before c_l and c_r, m/s.
    #[getter]
    fn tread_speeds_m_s(&self) -> Option<(f64, f64)> {
        let treads = self.sample.tread_speeds?.value;
        Some((treads.left_m_s, treads.right_m_s))
    }

    /// Yaw rate about the body's upward axis, rad/s; None without a gyroscope.
    #[getter]
    fn yaw_rate_rad_s(&self) -> Option<f64> {
        self.sample.yaw_rate.map(|yaw_rate| yaw_rate.value)
    }

    /// Distance of the pose from the path, m, left of travel positive.
    #[getter]
    fn cross_track_m(&self) -> Option<f64> {
        self.progress.map(|progress| progress.cross_track_m)
    }

    /// Arc length of the nearest point of the path, m.
    #[getter]
    fn arc_length_m(&self) -> Option<f64> {
        self.progress.map(|progress| progress.arc_length_m)
    }

    /// The vehicle, as controllers know it.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        Vehicle(self.vehicle.clone())
    }

    /// Returns the reference (x_m, y_m, yaw_rad, speed_m_s) in so many seconds, for an array of n of them an array of
    /// shape (n, 4); speed negative in reverse.
    fn reference<'py>(&self, ahead_s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let ahead = Ahead::of(ahead_s)?;
        ahead.shown(ahead_s.py(), ahead.references(&self.reference))
    }

    fn __repr__(&self) -> String {
        format!("<sidehill.Measured at {} s>", self.sample.time_s)
    }
}

/// Instants ahead, a number or an array of them; read before a lock is taken, since Python code may run.
pub struct Ahead {
    seconds: Vec<f64>,
    is_array: bool,
}

impl Ahead {
    /// Returns the instants of an argument.
    pub fn of(ahead_s: &Bound<'_, PyAny>) -> PyResult<Self> {
        // A text has a length as well.
        let is_array = ahead_s.len().is_ok() && ahead_s.extract::<String>().is_err();
        let seconds = if is_array {
            let module = ahead_s.py().import("sidehill._arrays")?;
            let array = module.getattr("numbers")?.call1(("ahead_s", ahead_s, 1))?;
            array.extract::<PyReadonlyArray1<'_, f64>>()?.to_vec()?
        } else {
            vec![number("ahead_s", ahead_s)?]
        };
        match seconds.iter().find(|seconds| **seconds < 0.0) {
            Some(negative) => Err(invalid(format!("ahead_s: {negative} is negative"))),
            None => Ok(Self { seconds, is_array }),
        }
    }

    /// Returns where `reference` is then: (x_m, y_m, yaw_rad, speed_m_s), one after the other.
    pub fn references(&self, reference: &Reference) -> Vec<f64> {
        let points = self.seconds.iter().map(|ahead_s| reference.ahead(*ahead_s));
        let rows = points.map(|point| {
            let pose = point.pose();
            [pose.x_m, pose.y_m, pose.yaw_rad, point.speed_m_s]
        });
        rows.flatten().collect()
    }

    /// Returns these references as Python has them: a tuple, or an array with a row for each instant.
    pub fn shown<'py>(&self, py: Python<'py>, references: Vec<f64>) -> PyResult<Bound<'py, PyAny>> {
        if self.is_array {
            let array = PyArray1::from_vec(py, references);
            return Ok(array.reshape([self.seconds.len(), 4])?.into_any());
        }
        Ok(PyTuple::new(py, references)?.into_any())
    }
}

/// Returns a law that asks a Python callable for the speeds told to the drives; what it raises or gives wrongly ends the
/// run and is in `failure`.
pub fn law(
    callable: Py<PyAny>,
    vehicle: model::Vehicle,
    period_s: f64,
    failure: Failure,
) -> impl FnMut(&Sample, &Reference, Option<&Progress>) -> Option<MotorSpeeds> + Send {
    move |sample, reference, progress| {
        let measured = Measured {
            sample: *sample,
            reference: reference.clone(),
            progress: progress.copied(),
            vehicle: vehicle.clone(),
            period_s,
        };
        let asked = Python::attach(|py| {
            let given = callable.bind(py).call1((Py::new(py, measured)?,))?;
            crate::arguments::numbers("controllers", ["v_left_m_s", "v_right_m_s"], &given)
        });
        match asked {
            Ok([left_m_s, right_m_s]) => {
                let told = MeasuredTreadSpeeds {
                    left_m_s,
                    right_m_s,
                };
                Some(MeasuredMotorSpeeds::from(told).effective(&vehicle.encoder_scale))
            }
            Err(error) => {
                failure.put(error);
                None
            }
        }
    }
}
