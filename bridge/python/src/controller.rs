//! The controller, one step a control period.

use crate::arguments::{html, kind, number, numbers, object, whole};
use crate::decision::Decision;
use crate::errors::{failed, guarded, invalid};
use crate::extra;
use crate::history::History;
use crate::qp::Qp;
use crate::scenario::Scenario;
use crate::vehicle::Vehicle;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::config::Overrides;
use sidehill_controller::config::ControllerKind;
use sidehill_controller::controller as law;
use sidehill_controller::mpc::{ExtraError, ExtraTerms, Mpc};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle as model;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Instant;

/// Follows a scenario's path: one step() a control period.
///
/// Controller(scenario, kind="icrik-mpc", vehicle=None, seed=None). `kind` is a controller's name as in
/// scenarios; `vehicle` what it predicts with instead of the scenario's; `seed` replaces the scenario's.
/// Raises ValueError naming the argument or setting.
///
/// A copy (copy.copy) goes on bit by bit as the original does in its place: so a roll-out branches. A pickle holds the
/// scenario and all that the controller was told, up to 10,000 calls; opening it repeats them. Equal are controllers of equal scenarios
/// that were made alike and told the same.
#[pyclass(frozen, module = "sidehill")]
pub struct Controller {
    state: Mutex<State>,
    origin: Origin,
    vehicle: model::Vehicle,
    period_s: f64,
}

/// What a controller is made of.
struct Origin {
    scenario: Py<Scenario>,
    kind: ControllerKind,
    vehicle: Option<model::Vehicle>,
    seed: Option<u64>,
}

#[derive(Clone)]
struct State {
    law: law::Controller,
    told: History<Told>,
    /// Whether the last cycle solved a QP.
    solved: bool,
}

/// What a controller was told, in the order of its calls.
#[derive(Debug, Clone)]
enum Told {
    Sample(Sample),
    Extra(Option<Arc<ExtraTerms>>),
    RequestStop,
    Rearm,
}

/// A [`Told`] as Python's own values: the call's name, the time and the readings of `step`, extra terms.
type Call = (
    String,
    f64,
    Option<(f64, f64)>,
    Option<(f64, f64)>,
    Option<(f64, f64, f64, f64, f64)>,
    Option<f64>,
    Option<extra::Numbers>,
);

impl State {
    fn tell(&mut self, told: Told) -> PyResult<()> {
        match &told {
            Told::Sample(sample) => {
                self.step(*sample);
                return Ok(());
            }
            Told::Extra(terms) => {
                let terms = terms.as_deref().cloned();
                self.law.set_extra_terms(terms).map_err(invalid)?;
                // The solver is that of the next QP.
                self.solved = false;
            }
            Told::RequestStop => self.law.request_stop(),
            Told::Rearm => self.law.rearm(),
        }
        self.told.push(told);
        Ok(())
    }

    fn step(&mut self, sample: Sample) -> law::Decision {
        let decided = self.law.step(&sample, None);
        self.solved = decided.solve.is_some();
        self.told.push(Told::Sample(sample));
        decided
    }
}

