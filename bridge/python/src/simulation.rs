//! The simulated vehicle of a scenario, step by step.

use crate::arguments::{html, number, object, whole};
use crate::errors::{failed, guarded, invalid};
use crate::history::History;
use crate::measured::Ahead;
use crate::scenario::Scenario;
use crate::simulate::plant_kind;
use crate::vehicle::Vehicle;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1};
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use sidehill::config::PlantKind;
use sidehill_controller::closed_loop::TrackingErrors;
use sidehill_controller::path::Point2;
use sidehill_controller::reference::{PROJECTION_WINDOW, Reference, stands};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::simulation::{self as core, Plant, SimulationError, TrueState};
use sidehill_plant::speeds::{EncoderScale, MeasuredMotorSpeeds, MeasuredTreadSpeeds};
use sidehill_plant::vehicle as model;
use std::panic::resume_unwind;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// The simulated vehicle of a scenario with the reference that it should follow, for a loop of one's own.
///
/// Simulation(scenario, plant=None, seed=None). `plant` is "icrik" or "contact" and, like `seed`, replaces
/// the scenario's. The drive train is the scenario's; what is read is the truth, without its sensors. Raises
/// ValueError naming the argument or setting.
///
/// A copy (copy.copy) goes on bit by bit as the original does in its place: so a roll-out branches. A pickle holds the
/// scenario and the steps, up to 10,000 calls; opening it repeats them. Equal are simulations of equal scenarios with the same steps.
#[pyclass(frozen, module = "sidehill")]
pub struct Simulation {
    world: Mutex<World>,
    origin: Origin,
    scale: EncoderScale,
    step_s: f64,
    vehicle: model::Vehicle,
}

/// What a simulation is made of.
struct Origin {
    scenario: Py<Scenario>,
    plant: Option<PlantKind>,
    seed: Option<u64>,
}

#[derive(Clone)]
struct World {
    plant: core::Simulation,
    reference: Reference,
    finished: bool,
    /// Speeds told to the drives and the steps for which they held.
    told: History<(MeasuredTreadSpeeds, u32)>,
}

impl World {
    fn state(&self) -> TrueState {
        Plant::state(&self.plant)
    }

    /// Returns how far the vehicle is from where the reference is now.
    fn errors(&self) -> TrackingErrors {
        let (state, point) = (self.state(), self.reference.ahead(0.0));
        let here = Point2 {
            x_m: state.pose.x_m,
            y_m: state.pose.y_m,
        };
        let (cross_track_m, along_track_m) = match self.reference.path() {
            Some(path) => {
                let nearest = path.nearest_within(&here, point.arc_length_m, &PROJECTION_WINDOW);
                let ahead_m = nearest.point.arc_length_m - point.arc_length_m;
                (nearest.cross_track_m, ahead_m)
            }
            None => (point.position.distance_m(&here), 0.0),
        };
        TrackingErrors {
            cross_track_m,
            along_track_m,
            heading_error_rad: wrap_angle(state.pose.yaw_rad - point.heading_rad),
        }
    }

    fn step(
        &mut self,
        told: MeasuredTreadSpeeds,
        scale: &EncoderScale,
        steps: u32,
    ) -> Result<(), SimulationError> {
        self.told.push((told, steps));
        let command = MeasuredMotorSpeeds::from(told).effective(scale);
        for _ in 0..steps {
            Plant::step(&mut self.plant, command)?;
        }
        let pose = self.state().pose;
        let here = PlanarPose {
            x_m: pose.x_m,
            y_m: pose.y_m,
            yaw_rad: pose.yaw_rad,
        };
        let elapsed_s = f64::from(steps) * self.plant.step_s();
        let progress = self.reference.advance(elapsed_s, &here, stands(command));
        self.finished |= progress.ended;
        Ok(())
    }
}

