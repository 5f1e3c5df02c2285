//! The virtual rover as it answers CAN frames.

use crate::canopen::VirtualDrives;
use crate::controller_side::MotorReport;
use crate::frame::{Frame, FrameId};
use crate::layout::{Layout, Profile};
use crate::message::FrameFault;
use crate::vehicle_side::{CommandReader, ReportWriter, VehicleReport};
use serde::{Deserialize, Serialize};
use sidehill_bridge::drives::{DriveMode, MeasuredMotorSpeeds};
use sidehill_bridge::rover::{
    DriveConfig, DriveStep, Fault, FaultWindow, ReportTimer, RoverDrives, RoverSetup, VirtualDrive,
    VirtualRover,
};
use sidehill_plant::sample::Sample;
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::vehicle::{RangeError, SpeedCorrection};
use std::collections::VecDeque;
use std::sync::Arc;

/// Faults of a rover behind a CAN bus.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CanFault {
    /// The vehicle sends nothing.
    StopFeedback,
    /// The counters of all messages stand still. PDOs have none: those of CiA 402 drives go on.
    FreezeCounter,
    /// One bit is flipped in each frame that has a checksum.
    CorruptChecksum,
    /// The emergency stop is pressed.
    EmergencyStop,
    /// Frames arrive late by so many seconds.
    DelayS(f64),
    /// The motors keep their speeds and ignore commands.
    IgnoreCommands,
}

impl Fault for CanFault {
    fn presses_emergency_stop(&self) -> bool {
        *self == Self::EmergencyStop
    }

    fn ignores_commands(&self) -> bool {
        *self == Self::IgnoreCommands
    }

    fn delay_s(&self) -> f64 {
        match self {
            Self::DelayS(delay_s) => *delay_s,
            _ => 0.0,
        }
    }
}

/// Why a rover behind a CAN bus cannot go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CanRoverError {
    /// Ground or motion is undefined.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// A true value does not fit its signal.
    #[error(transparent)]
    Frame(#[from] FrameFault),
}

/// The drives, as the layout's profile has them.
enum CanDrives {
    Values {
        drive: VirtualDrive,
        commands: CommandReader,
    },
    Cia402(VirtualDrives),
}

impl RoverDrives for CanDrives {
    type Error = CanRoverError;

    fn step(&mut self, step: &DriveStep) -> Result<MeasuredMotorSpeeds, CanRoverError> {
        match self {
            Self::Values { drive, commands } => {
                drive.set_command(commands.command());
                Ok(drive.step(step.time_s, step.emergency_stop))
            }
            Self::Cia402(drives) => {
                Ok(drives.step(step.time_s, &step.motors, step.emergency_stop)?)
            }
        }
    }

    fn mode(&self) -> DriveMode {
        match self {
            Self::Values { drive, .. } => drive.mode(),
            Self::Cia402(drives) => drives.mode(),
        }
    }
}

/// What a rover behind a CAN bus is made of besides its simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct CanRoverSetup {
    /// Step of the simulation, s.
    pub dt_s: f64,
    /// The true c_l and c_r.
    pub correction: SpeedCorrection,
    /// The drives, unless they speak CiA 402.
    pub drive: DriveConfig,
    /// Time between reports, s, from 0.005 to 1.
    pub report_period_s: f64,
    /// Injected faults.
    pub faults: Vec<FaultWindow<CanFault>>,
}

/// A virtual rover whose drives, attitude sensor and pose source exchange CAN frames. It has no
/// socket: the caller passes frames in and out.
pub struct CanRover {
    rover: VirtualRover<CanDrives, CanFault>,
    layout: Arc<Layout>,
    reports: ReportWriter,
    timer: ReportTimer,
    outbox: Outbox,
}

