use super::drive::{DriveConfig, VirtualDrive};
use super::virtual_rover::{RoverSetup, VirtualRover};
use crate::drives::{
    DriveCommand, DriveFeedback, LinkState, MotorCommand, Port, PortInputs, SendError,
};
use sidehill_plant::sample::{Sample, Stamped};
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::vehicle::{RangeError, SpeedCorrection};
use std::convert::Infallible;

/// A simulated vehicle in the same process. It advances to the time of each cycle, and so runs in
/// real time or faster, as the loop's clock does.
pub struct SimulatedPort {
    rover: VirtualRover<VirtualDrive, Infallible>,
    correction: SpeedCorrection,
    error: Option<SimulationError>,
}

impl SimulatedPort {
    /// Returns a port to `simulation`, which is at its time 0 and steps by `dt_s`.
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
            rover: VirtualRover::new(RoverSetup {
                simulation,
                dt_s,
                correction,
                drives: VirtualDrive::new(drive)?,
                faults: Vec::new(),
            }),
            correction,
            error: None,
        })
    }

    /// Returns the true state.
    pub fn state(&self) -> &TrueState {
        self.rover.state()
    }

    /// Returns why the simulation has ended, where it has. Its feedback has then stopped too.
    pub fn error(&self) -> Option<&SimulationError> {
        self.error.as_ref()
    }
}

impl Port for SimulatedPort {
    fn receive(&mut self, now_s: f64) -> PortInputs {
        if self.error.is_none() {
            self.error = self.rover.advance(now_s, |_, _| {}).err();
        }
        let state = *self.rover.state();
        let mut sample = self.rover.simulation_mut().sample();
        sample.time_s = now_s;
        if self.error.is_some() {
            sample = Sample {
                time_s: now_s,
                tread_speeds: None,
                attitude: None,
                yaw_rate: None,
                pose: None,
            };
        }
        PortInputs {
            sample,
            feedback: Some(Stamped {
                time_s: state.time_s,
                value: DriveFeedback {
                    speeds: state.motors,
                    mode: self.rover.drives().mode(),
                },
            }),
            forwarded: None,
            link: LinkState::Active,
            refused: 0,
        }
    }

    fn send(&mut self, now_s: f64, command: &DriveCommand) -> Result<(), SendError> {
        self.rover.drives_mut().set_command(Some(Stamped {
            time_s: now_s,
            value: MotorCommand::reaching(command, &self.correction),
        }));
        Ok(())
    }
}