impl Simulation {
    fn world(&self) -> PyResult<MutexGuard<'_, World>> {
        self.world.lock().map_err(|_| {
            PyRuntimeError::new_err("this simulation has failed before; make a new one")
        })
    }

    /// Returns how many of the scenario's steps a duration has.
    fn steps(&self, dt_s: f64) -> PyResult<u32> {
        let steps = dt_s / self.step_s;
        let whole = steps.round();
        if !(1.0..=1e6).contains(&whole) || (steps - whole).abs() > 1e-6 {
            return Err(invalid(format!(
                "dt_s: {dt_s} s is not a whole number of steps of {} s",
                self.step_s
            )));
        }
        Ok(whole as u32)
    }

    /// Drives for `dt_s` where speeds are told, and writes to `row` what [`drive`] gives of it.
    fn drive(
        &self,
        told: Option<(MeasuredTreadSpeeds, f64)>,
        ahead_s: &[f64],
        row: &mut [f64],
    ) -> PyResult<()> {
        let mut world = self.world()?;
        let scale = &self.vehicle.encoder_scale;
        let mut failed = false;
        if let Some((told, dt_s)) = told {
            failed = world.step(told, scale, self.steps(dt_s)?).is_err();
        }
        let (state, errors) = (world.state(), world.errors());
        let counted = self.scale.invert(state.treads);
        let here = state.pose;
        let at = world.reference.ahead(0.0).position;
        let (sin, cos) = here.yaw_rad.sin_cos();
        let (first, rest) = row.split_at_mut(7);
        let (previews, last) = rest.split_at_mut(3 * ahead_s.len());
        first.copy_from_slice(&[
            errors.cross_track_m,
            errors.along_track_m,
            errors.heading_error_rad,
            state.attitude.roll_rad,
            state.attitude.pitch_rad,
            scale.left * counted.left_m_s,
            scale.right * counted.right_m_s,
        ]);
        for (preview, ahead_s) in previews.chunks_exact_mut(3).zip(ahead_s) {
            let to = world.reference.ahead(*ahead_s).pose();
            let (dx_m, dy_m) = (to.x_m - here.x_m, to.y_m - here.y_m);
            preview.copy_from_slice(&[
                cos * dx_m + sin * dy_m,
                -sin * dx_m + cos * dy_m,
                wrap_angle(to.yaw_rad - here.yaw_rad),
            ]);
        }
        last.copy_from_slice(&[
            (here.x_m - at.x_m).hypot(here.y_m - at.y_m),
            world.reference.time_s(),
            state.time_s,
            f64::from(u8::from(world.finished)),
            f64::from(u8::from(failed)),
        ]);
        Ok(())
    }

    fn of(py: Python<'_>, origin: Origin) -> PyResult<Self> {
        let scenario = origin.scenario.get();
        let (plant_kind, seed) = (origin.plant, origin.seed);
        let (prepared, plant) = guarded(py, || {
            let prepared = scenario.prepare_plant(plant_kind, seed)?;
            let plant = prepared.simulation().map_err(failed)?;
            Ok((prepared, plant))
        })?;
        Ok(Self {
            origin,
            scale: prepared.plant.encoder_scale(),
            step_s: prepared.step_s,
            vehicle: prepared.vehicle,
            world: Mutex::new(World {
                plant,
                reference: prepared.reference,
                finished: false,
                told: History::new(),
            }),
        })
    }
}

#[pymethods]
impl Simulation {
    #[new]
    #[pyo3(signature = (scenario, plant=None, seed=None))]
    fn new(
        py: Python<'_>,
        scenario: &Bound<'_, PyAny>,
        plant: Option<&Bound<'_, PyAny>>,
        seed: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let scenario = object::<Scenario>("scenario", scenario)?;
        let origin = Origin {
            plant: plant.map(plant_kind).transpose()?,
            seed: whole("seed", seed)?,
            scenario: scenario.clone().unbind(),
        };
        Self::of(py, origin)
    }

    /// Moves on by dt_s, a whole number of the scenario's steps, with these speeds told to the drives, m/s
    /// before `vehicle`'s c_l and c_r. The reference moves on with the vehicle, and waits where it is left behind.
    ///
    /// Raises ValueError naming the argument, or where the vehicle leaves the ground that is known.
    fn step(
        &self,
        py: Python<'_>,
        v_left_m_s: &Bound<'_, PyAny>,
        v_right_m_s: &Bound<'_, PyAny>,
        dt_s: &Bound<'_, PyAny>,
    ) -> PyResult<()> {
        let told = MeasuredTreadSpeeds {
            left_m_s: number("v_left_m_s", v_left_m_s)?,
            right_m_s: number("v_right_m_s", v_right_m_s)?,
        };
        let steps = self.steps(number("dt_s", dt_s)?)?;
        // As in `simulate`: what the controllers' vehicle takes for a speed is what the motors reach.
        let scale = &self.vehicle.encoder_scale;
        guarded(py, || {
            self.world()?.step(told, scale, steps).map_err(failed)
        })
    }

