use super::{Port, Reading};
use crate::bus::SendFault;
use crate::drive::{DriveConfig, DriveInput, VirtualDrive};
use crate::motors::MeasuredMotorSpeeds;
use crate::safety::{BusState, DriveFeedback, Order};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::vehicle::{RangeError, SpeedCorrection};

/// A simulated vehicle in the same process. It goes on to the time of each cycle, so that it runs
/// in real time or faster as the cycle's clock does.
pub struct SimulatedPort {
    simulation: Simulation,
    correction: SpeedCorrection,
    drive: VirtualDrive,
    dt_s: f64,
    told: Option<(f64, MeasuredMotorSpeeds, bool)>,
    error: Option<SimulationError>,
}

impl SimulatedPort {
    /// Returns a port to `simulation`, which stands at its time 0 and steps by `dt_s`.
    ///
    /// # Errors
    /// [`RangeError`] for a setting of the drives out of range.
    pub fn new(
        simulation: Simulation,
        dt_s: f64,
        correction: SpeedCorrection,
        drive: DriveConfig,
    ) -> Result<Self, RangeError> {
        Ok(Self {
            simulation,
            correction,
            drive: VirtualDrive::new(drive)?,
            dt_s,
            told: None,
            error: None,
        })
    }

    /// Returns what is true now.
    pub fn state(&self) -> &TrueState {
        self.simulation.state()
    }

    /// Returns why the simulation has ended, where it has; its feedback has then stopped too.
    pub fn error(&self) -> Option<&SimulationError> {
        self.error.as_ref()
    }

    fn step(&mut self, time_s: f64) -> Result<(), SimulationError> {
        let target = self.drive.step(&DriveInput {
            time_s,
            told: self.told,
            emergency_stop: false,
        });
        self.simulation
            .set_command(target.effective(&self.correction))?;
        self.simulation.step().map(|_| ())
    }
}

impl Port for SimulatedPort {
    fn receive(&mut self, now_s: f64) -> Reading {
        let mut time_s = self.simulation.state().time_s;
        // Half a step of slack, so that rounding does not lose a step.
        while self.error.is_none() && time_s + 0.5 * self.dt_s < now_s {
            if let Err(error) = self.step(time_s) {
                self.error = Some(error);
            }
            time_s = self.simulation.state().time_s;
        }
        let state = *self.simulation.state();
        let mut sample = self.simulation.sample();
        sample.time_s = now_s;
        if self.error.is_some() {
            sample = Sample {
                time_s: now_s,
                tread_speeds: None,
                attitude: None,
                pose: None,
            };
        }
        Reading {
            sample,
            feedback: Some(Stamped {
                time_s: state.time_s,
                value: DriveFeedback {
                    speeds: state.motors,
                    mode: self.drive.mode(),
                },
            }),
            bus: BusState::Active,
            refused: 0,
        }
    }

    fn send(&mut self, now_s: f64, order: &Order) -> Result<(), SendFault> {
        let motors = MeasuredMotorSpeeds::reaching(order.speeds, &self.correction);
        self.told = Some((now_s, motors, order.enable));
        Ok(())
    }
}
