//! A Python object as the vehicle.

use crate::arguments::numbers;
use pyo3::prelude::*;
use sidehill_plant::frames::{Attitude, Pose};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::simulation::{Plant, TrueState};
use sidehill_plant::speeds::{EncoderScale, MeasuredMotorSpeeds, MeasuredTreadSpeeds, MotorSpeeds};
use std::sync::{Arc, Mutex, PoisonError};

/// Drives a Python object through `sidehill._plant.Adapter`, which gives plain numbers.
pub struct PythonPlant {
    adapter: Py<PyAny>,
    encoder_scale: EncoderScale,
    step_s: f64,
    state: TrueState,
    measured: MeasuredTreadSpeeds,
    failure: Failure,
}

/// What the object has raised, for the caller of the simulation.
#[derive(Clone, Default)]
pub struct Failure(Arc<Mutex<Option<PyErr>>>);

impl Failure {
    /// Returns it, once.
    pub fn take(&self) -> Option<PyErr> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner).take()
    }

    /// Holds what has been raised.
    pub fn put(&self, error: PyErr) {
        *self.0.lock().unwrap_or_else(PoisonError::into_inner) = Some(error);
    }
}

/// The object has raised something, which [`Failure`] holds.
#[derive(Debug, thiserror::Error)]
#[error("the plant has failed")]
pub struct PlantFailed;

/// What the adapter gives: pose, attitude and measured tread speeds.
const FIELDS: [&str; 8] = [
    "x_m", "y_m", "z_m", "yaw_rad", "roll", "pitch", "left", "right",
];

impl PythonPlant {
    /// Returns `plant` reset to a pose and attitude; what it raises later will be in `failure`.
    ///
    /// # Errors
    /// What the object raises, or a `ValueError` about what it gives.
    pub fn new(
        plant: &Bound<'_, PyAny>,
        start: &TrueState,
        step_s: f64,
        encoder_scale: EncoderScale,
        failure: Failure,
    ) -> PyResult<Self> {
        let module = plant.py().import("sidehill._plant")?;
        let adapter = module.getattr("Adapter")?.call1((plant,))?;
        let pose = start.pose;
        let given = adapter.call_method1(
            "reset",
            (
                (pose.x_m, pose.y_m, pose.z_m, pose.yaw_rad),
                (start.attitude.roll_rad, start.attitude.pitch_rad),
            ),
        )?;
        let mut plant = Self {
            adapter: adapter.unbind(),
            encoder_scale,
            step_s,
            state: TrueState::default(),
            measured: MeasuredTreadSpeeds::default(),
            failure,
        };
        plant.take(&given)?;
        Ok(plant)
    }

    fn take(&mut self, given: &Bound<'_, PyAny>) -> PyResult<()> {
        let [
            x_m,
            y_m,
            z_m,
            yaw_rad,
            roll_rad,
            pitch_rad,
            left_m_s,
            right_m_s,
        ] = numbers("plant", FIELDS, given)?;
        self.measured = MeasuredTreadSpeeds {
            left_m_s,
            right_m_s,
        };
        let treads = self.encoder_scale.apply(self.measured);
        self.state = TrueState {
            pose: Pose {
                x_m,
                y_m,
                z_m,
                yaw_rad,
            },
            attitude: Attitude {
                roll_rad,
                pitch_rad,
            },
            motors: treads.into(),
            treads,
            ..self.state
        };
        Ok(())
    }
}

impl Plant for PythonPlant {
    type Error = PlantFailed;

    fn state(&self) -> TrueState {
        self.state
    }

    /// What the object gives is what the controller hears, at once.
    fn sample(&mut self) -> Sample {
        let time_s = self.state.time_s;
        Sample {
            time_s,
            tread_speeds: Some(Stamped {
                time_s,
                value: self.measured,
            }),
            attitude: Some(Stamped {
                time_s,
                value: self.state.attitude,
            }),
            yaw_rate: None,
            pose: Some(Stamped {
                time_s,
                value: self.state.pose,
            }),
        }
    }

    fn step_s(&self) -> f64 {
        self.step_s
    }

    fn step(&mut self, command_effective: MotorSpeeds) -> Result<TrueState, PlantFailed> {
        let told = MeasuredMotorSpeeds::reaching(command_effective, &self.encoder_scale);
        let told = MeasuredTreadSpeeds::from(told);
        let moved = Python::attach(|py| {
            let speeds = (told.left_m_s, told.right_m_s, self.step_s);
            let given = self.adapter.bind(py).call_method1("step", speeds)?;
            self.take(&given)
        });
        if let Err(error) = moved {
            self.failure.put(error);
            return Err(PlantFailed);
        }
        self.state.step_index += 1;
        // Multiplied and never accumulated, so that the clock does not drift.
        self.state.time_s = self.state.step_index as f64 * self.step_s;
        Ok(self.state)
    }
}
