//! A virtual vehicle on the ROS 2 graph: a simulation that obeys commands and reports as a real one.

mod config;
mod node;
mod report;

pub use config::{
    CommandKind, PlanarOffset, Stream, VehicleFault, VehicleFaultKind, VehicleFrames,
    VehicleNodeConfig,
};
pub use node::VehicleNode;
pub use report::Report;

use crate::drives::DriveMode;
use crate::drives::MeasuredMotorSpeeds;
use crate::ros2::port::convert::TwistMapping;
use crate::rover::{DriveConfig, DriveInput, VirtualDrive};
use report::Reporter;
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::speeds::MeasuredTreadSpeeds;
use sidehill_plant::vehicle::{RangeError, SpeedCorrection, Vehicle};
use std::collections::VecDeque;

const ZERO: MeasuredMotorSpeeds = MeasuredMotorSpeeds {
    traction_m_s: 0.0,
    steer_m_s: 0.0,
};

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

/// The vehicle with its drives, apart from any network.
///
/// ROS has no word for switching drives on. They are on while commands come and off when none has
/// come for their time-out; after an emergency stop they wait for a command of zero.
pub struct RosVehicle {
    simulation: Simulation,
    dt_s: f64,
    correction: SpeedCorrection,
    twist: TwistMapping,
    config: VehicleNodeConfig,
    drive: VirtualDrive,
    told: Option<(f64, MeasuredMotorSpeeds)>,
    /// Whether the drives, being off, were offered zeros with "off" and next get "on".
    prepared: bool,
    /// Whether a command of zero must come before any other counts.
    locked: bool,
    heading_for: MeasuredMotorSpeeds,
    first_enabled_s: Option<f64>,
    angles_rad: [f64; 2],
    reporter: Reporter,
    report_period_s: f64,
    reported: u64,
    /// Reports that wait for their delay: when they are due, s.
    delayed: VecDeque<(f64, Report)>,
}

impl RosVehicle {
    /// Returns a vehicle that stands, off.
    ///
    /// # Errors
    /// [`RangeError`] for a setting out of range.
    pub fn new(
        simulation: Simulation,
        setup: &VehicleSetup<'_>,
        config: VehicleNodeConfig,
    ) -> Result<Self, RangeError> {
        config.validate()?;
        let report_period_s = RangeError::check(
            "report_period_s",
            setup.report_period_s,
            0.005,
            1.0,
            "from 0.005 to 1 s",
        )?;
        let twist = TwistMapping::new(config.track_width_m, setup.vehicle)?;
        Ok(Self {
            simulation,
            dt_s: setup.dt_s,
            correction: setup.correction,
            twist,
            drive: VirtualDrive::new(setup.drive)?,
            told: None,
            prepared: false,
            locked: false,
            heading_for: ZERO,
            first_enabled_s: None,
            angles_rad: [0.0; 2],
            reporter: Reporter::new(&config, twist, setup.origin_ns),
            report_period_s,
            reported: 0,
            delayed: VecDeque::new(),
            config,
        })
    }

    /// Returns the settings.
    pub fn config(&self) -> &VehicleNodeConfig {
        &self.config
    }

    /// Returns what is true now.
    pub fn state(&self) -> &TrueState {
        self.simulation.state()
    }

    /// Returns the state of the drives.
    pub fn mode(&self) -> DriveMode {
        self.drive.mode()
    }

    /// Returns how a twist commands the drives.
    pub fn twist(&self) -> TwistMapping {
        self.twist
    }

    /// Returns when the next report is due, s.
    pub fn next_report_s(&self) -> f64 {
        self.reported as f64 * self.report_period_s
    }

    /// Takes a command that arrived at `time_s`.
    pub fn take(&mut self, motors: MeasuredMotorSpeeds, time_s: f64) {
        self.told = Some((time_s, motors));
    }

