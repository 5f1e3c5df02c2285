//! The simulated vehicle of a scenario, step by step.

use crate::arguments::{number, object, seed};
use crate::errors::{failed, guarded, invalid};
use crate::scenario::Scenario;
use crate::simulate::plant_kind;
use crate::vehicle::Vehicle;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use sidehill::config::Overrides;
use sidehill_controller::closed_loop::TrackingErrors;
use sidehill_controller::path::Point2;
use sidehill_controller::reference::{PROJECTION_WINDOW, Reference, stands};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::simulation::{self as core, Plant, TrueState};
use sidehill_plant::speeds::{EncoderScale, MeasuredMotorSpeeds, MeasuredTreadSpeeds};
use sidehill_plant::vehicle as model;
use std::sync::{Mutex, MutexGuard};

/// The simulated vehicle of a scenario with the reference that it should follow, for a loop of one's own.
///
/// Simulation(scenario, plant=None, seed=None). `plant` is "icrik" or "contact" and, like `seed`, replaces
/// the scenario's. The drive train is the scenario's; what is read is the truth, without its sensors. Raises
/// ValueError naming the argument or setting.
#[pyclass(frozen, module = "sidehill")]
pub struct Simulation {
    world: Mutex<World>,
    scale: EncoderScale,
    step_s: f64,
    vehicle: model::Vehicle,
}

struct World {
    plant: core::Simulation,
    reference: Reference,
    finished: bool,
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
    ) -> PyResult<()> {
        let command = MeasuredMotorSpeeds::from(told).effective(scale);
        for _ in 0..steps {
            Plant::step(&mut self.plant, command).map_err(failed)?;
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
        let scenario = object::<Scenario>("scenario", scenario)?.get();
        let overrides = Overrides {
            plant: plant.map(plant_kind).transpose()?,
            seed: self::seed(seed)?,
            ..Overrides::default()
        };
        guarded(py, || {
            let prepared = scenario.prepare(&overrides)?;
            let plant = prepared.simulation().map_err(failed)?;
            Ok(Self {
                scale: prepared.plant.encoder_scale(),
                step_s: prepared.step_s,
                vehicle: prepared.vehicle,
                world: Mutex::new(World {
                    plant,
                    reference: prepared.reference,
                    finished: false,
                }),
            })
        })
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
        let dt_s = number("dt_s", dt_s)?;
        let steps = dt_s / self.step_s;
        let whole = steps.round();
        if !(1.0..=1e6).contains(&whole) || (steps - whole).abs() > 1e-6 {
            return Err(invalid(format!(
                "dt_s: {dt_s} s is not a whole number of steps of {} s",
                self.step_s
            )));
        }
        // As in `simulate`: what the controllers' vehicle takes for a speed is what the motors reach.
        let scale = &self.vehicle.encoder_scale;
        guarded(py, || self.world()?.step(told, scale, whole as u32))
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

    /// Returns the reference (x_m, y_m, yaw_rad, speed_m_s) in so many seconds; speed negative in reverse.
    fn reference(&self, ahead_s: &Bound<'_, PyAny>) -> PyResult<(f64, f64, f64, f64)> {
        let ahead_s = number("ahead_s", ahead_s)?;
        if ahead_s < 0.0 {
            return Err(invalid(format!("ahead_s: {ahead_s} is negative")));
        }
        let point = self.world()?.reference.ahead(ahead_s);
        let pose = point.pose();
        Ok((pose.x_m, pose.y_m, pose.yaw_rad, point.speed_m_s))
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
}
