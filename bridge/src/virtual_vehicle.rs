//! A virtual vehicle on the bus: a simulation that answers as motors, AHRS and pose source do.

use crate::can::controller_side::MotorReport;
use crate::can::frame::Frame;
use crate::can::layout::{DriveMode, Layout};
use crate::can::message::FrameFault;
use crate::can::vehicle_side::{CommandReader, NotPlayed, ReportWriter, VehicleReport};
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
    /// The counters of all messages stand.
    FreezeCounter,
    /// A bit of each frame is wrong.
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

/// Why there is no such virtual vehicle.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum VirtualVehicleError {
    /// A setting is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// The layout's drives are not played.
    #[error(transparent)]
    Layout(#[from] NotPlayed),
}

/// The vehicle with its drives.
pub struct VirtualVehicle {
    simulation: Simulation,
    dt_s: f64,
    correction: SpeedCorrection,
    drive: VirtualDrive,
    commands: CommandReader,
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
    /// The drives.
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
    /// A setting out of range, or a layout of CiA 402.
    pub fn new(
        simulation: Simulation,
        layout: Arc<Layout>,
        setup: VirtualVehicleSetup,
    ) -> Result<Self, VirtualVehicleError> {
        let report_period_s = RangeError::check(
            "report_period_s",
            setup.report_period_s,
            0.005,
            1.0,
            "from 0.005 to 1 s",
        )?;
        setup.faults.iter().try_for_each(InjectedFault::validate)?;
        Ok(Self {
            simulation,
            dt_s: setup.dt_s,
            correction: setup.correction,
            drive: VirtualDrive::new(setup.drive)?,
            commands: CommandReader::new(Arc::clone(&layout))?,
            reports: ReportWriter::new(layout),
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
        self.drive.mode()
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
        self.commands.take(frame, time_s)
    }

    /// Simulates until `now_s`.
    ///
    /// # Errors
    /// Where and why there is no ground or no motion.
    pub fn advance(&mut self, now_s: f64) -> Result<(), SimulationError> {
        while self.simulation.state().time_s + 0.5 * self.dt_s < now_s {
            let time_s = self.simulation.state().time_s;
            let told = self
                .commands
                .told()
                .map(|told| (told.time_s, told.order.motors, told.order.enable));
            let target = self.drive.step(&DriveInput {
                time_s,
                told,
                emergency_stop: self.fails(time_s, |kind| kind == FaultKind::EmergencyStop),
            });
            if self.drive.mode() == DriveMode::Enabled {
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

    /// Passes the frames of the report that is due now to `send`.
    ///
    /// # Errors
    /// A value that does not fit its signal.
    pub fn report(&mut self, now_s: f64, mut send: impl FnMut(Frame)) -> Result<(), FrameFault> {
        self.reported += 1;
        let Sample { attitude, pose, .. } = self.simulation.sample();
        let motors: MeasuredMotorSpeeds = self
            .correction
            .invert(self.simulation.state().treads)
            .into();
        let mode = self.drive.mode();
        let motor = |speed_m_s| MotorReport { speed_m_s, mode };
        let report = VehicleReport {
            traction: motor(motors.traction_m_s),
            steer: motor(motors.steer_m_s),
            attitude: attitude.map(|attitude| attitude.value),
            pose: pose.map(|pose| pose.value),
        };
        let frozen = self.fails(now_s, |kind| kind == FaultKind::FreezeCounter);
        let silent = self.fails(now_s, |kind| kind == FaultKind::StopFeedback);
        let corrupt = self.fails(now_s, |kind| kind == FaultKind::CorruptChecksum);
        let delay_s = self.delay_s(now_s);
        let delayed = &mut self.delayed;
        self.reports.write(&report, frozen, |mut frame| {
            if corrupt {
                frame.data[0] ^= 1;
            }
            if !silent {
                delayed.push_back((now_s + delay_s, frame));
            }
        })?;
        while let Some((due_s, frame)) = self.delayed.front() {
            if *due_s > now_s {
                break;
            }
            send(*frame);
            self.delayed.pop_front();
        }
        Ok(())
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