impl CanRover {
    /// Returns a rover at standstill, disabled.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(
        simulation: Simulation,
        layout: Arc<Layout>,
        setup: CanRoverSetup,
    ) -> Result<Self, RangeError> {
        let timer = ReportTimer::new(setup.report_period_s)?;
        let keys = ["faults.after_enabled_s", "faults.for_s", "faults.delay_s"];
        setup.faults.iter().try_for_each(|f| f.validate(keys))?;
        let drive = VirtualDrive::new(setup.drive)?;
        let drives = match &layout.profile {
            Profile::Values(enable) => CanDrives::Values {
                drive,
                commands: CommandReader::new(Arc::clone(&layout), *enable),
            },
            Profile::Cia402(cia402) => {
                CanDrives::Cia402(VirtualDrives::new(Arc::clone(&layout), cia402))
            }
        };
        Ok(Self {
            rover: VirtualRover::new(RoverSetup {
                simulation,
                dt_s: setup.dt_s,
                correction: setup.correction,
                drives,
                faults: setup.faults,
            }),
            reports: ReportWriter::new(Arc::clone(&layout)),
            layout,
            timer,
            outbox: Outbox::default(),
        })
    }

    /// Returns the true state.
    pub fn state(&self) -> &TrueState {
        self.rover.state()
    }

    /// Returns the state of the drives.
    pub fn mode(&self) -> DriveMode {
        self.rover.drives().mode()
    }

    /// Returns the identifiers of the frames that the rover receives.
    pub fn received_ids(&self) -> Vec<FrameId> {
        match self.rover.drives() {
            CanDrives::Values { .. } => {
                let messages = self.layout.command.iter();
                messages.map(|message| message.id()).collect()
            }
            CanDrives::Cia402(drives) => drives.received_ids(),
        }
    }

    /// Returns when the next report is due, s.
    pub fn next_report_s(&self) -> f64 {
        self.timer.next_s()
    }

    /// Takes a frame that arrived at `time_s`.
    ///
    /// # Errors
    /// Which check it failed. It then has no effect.
    pub fn take(&mut self, frame: &Frame, time_s: f64) -> Result<(), FrameFault> {
        match self.rover.drives_mut() {
            CanDrives::Values { commands, .. } => commands.take(frame, time_s),
            CanDrives::Cia402(drives) => drives.take(frame, time_s),
        }
    }

    /// Simulates until `now_s`.
    ///
    /// # Errors
    /// Where and why ground or motion is undefined, or a speed that does not fit its signal.
    pub fn advance(&mut self, now_s: f64) -> Result<(), CanRoverError> {
        let outbox = &mut self.outbox;
        self.rover.advance(now_s, |rover, time_s| {
            while let CanDrives::Cia402(drives) = rover.drives_mut()
                && let Some(frame) = drives.next_frame()
            {
                outbox.queue(rover, time_s, frame);
            }
        })
    }

    /// Queues the frames of the report that is due now.
    ///
    /// # Errors
    /// A value that does not fit its signal.
    pub fn report(&mut self, now_s: f64) -> Result<(), FrameFault> {
        self.timer.count();
        let Sample {
            attitude,
            yaw_rate,
            pose,
            ..
        } = self.rover.simulation_mut().sample();
        let (motors, mode) = (self.rover.motors(), self.mode());
        let drives = match self.rover.drives() {
            CanDrives::Values { .. } => Some([motors.traction_m_s, motors.steer_m_s]),
            CanDrives::Cia402(_) => None,
        };
        let report = VehicleReport {
            drives: drives.map(|speeds| speeds.map(|speed_m_s| MotorReport { speed_m_s, mode })),
            attitude: attitude.map(|attitude| attitude.value),
            yaw_rate_rad_s: yaw_rate.map(|yaw_rate| yaw_rate.value),
            pose: pose.map(|pose| pose.value),
        };
        let (rover, outbox) = (&self.rover, &mut self.outbox);
        let frozen = rover.has_fault(now_s, |fault| *fault == CanFault::FreezeCounter);
        let corrupt = rover.has_fault(now_s, |fault| *fault == CanFault::CorruptChecksum);
        self.reports.write(&report, frozen, |mut frame| {
            if corrupt {
                frame.data[0] ^= 1;
            }
            outbox.queue(rover, now_s, frame);
        })
    }

    /// Passes the frames that are due now to `send`.
    pub fn flush(&mut self, now_s: f64, send: impl FnMut(Frame)) {
        self.outbox.flush(now_s, send);
    }
}

/// Frames and when they are due, s; in order, as on a bus.
#[derive(Default)]
struct Outbox(VecDeque<(f64, Frame)>);

impl Outbox {
    /// Keeps a frame until its delay is over, unless the rover is silent.
    fn queue(&mut self, rover: &VirtualRover<CanDrives, CanFault>, now_s: f64, frame: Frame) {
        if !rover.has_fault(now_s, |fault| *fault == CanFault::StopFeedback) {
            self.0.push_back((now_s + rover.delay_s(now_s), frame));
        }
    }

    fn flush(&mut self, now_s: f64, mut send: impl FnMut(Frame)) {
        while let Some((due_s, frame)) = self.0.front() {
            if *due_s > now_s {
                break;
            }
            send(*frame);
            self.0.pop_front();
        }
    }
}

#[cfg(test)]
mod tests;
