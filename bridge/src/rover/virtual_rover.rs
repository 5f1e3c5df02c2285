use super::fault::{Fault, FaultWindow};
use crate::drives::{DriveMode, MeasuredMotorSpeeds};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::simulation::{Simulation, SimulationError, TrueState};
use sidehill_plant::vehicle::{RangeError, SpeedCorrection};

/// What the drives of a virtual rover see in a step of the simulation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveStep {
    /// Instant, s.
    pub time_s: f64,
    /// What the motors' own sensors measure.
    pub motors: MeasuredMotorSpeeds,
    /// Whether the emergency stop is pressed.
    pub emergency_stop: bool,
}

/// The drives of a virtual rover, as its port commands them.
pub trait RoverDrives {
    /// Why the rover cannot go on.
    type Error: From<SimulationError>;

    /// Advances to the instant of a step and returns the speeds that the motors head for.
    ///
    /// # Errors
    /// Why the drives cannot go on.
    fn step(&mut self, step: &DriveStep) -> Result<MeasuredMotorSpeeds, Self::Error>;

    /// Returns the state of both drives, the worse of the two.
    fn mode(&self) -> DriveMode;
}

/// What a virtual rover is made of.
pub struct RoverSetup<D, F> {
    /// The vehicle on its ground, at its time 0.
    pub simulation: Simulation,
    /// Step of the simulation, s.
    pub dt_s: f64,
    /// The true c_l and c_r.
    pub correction: SpeedCorrection,
    /// The drives, disabled.
    pub drives: D,
    /// Injected faults.
    pub faults: Vec<FaultWindow<F>>,
}

/// A simulated vehicle with its drives and injected faults; a port adds how commands come and reports
/// go.
pub struct VirtualRover<D, F> {
    simulation: Simulation,
    dt_s: f64,
    correction: SpeedCorrection,
    drives: D,
    faults: Vec<FaultWindow<F>>,
    first_enabled_s: Option<f64>,
    heading_for: MeasuredMotorSpeeds,
}

impl<D: RoverDrives, F: Fault> VirtualRover<D, F> {
    /// Returns a rover at standstill, disabled.
    pub fn new(setup: RoverSetup<D, F>) -> Self {
        Self {
            simulation: setup.simulation,
            dt_s: setup.dt_s,
            correction: setup.correction,
            drives: setup.drives,
            faults: setup.faults,
            first_enabled_s: None,
            heading_for: MeasuredMotorSpeeds::STOP,
        }
    }

    /// Returns the simulation.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// Returns the simulation, to read its sensors.
    pub fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    /// Returns the true state.
    pub fn state(&self) -> &TrueState {
        self.simulation.state()
    }

    /// Returns the drives.
    pub fn drives(&self) -> &D {
        &self.drives
    }

    /// Returns the drives, to command them.
    pub fn drives_mut(&mut self) -> &mut D {
        &mut self.drives
    }

    /// Returns what the motors' own sensors measure.
    pub fn motors(&self) -> MeasuredMotorSpeeds {
        let treads = self.simulation.state().treads;
        self.correction.invert(treads).into()
    }

    /// Simulates until `now_s`, and calls `after_step` with the instant at which each step began.
    ///
    /// # Errors
    /// Where and why ground or motion is undefined, or why the drives cannot continue.
    pub fn advance(
        &mut self,
        now_s: f64,
        mut after_step: impl FnMut(&mut Self, f64),
    ) -> Result<(), D::Error> {
        // Half a step of tolerance, so that rounding does not lose a step.
        while self.simulation.state().time_s + 0.5 * self.dt_s < now_s {
            let time_s = self.simulation.state().time_s;
            let target = self.drives.step(&DriveStep {
                time_s,
                motors: self.motors(),
                emergency_stop: self.has_fault(time_s, Fault::presses_emergency_stop),
            })?;
            if self.drives.mode() == DriveMode::Enabled {
                self.first_enabled_s.get_or_insert(time_s);
            }
            if !self.has_fault(time_s, Fault::ignores_commands) {
                self.heading_for = target;
            }
            self.simulation
                .set_command(self.heading_for.effective(&self.correction))?;
            self.simulation.step()?;
            after_step(self, time_s);
        }
        Ok(())
    }

    /// Returns the faults that are active at an instant.
    pub fn faults(&self, now_s: f64) -> impl Iterator<Item = &F> {
        let since_s = self.first_enabled_s.map(|first_s| now_s - first_s);
        self.faults
            .iter()
            .filter(move |window| since_s.is_some_and(|since_s| window.contains(since_s)))
            .map(|window| &window.fault)
    }

    /// Returns whether a fault of some kind is active at an instant.
    pub fn has_fault(&self, now_s: f64, kind: impl FnMut(&F) -> bool) -> bool {
        self.faults(now_s).any(kind)
    }

    /// Returns by how much messages of an instant are late, s.
    pub fn delay_s(&self, now_s: f64) -> f64 {
        self.faults(now_s).map(Fault::delay_s).sum()
    }
}

/// When a rover reports.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReportTimer {
    period_s: f64,
    reported: u64,
}

impl ReportTimer {
    /// Returns a timer whose first report is due at once.
    ///
    /// # Errors
    /// [`RangeError`] for a period, s, outside of 0.005 to 1.
    pub fn new(period_s: f64) -> Result<Self, RangeError> {
        Ok(Self {
            period_s: Bounds::new(0.005, 1.0, "s").check("report_period_s", period_s)?,
            reported: 0,
        })
    }

    /// Returns when the next report is due, s.
    pub fn next_s(&self) -> f64 {
        self.reported as f64 * self.period_s
    }

    /// Counts a report.
    pub fn count(&mut self) {
        self.reported += 1;
    }
}
