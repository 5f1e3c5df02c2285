//! A virtual vehicle on the ROS 2 graph: a simulation that obeys commands and reports as a real one.

mod config;
mod report;

pub use config::{
    CommandKind, GnssConfig, PlanarOffset, Stream, VehicleFault, VehicleFaultKind, VehicleFrames,
    VehicleNodeConfig,
};
pub use report::{GNSS_FRAME, Report, map_from_odom};

use crate::drives::{DriveMode, MeasuredMotorSpeeds, MotorCommand};
use crate::ros2::convert::TwistMapping;
use crate::rover::{
    DriveConfig, DriveStep, ReportTimer, RoverDrives, RoverSetup, VirtualDrive, VirtualRover,
};
use report::Reporter;
use sidehill_plant::sample::Stamped;
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::{RangeError, SpeedCorrection, Vehicle};
use std::collections::VecDeque;

/// What a vehicle is made of besides its simulation.
pub struct VehicleSetup<'a> {
    /// Step of the simulation, s.
    pub dt_s: f64,
    /// The true c_l and c_r.
    pub correction: SpeedCorrection,
    /// Vehicle whose ICRs give the track width where the configuration gives none.
    pub vehicle: &'a Vehicle,
    /// The drives.
    pub drive: DriveConfig,
    /// Time between reports, s, from 0.005 to 1.
    pub report_period_s: f64,
    /// Stamp of the simulation's time 0, ns.
    pub origin_ns: i64,
}

/// The drives of a vehicle on the ROS 2 graph.
///
/// A command of ROS does not enable drives. They are enabled while commands arrive, and disabled when
/// none has arrived within their time-out; after an emergency stop they wait for a command of zero speed.
struct TopicDrives {
    drive: VirtualDrive,
    command: Option<Stamped<MeasuredMotorSpeeds>>,
    /// Whether the drives, disabled, were offered zero speed without "enable", and get it with
    /// "enable" next.
    prepared: bool,
    /// Whether a command of zero speed must come before any other counts.
    locked: bool,
}

impl TopicDrives {
    /// Returns what the drives are commanded now: the handshake of the drives, then the command.
    fn offer(&mut self) -> Option<Stamped<MotorCommand>> {
        let command = self.command?;
        if self.locked && command.value == MeasuredMotorSpeeds::STOP {
            self.locked = false;
        }
        let value = if self.drive.mode() == DriveMode::Enabled && !self.locked {
            MotorCommand {
                speeds: command.value,
                enable: true,
            }
        } else {
            self.prepared = !self.prepared && !self.locked;
            MotorCommand {
                speeds: MeasuredMotorSpeeds::STOP,
                enable: !self.prepared && !self.locked,
            }
        };
        Some(Stamped {
            time_s: command.time_s,
            value,
        })
    }
}

impl RoverDrives for TopicDrives {
    type Error = SimulationError;

    fn step(&mut self, step: &DriveStep) -> Result<MeasuredMotorSpeeds, SimulationError> {
        self.locked |= step.emergency_stop;
        let command = self.offer();
        self.drive.set_command(command);
        Ok(self.drive.step(step.time_s, step.emergency_stop))
    }

    fn mode(&self) -> DriveMode {
        self.drive.mode()
    }
}

/// A virtual rover that obeys commands and reports as one on the ROS 2 graph, apart from any network.
pub struct RosVehicle {
    rover: VirtualRover<TopicDrives, VehicleFaultKind>,
    twist: TwistMapping,
    config: VehicleNodeConfig,
    /// Angle that each wheel joint turns in a step for 1 m/s of its tread, rad.
    joint_step_rad: f64,
    angles_rad: [f64; 2],
    reporter: Reporter,
    timer: ReportTimer,
    /// Reports that wait for their delay: when they are due, s.
    delayed: VecDeque<(f64, Report)>,
}