impl Controller {
    fn state(&self) -> PyResult<MutexGuard<'_, State>> {
        self.state.lock().map_err(|_| {
            PyRuntimeError::new_err("this controller has failed before; make a new one")
        })
    }

    fn of(py: Python<'_>, origin: Origin) -> PyResult<Self> {
        let overrides = Overrides {
            seed: origin.seed,
            ..Overrides::default()
        };
        let scenario = origin.scenario.get();
        let vehicle = origin.vehicle.clone();
        let kind = origin.kind;
        let (law, vehicle, period_s) = guarded(py, || {
            let mut prepared = scenario.prepare(&overrides)?;
            prepared.vehicle = vehicle.unwrap_or(prepared.vehicle);
            let law = prepared.controller(kind).map_err(failed)?;
            Ok((law, prepared.vehicle, prepared.controller.period_s))
        })?;
        Ok(Self {
            state: Mutex::new(State {
                law,
                told: History::new(),
                solved: false,
            }),
            origin,
            vehicle,
            period_s,
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
        let scenario = object::<Scenario>("scenario", scenario)?;
        let origin = Origin {
            kind: kind.map_or(Ok(ControllerKind::IcrikMpc), |kind| {
                self::kind("kind", kind)
            })?,
            vehicle: vehicle
                .map(|vehicle| object::<Vehicle>("vehicle", vehicle))
                .transpose()?
                .map(|vehicle| vehicle.get().0.clone()),
            seed: whole("seed", seed)?,
            scenario: scenario.clone().unbind(),
        };
        Self::of(py, origin)
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
            let mut state = self.state()?;
            let begin = Instant::now();
            let decided = state.step(sample);
            let cycle = begin.elapsed();
            Ok(Decision::of(decided, &state.law, &self.vehicle, cycle))
        })
    }

    /// Stops the vehicle at its decelerations from the next cycle on, until rearm().
    fn request_stop(&self) -> PyResult<()> {
        self.state()?.tell(Told::RequestStop)
    }

    /// Lets a stopped controller drive again, with an estimate made from nothing.
    fn rearm(&self) -> PyResult<()> {
        self.state()?.tell(Told::Rearm)
    }

    /// Adds costs and constraints to the plan from the next step on, in place of those added before; without arguments it
    /// removes them.
    ///
    /// With z_k = (x_m, y_m, yaw_rad, traction_m_s, steer_m_s), the planned state at the end of stage k and the effective
    /// input during it, the plan's cost is that of tracking plus the sum of (z_k - target_k)' weight_k (z_k - target_k), and
    /// low_k <= rows_k z_k <= high_k. The stub has shapes and the rest.
    #[pyo3(signature = (*, weight=None, target=None, rows=None, low=None, high=None))]
    fn set_extra_terms(
        &self,
        py: Python<'_>,
        weight: Option<&Bound<'_, PyAny>>,
        target: Option<&Bound<'_, PyAny>>,
        rows: Option<&Bound<'_, PyAny>>,
        low: Option<&Bound<'_, PyAny>>,
        high: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<()> {
        let arguments = extra::Arguments {
            weight,
            target,
            rows,
            low,
            high,
        };
        let stages = self.state()?.law.mpc().map(Mpc::stages);
        let stages = stages.ok_or_else(|| invalid(ExtraError::NoPlan))?;
        let terms = arguments.terms(py, stages)?.map(Arc::new);
        guarded(py, || self.state()?.tell(Told::Extra(terms)))
    }

    /// The QP that the last step solved, with its solution; None where it solved none.
    #[getter]
    fn qp(&self) -> PyResult<Option<Qp>> {
        let state = self.state()?;
        Ok(state.law.mpc().filter(|_| state.solved).map(Qp::of))
    }

    /// Covariance of what is learned, after the last step: for contact-mpc of the parameters of Estimate.learned, in their
    /// order, else of Estimate.slip_gains, row by row. The stub has units. None before the first readings, and of a
    /// controller that learns nothing.
    #[getter]
    fn learned_covariance<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let state = self.state()?;
        let Some(covariance) = state.law.learned_covariance() else {
            return Ok(None);
        };
        // Symmetric: rows and columns are alike.
        let array = PyArray1::from_slice(py, covariance.as_slice());
        array
            .reshape([covariance.nrows(), covariance.ncols()])
            .map(Some)
    }

    /// Name of the controller.
    #[getter]
    fn kind(&self) -> &'static str {
        self.origin.kind.name()
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

    fn __eq__(slf: &Bound<'_, Self>, other: &Bound<'_, PyAny>) -> PyResult<bool> {
        // Others may call it meanwhile.
        if slf.is(other) {
            return Ok(true);
        }
        let py = other.py();
        let Ok(other) = other.cast::<Self>() else {
            return Ok(false);
        };
        let (own, others) = (&slf.get().origin, &other.get().origin);
        let alike =
            (own.kind, &own.vehicle, own.seed) == (others.kind, &others.vehicle, others.seed);
        if !alike || !own.scenario.bind(py).eq(others.scenario.bind(py))? {
            return Ok(false);
        }
        let told = slf.get().state()?.told.summary();
        Ok(told == other.get().state()?.told.summary())
    }

    fn __copy__(&self, py: Python<'_>) -> PyResult<Self> {
        let state = self.state()?.clone();
        let Origin {
            scenario,
            kind,
            vehicle,
            seed,
        } = &self.origin;
        Ok(Self {
            state: Mutex::new(state),
            origin: Origin {
                scenario: scenario.clone_ref(py),
                kind: *kind,
                vehicle: vehicle.clone(),
                seed: *seed,
            },
            vehicle: self.vehicle.clone(),
            period_s: self.period_s,
        })
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__(py)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Pickled)> {
        let make = py.get_type::<Self>().getattr("_repeated")?;
        let calls = self
            .state()?
            .told
            .calls("Controller")?
            .iter()
            .map(call)
            .collect();
        let Origin {
            scenario,
            kind,
            vehicle,
            seed,
        } = &self.origin;
        let vehicle = vehicle.clone().map(|vehicle| Py::new(py, Vehicle(vehicle)));
        let pickled = (
            scenario.clone_ref(py),
            kind.name().to_owned(),
            vehicle.transpose()?,
            *seed,
            calls,
        );
        Ok((make, pickled))
    }

    /// Returns a controller that was told all this.
    #[staticmethod]
    fn _repeated(
        py: Python<'_>,
        scenario: Py<Scenario>,
        kind: &Bound<'_, PyAny>,
        vehicle: Option<Py<Vehicle>>,
        seed: Option<u64>,
        calls: Vec<Call>,
    ) -> PyResult<Self> {
        let origin = Origin {
            scenario,
            kind: self::kind("kind", kind)?,
            vehicle: vehicle.map(|vehicle| vehicle.get().0.clone()),
            seed,
        };
        let controller = Self::of(py, origin)?;
        guarded(py, || {
            let mut state = controller.state()?;
            for call in &calls {
                state.tell(told(call)?)?;
            }
            drop(state);
            Ok(controller)
        })
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        let (calls, rows) = (self.state()?.told.count(), PyDict::new(py));
        rows.set_item("kind", self.origin.kind.name())?;
        rows.set_item("scenario", self.origin.scenario.get().title())?;
        rows.set_item("vehicle", &self.vehicle.name)?;
        rows.set_item("period_s", self.period_s)?;
        rows.set_item("calls", calls)?;
        html("Controller", rows.as_any())
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!(
            "<sidehill.Controller {} of {} after {} calls>",
            self.origin.kind.name(),
            self.origin.scenario.get().title(),
            self.state()?.told.count()
        ))
    }
}