    /// The vehicle, as controllers know it with this plant.
    #[getter]
    fn vehicle(&self) -> Vehicle {
        Vehicle(self.vehicle.clone())
    }

    /// Time since the start, s.
    #[getter]
    fn time_s(&self) -> PyResult<f64> {
        Ok(self.world()?.state().time_s)
    }

    /// True pose (x_m, y_m, z_m, yaw_rad).
    #[getter]
    fn pose(&self) -> PyResult<(f64, f64, f64, f64)> {
        let pose = self.world()?.state().pose;
        Ok((pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad))
    }

    /// True (roll, pitch), rad.
    #[getter]
    fn attitude_rad(&self) -> PyResult<(f64, f64)> {
        let attitude = self.world()?.state().attitude;
        Ok((attitude.roll_rad, attitude.pitch_rad))
    }

    /// (left, right) as perfect encoders count them, m/s.
    #[getter]
    fn tread_speeds_m_s(&self) -> PyResult<(f64, f64)> {
        let counted = self.scale.invert(self.world()?.state().treads);
        Ok((counted.left_m_s, counted.right_m_s))
    }

    /// (cross_track_m, along_track_m, heading_error_rad): distance from the path, left of travel positive; by how
    /// much the vehicle is ahead of the reference along it; heading less that of the reference.
    #[getter]
    fn errors(&self) -> PyResult<(f64, f64, f64)> {
        let errors = self.world()?.errors();
        Ok((
            errors.cross_track_m,
            errors.along_track_m,
            errors.heading_error_rad,
        ))
    }

    /// Returns the reference (x_m, y_m, yaw_rad, speed_m_s) in so many seconds, for an array of n of them an array of
    /// shape (n, 4); speed negative in reverse.
    fn reference<'py>(&self, ahead_s: &Bound<'py, PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let ahead = Ahead::of(ahead_s)?;
        let references = ahead.references(&self.world()?.reference);
        ahead.shown(ahead_s.py(), references)
    }

    /// Time that following the reference from its start to its end takes, s.
    #[getter]
    fn reference_end_s(&self) -> PyResult<f64> {
        Ok(self.world()?.reference.end_s())
    }

    /// Whether the reference has come to its end.
    #[getter]
    fn finished(&self) -> PyResult<bool> {
        Ok(self.world()?.finished)
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
        let alike = (own.plant, own.seed) == (others.plant, others.seed);
        if !alike || !own.scenario.bind(py).eq(others.scenario.bind(py))? {
            return Ok(false);
        }
        let told = slf.get().world()?.told.summary();
        Ok(told == other.get().world()?.told.summary())
    }

    fn __copy__(&self, py: Python<'_>) -> PyResult<Self> {
        let world = self.world()?.clone();
        Ok(Self {
            world: Mutex::new(world),
            origin: Origin {
                scenario: self.origin.scenario.clone_ref(py),
                ..self.origin
            },
            scale: self.scale,
            step_s: self.step_s,
            vehicle: self.vehicle.clone(),
        })
    }

    fn __deepcopy__(&self, py: Python<'_>, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        self.__copy__(py)
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Pickled)> {
        let make = py.get_type::<Self>().getattr("_repeated")?;
        let calls = {
            let world = self.world()?;
            let told = world.told.calls("Simulation")?.iter();
            let calls = told.map(|(speeds, steps)| (speeds.left_m_s, speeds.right_m_s, *steps));
            calls.collect()
        };
        let plant = self.origin.plant.map(|plant| plant.name().to_owned());
        let scenario = self.origin.scenario.clone_ref(py);
        Ok((make, (scenario, plant, self.origin.seed, calls)))
    }

    /// Returns a simulation that has made these steps.
    #[staticmethod]
    fn _repeated(
        py: Python<'_>,
        scenario: Py<Scenario>,
        plant: Option<&Bound<'_, PyAny>>,
        seed: Option<u64>,
        calls: Vec<Call>,
    ) -> PyResult<Self> {
        let origin = Origin {
            scenario,
            plant: plant.map(plant_kind).transpose()?,
            seed,
        };
        let simulation = Self::of(py, origin)?;
        guarded(py, || {
            let mut world = simulation.world()?;
            for (left_m_s, right_m_s, steps) in calls {
                let told = MeasuredTreadSpeeds {
                    left_m_s,
                    right_m_s,
                };
                // A step that has failed fails again.
                if world
                    .step(told, &simulation.vehicle.encoder_scale, steps)
                    .is_err()
                {
                    break;
                }
            }
            drop(world);
            Ok(simulation)
        })
    }

    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        let rows = PyDict::new(py);
        let errors = self.errors()?;
        rows.set_item("scenario", self.origin.scenario.get().title())?;
        rows.set_item("vehicle", &self.vehicle.name)?;
        rows.set_item("time_s", self.time_s()?)?;
        rows.set_item("pose", self.pose()?)?;
        rows.set_item("cross_track_m", errors.0)?;
        rows.set_item("finished", self.finished()?)?;
        html("Simulation", rows.as_any())
    }

    fn __repr__(&self) -> PyResult<String> {
        Ok(format!(
            "<sidehill.Simulation of {} at {} s>",
            self.origin.scenario.get().title(),
            self.time_s()?
        ))
    }
}