impl RosVehicle {
    /// Returns a vehicle at standstill, disabled.
    ///
    /// # Errors
    /// [`RangeError`] for a setting out of range.
    pub fn new(
        simulation: Simulation,
        setup: &VehicleSetup<'_>,
        config: VehicleNodeConfig,
    ) -> Result<Self, RangeError> {
        config.validate()?;
        let timer = ReportTimer::new(setup.report_period_s)?;
        let twist = TwistMapping::new(config.track_width_m, setup.vehicle)?;
        let drives = TopicDrives {
            drive: VirtualDrive::new(setup.drive)?,
            command: None,
            prepared: false,
            locked: false,
        };
        Ok(Self {
            rover: VirtualRover::new(RoverSetup {
                simulation,
                dt_s: setup.dt_s,
                correction: setup.correction,
                drives,
                faults: config.faults.clone(),
            }),
            twist,
            joint_step_rad: setup.dt_s / config.joints.radius_m,
            angles_rad: [0.0; 2],
            reporter: Reporter::new(&config, twist, setup.origin_ns),
            timer,
            delayed: VecDeque::new(),
            config,
        })
    }

    /// Returns the settings.
    pub fn config(&self) -> &VehicleNodeConfig {
        &self.config
    }

    /// Returns the true state.
    pub fn state(&self) -> &TrueState {
        self.rover.state()
    }

    /// Returns the state of the drives.
    pub fn mode(&self) -> DriveMode {
        self.rover.drives().mode()
    }

    /// Returns how a twist commands the drives.
    pub fn twist(&self) -> TwistMapping {
        self.twist
    }

    /// Returns when the next report is due, s.
    pub fn next_report_s(&self) -> f64 {
        self.timer.next_s()
    }

    /// Takes a command that arrived at `time_s`.
    pub fn take(&mut self, motors: MeasuredMotorSpeeds, time_s: f64) {
        self.rover.drives_mut().command = Some(Stamped {
            time_s,
            value: motors,
        });
    }

    /// Simulates until `now_s`.
    ///
    /// # Errors
    /// Where and why ground or motion is undefined.
    pub fn advance(&mut self, now_s: f64) -> Result<(), SimulationError> {
        let (angles_rad, step_rad) = (&mut self.angles_rad, self.joint_step_rad);
        self.rover.advance(now_s, |rover, _| {
            let treads = MeasuredTreadSpeeds::from(rover.motors());
            angles_rad[0] += treads.left_m_s * step_rad;
            angles_rad[1] += treads.right_m_s * step_rad;
        })
    }

    /// Passes the reports that are due to `publish`: that of now, and those whose delay is over.
    pub fn report(&mut self, now_s: f64, mut publish: impl FnMut(Report)) {
        self.timer.count();
        let sample = self.rover.simulation_mut().sample();
        let state = self.rover.state();
        let mut report = self.reporter.report(&report::ReportReadings {
            sample,
            true_yaw_rate_rad_s: state.velocity.yaw_rate_rad_s,
            true_yaw_rad: state.pose.yaw_rad,
            angles_rad: self.angles_rad,
            time_s: state.time_s,
            jump_s: self.rover.faults(now_s).map(clock_jump_s).sum(),
            frozen: self
                .rover
                .has_fault(now_s, |fault| *fault == VehicleFaultKind::FreezeStamps),
        });
        for fault in self.rover.faults(now_s) {
            match fault {
                VehicleFaultKind::EmergencyStop => report.emergency_stop = true,
                VehicleFaultKind::DelayS(_) => {}
                fault => report.spoil(fault),
            }
        }
        let due_s = now_s + self.rover.delay_s(now_s);
        self.delayed.push_back((due_s, report));
        // A delay that has ended does not hold up what comes after it.
        while let Some(due) = self.delayed.iter().position(|(due_s, _)| *due_s <= now_s) {
            if let Some((_, report)) = self.delayed.remove(due) {
                publish(report);
            }
        }
    }
}

fn clock_jump_s(fault: &VehicleFaultKind) -> f64 {
    match fault {
        VehicleFaultKind::ClockJumpS(jump_s) => *jump_s,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests;
