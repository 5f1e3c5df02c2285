//! The controller, one step a control period.

use crate::arguments::{kind, number, numbers, object, seed};
use crate::decision::Decision;
use crate::errors::{failed, guarded, invalid};
use crate::scenario::Scenario;
use crate::vehicle::Vehicle;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::config::Overrides;
use sidehill_controller::controller as law;
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle as model;
use std::sync::{Mutex, MutexGuard};
use std::time::Instant;

/// Follows a scenario's path: one step() a control period.
///
/// Controller(scenario, kind="icrik-mpc", vehicle=None, seed=None). `kind` is a controller's name as in
/// scenarios; `vehicle` what it predicts with instead of the scenario's; `seed` replaces the scenario's.
/// Raises ValueError naming the argument or setting.
#[pyclass(frozen, module = "sidehill")]
pub struct Controller {
    law: Mutex<law::Controller>,
    vehicle: model::Vehicle,
    kind: &'static str,
    period_s: f64,
}

impl Controller {
    fn law(&self) -> PyResult<MutexGuard<'_, law::Controller>> {
        self.law.lock().map_err(|_| {
            PyRuntimeError::new_err("this controller has failed before; make a new one")
        })
    }
}

#[pymethods]
impl Controller {
    #[new]
    #[pyo3(signature = (scenario, kind=None, vehicle=None, seed=None))]
    fn new(
        py: Python<'_>,
        scenario: &Bound<'_, PyAny>,
        kind: Option<&Bound<'_, PyAny>>,
        vehicle: Option<&Bound<'_, PyAny>>,
        seed: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let scenario = object::<Scenario>("scenario", scenario)?.get();
        let kind = match kind {
            Some(kind) => self::kind("kind", kind)?,
            None => sidehill_controller::config::ControllerKind::IcrikMpc,
        };
        let vehicle = vehicle
            .map(|vehicle| object::<Vehicle>("vehicle", vehicle))
            .transpose()?
            .map(|vehicle| vehicle.get().0.clone());
        let overrides = Overrides {
            seed: self::seed(seed)?,
            ..Overrides::default()
        };
        guarded(py, || {
            let mut prepared = scenario.prepare(&overrides)?;
            prepared.vehicle = vehicle.unwrap_or(prepared.vehicle);
            Ok(Self {
                law: Mutex::new(prepared.controller(kind).map_err(failed)?),
                vehicle: prepared.vehicle,
                kind: kind.name(),
                period_s: prepared.controller.period_s,
            })
        })
    }

    /// Decides on the command from now until the next cycle.
    ///
    /// time_s: instant of this cycle, s.
    /// tread_speeds_m_s: (left, right) as measured, m/s, before c_l and c_r; true at time_s.
    /// attitude_rad: (roll, pitch), rad, right side down and nose up positive; true at time_s.
    /// pose: (time_s, x_m, y_m, z_m, yaw_rad) in the world, with the instant at which it was true, which may
    ///     be earlier; yaw counter-clockwise from Y_g.
    /// yaw_rate_rad_s: yaw rate about the body's upward axis, rad/s, counter-clockwise positive, as a gyroscope
    ///     measures it; true at time_s.
    ///
    /// A reading is None where no new one has come. Every doubt of the controller ends in a controlled stop,
    /// which status and reason of the decision tell. Raises ValueError where an argument has another shape,
    /// is not finite or has an angle beyond +-1.5 rad; the controller's state then stays. Safe to call from
    /// several threads, one after the other.
    #[expect(clippy::too_many_arguments, reason = "named ones in Python")]
    #[pyo3(signature = (time_s, *, tread_speeds_m_s=None, attitude_rad=None, pose=None, yaw_rate_rad_s=None, **unknown))]
    fn step(
        &self,
        py: Python<'_>,
        time_s: &Bound<'_, PyAny>,
        tread_speeds_m_s: Option<&Bound<'_, PyAny>>,
        attitude_rad: Option<&Bound<'_, PyAny>>,
        pose: Option<&Bound<'_, PyAny>>,
        yaw_rate_rad_s: Option<&Bound<'_, PyAny>>,
        unknown: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Decision> {
        if let Some(key) = unknown.and_then(|unknown| unknown.keys().into_iter().next()) {
            return Err(invalid(format!(
                "{key}: unknown; readings are tread_speeds_m_s, attitude_rad, pose and yaw_rate_rad_s"
            )));
        }
        let time_s = number("time_s", time_s)?;
        let sample = Sample {
            time_s,
            tread_speeds: tread_speeds_m_s
                .map(|value| tread_speeds(time_s, value))
                .transpose()?,
            attitude: attitude_rad
                .map(|value| attitude(time_s, value))
                .transpose()?,
            yaw_rate: yaw_rate_rad_s
                .map(|value| yaw_rate(time_s, value))
                .transpose()?,
            pose: pose.map(self::pose).transpose()?,
        };
        guarded(py, || {
            let mut law = self.law()?;
            let begin = Instant::now();
            let decided = law.step(&sample, None);
            let cycle = begin.elapsed();
            Ok(Decision::of(decided, &law, &self.vehicle, cycle))
        })
    }

    /// Stops the vehicle at its decelerations from the next cycle on, until rearm().
    fn request_stop(&self) -> PyResult<()> {
        self.law()?.request_stop();
        Ok(())
    }

    /// Lets a stopped controller drive again, with an estimate made from nothing.
    fn rearm(&self) -> PyResult<()> {
        self.law()?.rearm();
        Ok(())
    }

    /// Name of the controller.
    #[getter]
    fn kind(&self) -> &'static str {
        self.kind
    }

    /// The vehicle that it predicts with.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        Vehicle(self.vehicle.clone())
    }

    /// Control period, s.
    #[getter]
    fn period_s(&self) -> f64 {
        self.period_s
    }

    fn __repr__(&self) -> String {
        format!("<sidehill.Controller {}>", self.kind)
    }
}

fn tread_speeds(time_s: f64, value: &Bound<'_, PyAny>) -> PyResult<Stamped<MeasuredTreadSpeeds>> {
    let [left_m_s, right_m_s] = numbers("tread_speeds_m_s", ["left", "right"], value)?;
    let value = MeasuredTreadSpeeds {
        left_m_s,
        right_m_s,
    };
    Ok(Stamped { time_s, value })
}

fn attitude(time_s: f64, value: &Bound<'_, PyAny>) -> PyResult<Stamped<Attitude>> {
    let [roll_rad, pitch_rad] = numbers("attitude_rad", ["roll", "pitch"], value)?;
    let angle = Bounds::new(-1.5, 1.5, "rad");
    angle
        .check("attitude_rad: roll", roll_rad)
        .and_then(|_| angle.check("attitude_rad: pitch", pitch_rad))
        .map_err(invalid)?;
    let value = Attitude {
        roll_rad,
        pitch_rad,
    };
    Ok(Stamped { time_s, value })
}

fn yaw_rate(time_s: f64, value: &Bound<'_, PyAny>) -> PyResult<Stamped<f64>> {
    let value = number("yaw_rate_rad_s", value)?;
    Ok(Stamped { time_s, value })
}

fn pose(value: &Bound<'_, PyAny>) -> PyResult<Stamped<Pose>> {
    let fields = ["time_s", "x_m", "y_m", "z_m", "yaw_rad"];
    let [time_s, x_m, y_m, z_m, yaw_rad] = numbers("pose", fields, value)?;
    let value = Pose {
        x_m,
        y_m,
        z_m,
        yaw_rad,
    };
    Ok(Stamped { time_s, value })
}