    /// Simulates until `now_s`.
    ///
    /// # Errors
    /// Where and why there is no ground or no motion.
    pub fn advance(&mut self, now_s: f64) -> Result<(), SimulationError> {
        while self.simulation.state().time_s + 0.5 * self.dt_s < now_s {
            let time_s = self.simulation.state().time_s;
            let emergency_stop = self.fails(time_s, &VehicleFaultKind::EmergencyStop);
            self.locked |= emergency_stop;
            let told = self.offer();
            let target = self.drive.step(&DriveInput {
                time_s,
                told,
                emergency_stop,
            });
            if self.drive.mode() == DriveMode::Enabled {
                self.first_enabled_s.get_or_insert(time_s);
            }
            if !self.fails(time_s, &VehicleFaultKind::IgnoreCommands) {
                self.heading_for = target;
            }
            self.simulation
                .set_command(self.heading_for.effective(&self.correction))?;
            self.simulation.step()?;
            let MeasuredTreadSpeeds {
                left_m_s,
                right_m_s,
            } = self.correction.invert(self.simulation.state().treads);
            let per_m = self.dt_s / self.config.joints.radius_m;
            self.angles_rad[0] += left_m_s * per_m;
            self.angles_rad[1] += right_m_s * per_m;
        }
        Ok(())
    }

    /// The handshake of the drives, which a command of ROS does not speak: zeros and off, then zeros
    /// and on, then what is commanded.
    fn offer(&mut self) -> Option<(f64, MeasuredMotorSpeeds, bool)> {
        let (told_s, motors) = self.told?;
        if self.locked && motors == ZERO {
            self.locked = false;
        }
        if self.drive.mode() == DriveMode::Enabled && !self.locked {
            return Some((told_s, motors, true));
        }
        self.prepared = !self.prepared && !self.locked;
        Some((told_s, ZERO, !self.prepared && !self.locked))
    }

    /// Passes the reports that are due to `publish`: that of now, and those whose delay is over.
    pub fn report(&mut self, now_s: f64, mut publish: impl FnMut(Report)) {
        self.reported += 1;
        let sample = self.simulation.sample();
        let (active, jump_s) = self.active(now_s);
        let mut report = self.reporter.report(&report::Readings {
            sample,
            yaw_rate_rad_s: self.simulation.state().velocity.yaw_rate_rad_s,
            angles_rad: self.angles_rad,
            time_s: self.simulation.state().time_s,
            jump_s,
            frozen: active.contains(&VehicleFaultKind::FreezeStamps),
        });
        let mut delay_s = 0.0;
        for fault in &active {
            match fault {
                VehicleFaultKind::DelayS(by_s) => delay_s += by_s,
                VehicleFaultKind::EmergencyStop => report.emergency_stop = true,
                fault => report.spoil(fault),
            }
        }
        self.delayed.push_back((now_s + delay_s, report));
        // A delay that has ended does not hold up what comes after it.
        while let Some(due) = self.delayed.iter().position(|(due_s, _)| *due_s <= now_s) {
            if let Some((_, report)) = self.delayed.remove(due) {
                publish(report);
            }
        }
    }

    fn fails(&self, now_s: f64, kind: &VehicleFaultKind) -> bool {
        self.active(now_s).0.contains(kind)
    }

    /// The faults of now, and by how much the clock has jumped, s.
    fn active(&self, now_s: f64) -> (Vec<VehicleFaultKind>, f64) {
        let Some(first_s) = self.first_enabled_s else {
            return (Vec::new(), 0.0);
        };
        let since_s = now_s - first_s;
        let active: Vec<_> = self
            .config
            .faults
            .iter()
            .filter(|fault| {
                (fault.after_enabled_s..fault.after_enabled_s + fault.for_s).contains(&since_s)
            })
            .map(|fault| fault.fault.clone())
            .collect();
        let jump_s = active.iter().map(|fault| match fault {
            VehicleFaultKind::ClockJumpS(jump_s) => *jump_s,
            _ => 0.0,
        });
        let jump_s = jump_s.sum();
        (active, jump_s)
    }
}

#[cfg(test)]
mod tests;
