//! A virtual vehicle on the bus: a simulation that answers as motors, AHRS and pose source do.

use crate::can::cia402::VirtualDrives;
use crate::can::controller_side::MotorReport;
use crate::can::frame::{Frame, FrameId};
use crate::can::layout::{DriveMode, Layout, Profile};
use crate::can::message::FrameFault;
use crate::can::vehicle_side::{CommandReader, ReportWriter, VehicleReport};
use crate::drive::{DriveConfig, DriveInput, VirtualDrive};
use crate::motors::MeasuredMotorSpeeds;
use serde::{Deserialize, Serialize};
use sidehill_plant::sample::Sample;
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::vehicle::{RangeError, SpeedCorrection};
use std::collections::VecDeque;
use std::sync::Arc;

/// Something that goes wrong on purpose.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct InjectedFault {
    /// When it begins, s after the drives were switched on first.
    pub after_enabled_s: f64,
    /// How long it lasts, s.
    pub for_s: f64,
    /// What goes wrong.
    pub fault: FaultKind,
}

/// What can go wrong.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FaultKind {
    /// The vehicle sends nothing.
    StopFeedback,
    /// The counters of all messages stand. PDOs have none, so that those of CiA 402 go on.
    FreezeCounter,
    /// A bit of each frame is wrong that has a checksum.
    CorruptChecksum,
    /// Somebody presses the emergency stop.
    EmergencyStop,
    /// Frames arrive late by so many seconds.
    DelayS(f64),
    /// The motors go on as they did and no longer obey.
    IgnoreCommands,
}

impl InjectedFault {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let check = |key, value| RangeError::check(key, value, 0.0, 1e6, "from 0 to 1e6 s");
        check("faults.after_enabled_s", self.after_enabled_s)?;
        check("faults.for_s", self.for_s)?;
        if let FaultKind::DelayS(delay_s) = self.fault {
            RangeError::check("faults.delay_s", delay_s, 0.0, 10.0, "from 0 to 10 s")?;
        }
        Ok(())
    }
}