/// Drives simulations side by side, on threads and without the interpreter's lock, and returns what `sidehill.gym` shows
/// of each: array of shape (n, 12 + 3 k).
///
/// told_m_s: left and right speeds of one after the other, n times two, m/s; none to look only. dt_s: n durations, s.
/// ahead_s: k instants at which the reference is shown, s.
///
/// Columns: cross-track, along-track and heading error; roll and pitch; effective speeds of the treads; for each instant
/// the reference to the right, ahead and its turn, seen from the vehicle; distance from the reference, how much of it is
/// behind (s at the speed asked for), time, whether the reference has ended and whether the step failed, so that the
/// vehicle is where it was.
#[pyfunction]
pub fn drive<'py>(
    py: Python<'py>,
    simulations: Vec<Py<Simulation>>,
    told_m_s: Option<PyReadonlyArray1<'py, f64>>,
    dt_s: PyReadonlyArray1<'py, f64>,
    ahead_s: PyReadonlyArray1<'py, f64>,
    threads: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (dt_s, ahead_s) = (dt_s.as_slice()?, ahead_s.as_slice()?);
    let told_m_s = told_m_s.as_ref().map(|told| told.as_slice()).transpose()?;
    let count = simulations.len();
    if dt_s.len() != count || told_m_s.is_some_and(|told| told.len() != 2 * count) {
        return Err(invalid(format!(
            "told_m_s, dt_s: two speeds and a duration for each of {count} simulations are needed"
        )));
    }
    let told = |index: usize| {
        told_m_s.map(|told| {
            let speeds = MeasuredTreadSpeeds {
                left_m_s: told[2 * index],
                right_m_s: told[2 * index + 1],
            };
            (speeds, dt_s[index])
        })
    };
    let width = 12 + 3 * ahead_s.len();
    let mut rows = vec![0.0; count * width];
    let simulations: Vec<&Simulation> = simulations.iter().map(Py::get).collect();
    guarded(py, || {
        let each = simulations.iter().zip(rows.chunks_exact_mut(width));
        // Whoever is free takes the next ones, so that nobody waits for a thread that the system has put aside.
        let waiting = Mutex::new(each.enumerate());
        let work = || -> PyResult<()> {
            loop {
                let taken: Vec<_> = {
                    let mut waiting = waiting.lock().unwrap_or_else(PoisonError::into_inner);
                    waiting.by_ref().take(TAKEN).collect()
                };
                if taken.is_empty() {
                    return Ok(());
                }
                for (index, (simulation, row)) in taken {
                    simulation.drive(told(index), ahead_s, row)?;
                }
            }
        };
        std::thread::scope(|scope| {
            let threads = threads.min(count.div_ceil(TAKEN));
            let others: Vec<_> = (1..threads).map(|_| scope.spawn(work)).collect();
            let own = work();
            others.into_iter().fold(own, |done, other| {
                done.and(other.join().unwrap_or_else(|panic| resume_unwind(panic)))
            })
        })
    })?;
    PyArray1::from_vec(py, rows).reshape([count, width])
}

/// Simulations that a thread takes at a time in [`drive`].
const TAKEN: usize = 8;

/// Left and right speed told to the drives, m/s, and the steps for which they held.
type Call = (f64, f64, u32);

/// Arguments of [`Simulation::_repeated`].
type Pickled = (Py<Scenario>, Option<String>, Option<u64>, Vec<Call>);