/// Arguments of [`Controller::_repeated`].
type Pickled = (
    Py<Scenario>,
    String,
    Option<Py<Vehicle>>,
    Option<u64>,
    Vec<Call>,
);

/// Name of the call that sets extra terms.
const EXTRA: &str = "set_extra_terms";

fn call(told: &Told) -> Call {
    let other = |name: &str, terms| (name.to_owned(), 0.0, None, None, None, None, terms);
    let sample = match told {
        Told::Sample(sample) => sample,
        Told::Extra(terms) => return other(EXTRA, terms.as_deref().map(extra::numbers)),
        Told::RequestStop => return other("request_stop", None),
        Told::Rearm => return other("rearm", None),
    };
    let treads = sample.tread_speeds.map(|treads| treads.value);
    let attitude = sample.attitude.map(|attitude| attitude.value);
    (
        "step".to_owned(),
        sample.time_s,
        treads.map(|treads| (treads.left_m_s, treads.right_m_s)),
        attitude.map(|attitude| (attitude.roll_rad, attitude.pitch_rad)),
        sample.pose.map(|Stamped { time_s, value }| {
            (time_s, value.x_m, value.y_m, value.z_m, value.yaw_rad)
        }),
        sample.yaw_rate.map(|yaw_rate| yaw_rate.value),
        None,
    )
}

fn told((name, time_s, treads, attitude, pose, yaw_rate, terms): &Call) -> PyResult<Told> {
    let time_s = *time_s;
    match name.as_str() {
        EXTRA => {
            let terms = terms.as_ref().map(extra::from_numbers).transpose()?;
            return Ok(Told::Extra(terms.map(Arc::new)));
        }
        "request_stop" => return Ok(Told::RequestStop),
        "rearm" => return Ok(Told::Rearm),
        _ => {}
    }
    Ok(Told::Sample(Sample {
        time_s,
        tread_speeds: treads.map(|(left_m_s, right_m_s)| Stamped {
            time_s,
            value: MeasuredTreadSpeeds {
                left_m_s,
                right_m_s,
            },
        }),
        attitude: attitude.map(|(roll_rad, pitch_rad)| Stamped {
            time_s,
            value: Attitude {
                roll_rad,
                pitch_rad,
            },
        }),
        yaw_rate: yaw_rate.map(|value| Stamped { time_s, value }),
        pose: pose.map(|(time_s, x_m, y_m, z_m, yaw_rad)| Stamped {
            time_s,
            value: Pose {
                x_m,
                y_m,
                z_m,
                yaw_rad,
            },
        }),
    }))
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