/// Why a virtual vehicle cannot go on.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VirtualVehicleError {
    /// There is no ground or no motion.
    #[error(transparent)]
    Simulation(#[from] SimulationError),
    /// What is true does not fit its signal.
    #[error(transparent)]
    Frame(#[from] FrameFault),
}

/// Its drives, as their profile has them.
enum Drives {
    Values {
        drive: VirtualDrive,
        commands: CommandReader,
    },
    Cia402(VirtualDrives),
}

/// The vehicle with its drives.
pub struct VirtualVehicle {
    simulation: Simulation,
    dt_s: f64,
    correction: SpeedCorrection,
    layout: Arc<Layout>,
    drives: Drives,
    reports: ReportWriter,
    report_period_s: f64,
    reported: u64,
    faults: Vec<InjectedFault>,
    first_enabled_s: Option<f64>,
    heading_for: MeasuredMotorSpeeds,
    /// Frames that wait for their delay: when they are due, s.
    delayed: VecDeque<(f64, Frame)>,
}

/// What a virtual vehicle is made of besides its simulation.
#[derive(Debug, Clone, PartialEq)]
pub struct VirtualVehicleSetup {
    /// Step of the simulation, s.
    pub dt_s: f64,
    /// The true c_l and c_r.
    pub correction: SpeedCorrection,
    /// The drives, unless they are of CiA 402.
    pub drive: DriveConfig,
    /// Time between reports, s, from 0.005 to 1.
    pub report_period_s: f64,
    /// What goes wrong.
    pub faults: Vec<InjectedFault>,
}

impl VirtualVehicle {
    /// Returns a vehicle that stands, off.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(
        simulation: Simulation,
        layout: Arc<Layout>,
        setup: VirtualVehicleSetup,
    ) -> Result<Self, RangeError> {
        let report_period_s = RangeError::check(
            "report_period_s",
            setup.report_period_s,
            0.005,
            1.0,
            "from 0.005 to 1 s",
        )?;
        setup.faults.iter().try_for_each(InjectedFault::validate)?;
        let drive = VirtualDrive::new(setup.drive)?;
        let drives = match &layout.profile {
            Profile::Values(enable) => Drives::Values {
                drive,
                commands: CommandReader::new(Arc::clone(&layout), *enable),
            },
            Profile::Cia402(cia402) => {
                Drives::Cia402(VirtualDrives::new(Arc::clone(&layout), cia402))
            }
        };
        Ok(Self {
            simulation,
            dt_s: setup.dt_s,
            correction: setup.correction,
            drives,
            reports: ReportWriter::new(Arc::clone(&layout)),
            layout,
            report_period_s,
            reported: 0,
            faults: setup.faults,
            first_enabled_s: None,
            heading_for: MeasuredMotorSpeeds::default(),
            delayed: VecDeque::new(),
        })
    }

    /// Returns what is true now.
    pub fn state(&self) -> &TrueState {
        self.simulation.state()
    }

    /// Returns the state of the drives.
    pub fn mode(&self) -> DriveMode {
        match &self.drives {
            Drives::Values { drive, .. } => drive.mode(),
            Drives::Cia402(drives) => drives.mode(),
        }
    }

    /// Returns the identifiers that the vehicle listens to.
    pub fn wanted(&self) -> Vec<FrameId> {
        match &self.drives {
            Drives::Values { .. } => {
                let messages = self.layout.command.iter();
                messages.map(|message| message.id()).collect()
            }
            Drives::Cia402(drives) => drives.wanted(),
        }
    }

    /// Returns when the next report is due, s.
    pub fn next_report_s(&self) -> f64 {
        self.reported as f64 * self.report_period_s
    }

    /// Takes a frame that arrived at `time_s`.
    ///
    /// # Errors
    /// Why it is not believed; the drives then go on as if it had not come.
    pub fn take(&mut self, frame: &Frame, time_s: f64) -> Result<(), FrameFault> {
        match &mut self.drives {
            Drives::Values { commands, .. } => commands.take(frame, time_s),
            Drives::Cia402(drives) => drives.take(frame, time_s),
        }
    }

    /// Simulates until `now_s`.
    ///
    /// # Errors
    /// Where and why there is no ground or no motion, or a speed that does not fit its signal.
    pub fn advance(&mut self, now_s: f64) -> Result<(), VirtualVehicleError> {
        while self.simulation.state().time_s + 0.5 * self.dt_s < now_s {
            let time_s = self.simulation.state().time_s;
            let target = self.step_drives(time_s)?;
            if self.mode() == DriveMode::Enabled {
                self.first_enabled_s.get_or_insert(time_s);
            }
            if !self.fails(time_s, |kind| kind == FaultKind::IgnoreCommands) {
                self.heading_for = target;
            }
            self.simulation
                .set_command(self.heading_for.effective(&self.correction))?;
            self.simulation.step()?;
        }
        Ok(())
    }

    /// Returns the speeds that the drives head for.
    fn step_drives(&mut self, time_s: f64) -> Result<MeasuredMotorSpeeds, FrameFault> {
        let emergency_stop = self.fails(time_s, |kind| kind == FaultKind::EmergencyStop);
        let motors = self.motors();
        match &mut self.drives {
            Drives::Values { drive, commands } => {
                let told = commands.told();
                Ok(drive.step(&DriveInput {
                    time_s,
                    told: told.map(|told| (told.time_s, told.order.motors, told.order.enable)),
                    emergency_stop,
                }))
            }
            Drives::Cia402(drives) => {
                let target = drives.step(time_s, &motors, emergency_stop)?;
                let frames: Vec<Frame> = std::iter::from_fn(|| drives.next_frame()).collect();
                for frame in frames {
                    self.queue(time_s, frame);
                }
                Ok(target)
            }
        }
    }

    /// Returns what the motors' own sensors see.
    fn motors(&self) -> MeasuredMotorSpeeds {
        let treads = self.simulation.state().treads;
        self.correction.invert(treads).into()
    }

    /// Makes the frames of the report that is due now.
    ///
    /// # Errors
    /// A value that does not fit its signal.
    pub fn report(&mut self, now_s: f64) -> Result<(), FrameFault> {
        self.reported += 1;
        let Sample { attitude, pose, .. } = self.simulation.sample();
        let (motors, mode) = (self.motors(), self.mode());
        let drives = match self.drives {
            Drives::Values { .. } => Some([motors.traction_m_s, motors.steer_m_s]),
            Drives::Cia402(_) => None,
        };
        let report = VehicleReport {
            drives: drives.map(|speeds| speeds.map(|speed_m_s| MotorReport { speed_m_s, mode })),
            attitude: attitude.map(|attitude| attitude.value),
            pose: pose.map(|pose| pose.value),
        };
        let frozen = self.fails(now_s, |kind| kind == FaultKind::FreezeCounter);
        let corrupt = self.fails(now_s, |kind| kind == FaultKind::CorruptChecksum);
        let mut frames = Vec::new();
        self.reports.write(&report, frozen, |mut frame| {
            if corrupt {
                frame.data[0] ^= 1;
            }
            frames.push(frame);
        })?;
        for frame in frames {
            self.queue(now_s, frame);
        }
        Ok(())
    }

    /// Passes the frames that are due now to `send`.
    pub fn flush(&mut self, now_s: f64, mut send: impl FnMut(Frame)) {
        while let Some((due_s, frame)) = self.delayed.front() {
            if *due_s > now_s {
                break;
            }
            send(*frame);
            self.delayed.pop_front();
        }
    }

    /// Keeps a frame until its delay is over, unless the vehicle says nothing.
    fn queue(&mut self, now_s: f64, frame: Frame) {
        if !self.fails(now_s, |kind| kind == FaultKind::StopFeedback) {
            self.delayed.push_back((now_s + self.delay_s(now_s), frame));
        }
    }

    fn fails(&self, now_s: f64, kind: impl Fn(FaultKind) -> bool) -> bool {
        self.active(now_s).any(|fault| kind(fault.fault))
    }

    fn delay_s(&self, now_s: f64) -> f64 {
        self.active(now_s)
            .map(|fault| match fault.fault {
                FaultKind::DelayS(delay_s) => delay_s,
                _ => 0.0,
            })
            .sum()
    }

    fn active(&self, now_s: f64) -> impl Iterator<Item = &InjectedFault> {
        let since_s = self.first_enabled_s.map(|first_s| now_s - first_s);
        self.faults.iter().filter(move |fault| {
            since_s.is_some_and(|since_s| {
                (fault.after_enabled_s..fault.after_enabled_s + fault.for_s).contains(&since_s)
            })
        })
    }
}
