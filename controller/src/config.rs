//! Settings of a controller as a configuration file gives them; every key has a default.

mod contact;
mod supervisor;
mod weights;

pub use contact::ContactMpcConfig;
pub use supervisor::SupervisorConfig;
pub use weights::{CautionConfig, Weights};

use crate::estimator::EstimatorSettings;
use crate::guard::GuardConfig;
use crate::memory::MemoryConfig;
use crate::mpc::limits::{InputLimits, MotorLimits};
use crate::mpc::{ChangeWeights, Corridor, HeadingExcess, MpcSettings, QpSettings, StepLimit};
use crate::pure_pursuit::PurePursuitSettings;
use crate::tracked_point::TrackedPoint;
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// Which law turns estimate and reference into commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ControllerKind {
    /// MPC that predicts with ICRIK.
    IcrikMpc,
    /// The same MPC that predicts with ICRHK, the model for level ground.
    IcrhkMpc,
    /// The same MPC that predicts with the balance of wheel friction.
    ContactMpc,
    /// The same MPC that predicts with an ideal differential drive.
    DiffdriveMpc,
    /// Regulated pure pursuit.
    PurePursuit,
}

impl ControllerKind {
    /// All kinds there are.
    pub const ALL: [Self; 5] = [
        Self::IcrikMpc,
        Self::IcrhkMpc,
        Self::ContactMpc,
        Self::DiffdriveMpc,
        Self::PurePursuit,
    ];

    /// Returns the name that command lines and tables use.
    pub fn name(self) -> &'static str {
        match self {
            Self::IcrikMpc => "icrik-mpc",
            Self::IcrhkMpc => "icrhk-mpc",
            Self::ContactMpc => "contact-mpc",
            Self::DiffdriveMpc => "diffdrive-mpc",
            Self::PurePursuit => "pure-pursuit",
        }
    }

    /// Returns the kind of that name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|kind| kind.name() == name)
    }
}

/// Where the attitude along the horizon comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum AttitudePreview {
    /// The plane under the vehicle now, from its attitude.
    Measured,
    /// A map of the ground, where there is one; else as `Measured`.
    Terrain,
}

/// Everything a controller is set up with besides vehicle, reference and terrain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControllerConfig {
    /// Control period, s.
    pub period_s: f64,
    /// Stages of the horizon.
    pub stages: usize,
    /// Duration of the first stage, s.
    pub step_s: f64,
    /// Duration of the last stage, s, where longer than the first's; those between grow geometrically.
    pub last_step_s: f64,
    /// Stages condensed into one block of the QP.
    pub block_stages: usize,
    /// Speed within which |traction| and the turning direction are rounded off, m/s.
    pub smoothing_m_s: f64,
    /// Time from a command to its arrival at the motors, s.
    pub command_delay_s: f64,
    /// Time constant of the motors, s.
    pub motor_lag_s: f64,
    /// Where the attitude along the horizon comes from.
    pub attitude_preview: AttitudePreview,
    /// Point of the vehicle that follows the path; the origin unless it is set.
    pub tracked_point: TrackedPoint,
    /// Weights of the MPC.
    pub weights: Weights,
    /// Calm where the model errs.
    pub caution: CautionConfig,
    /// Soft corridor, none by default.
    pub corridor: Option<Corridor>,
    /// How far a QP's solution is followed in a cycle.
    pub step_limit: StepLimit,
    /// What contact-mpc has in place of the settings above.
    pub contact: ContactMpcConfig,
    /// Limits of both motors.
    pub limits: InputLimits,
    /// QP solver.
    pub solver: QpSettings,
    /// State estimation.
    pub estimator: EstimatorSettings,
    /// Supervision.
    pub supervisor: SupervisorConfig,
    /// Steepness guard, none by default.
    pub guard: Option<GuardConfig>,
    /// What is kept of what was learned; nothing by default.
    pub memory: Option<MemoryConfig>,
    /// Pure pursuit.
    pub pure_pursuit: PurePursuitSettings,
}

impl Default for ControllerConfig {
    fn default() -> Self {
        let motor = MotorLimits {
            speed_m_s: 1.0,
            acceleration_m_s2: 2.0,
            deceleration_m_s2: 2.0,
        };
        Self {
            period_s: 0.05,
            stages: 40,
            step_s: 0.15,
            last_step_s: 0.15,
            block_stages: 5,
            smoothing_m_s: 0.02,
            command_delay_s: 0.0,
            motor_lag_s: 0.0,
            attitude_preview: AttitudePreview::Measured,
            tracked_point: TrackedPoint::ORIGIN,
            weights: Weights::default(),
            caution: CautionConfig::default(),
            corridor: None,
            step_limit: StepLimit::default(),
            contact: ContactMpcConfig::default(),
            limits: InputLimits {
                traction: motor,
                steer: motor,
                tread_speed_m_s: 2.0,
            },
            solver: QpSettings::default(),
            estimator: EstimatorSettings::default(),
            supervisor: SupervisorConfig::default(),
            guard: None,
            memory: None,
            pure_pursuit: PurePursuitSettings::default(),
        }
    }
}

/// Largest time a command may be under way, s: what the history of commands holds at 100 Hz.
const DELAY_MAX_S: f64 = 1.0;

impl ControllerConfig {
    /// Checks every range.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.005, 1.0, "s").check("period_s", self.period_s)?;
        Bounds::new(2.0, 200.0, "").check("stages", self.stages as f64)?;
        Bounds::new(self.period_s, 2.0, "s")
            .with_note("at least period_s")
            .check("step_s", self.step_s)?;
        Bounds::new(self.period_s, 10.0, "s")
            .with_note("at least period_s")
            .check("last_step_s", self.last_step_s)?;
        self.step_limit.validate()?;
        self.contact.validate()?;
        Bounds::new(1.0, 20.0, "").check("block_stages", self.block_stages as f64)?;
        Bounds::new(1e-4, 1.0, "m/s").check("smoothing_m_s", self.smoothing_m_s)?;
        Bounds::new(0.0, DELAY_MAX_S, "s")
            .check("command_delay_s + motor_lag_s", self.delay_s())?;
        Bounds::new(0.0, DELAY_MAX_S, "s").check("command_delay_s", self.command_delay_s)?;
        self.tracked_point.validate()?;
        self.weights.validate()?;
        self.caution.validate()?;
        if let Some(corridor) = &self.corridor {
            corridor.validate()?;
        }
        self.limits.validate()?;
        self.solver.validate()?;
        self.supervisor.validate()?;
        if let Some(guard) = &self.guard {
            guard.validate()?;
        }
        if let Some(memory) = &self.memory {
            memory.validate()?;
        }
        self.estimator.validate()?;
        self.pure_pursuit.validate()
    }

    /// Returns the time after which a command acts: delay and, as a further delay, the motors' lag.
    pub fn delay_s(&self) -> f64 {
        self.command_delay_s + self.motor_lag_s
    }

    /// Returns the settings with those of contact-mpc in their places.
    pub(crate) fn for_contact(mut self) -> Self {
        self.last_step_s = self.contact.last_step_s;
        self.weights.cross_ramp_s = self.contact.cross_ramp_s;
        self
    }

    /// Returns the settings of the MPC.
    pub fn mpc(&self) -> MpcSettings {
        MpcSettings {
            stages: self.stages,
            step_s: self.step_s,
            period_s: self.period_s,
            block_stages: self.block_stages,
            heading_excess: HeadingExcess {
                free_rad: self.weights.heading_free_rad,
                per_rad2: self.weights.heading_excess_per_rad2,
            },
            cross_per_m2: self.weights.cross_per_m2,
            terminal_factor: self.weights.terminal_factor,
            limits: self.limits,
            last_step_s: self.last_step_s,
            corridor: self.corridor,
            step_limit: self.step_limit,
            qp: self.solver,
        }
    }

    /// Returns the weights of changes of the inputs at a caution from 0 to 1.
    pub fn change_weights(&self, caution: f64) -> ChangeWeights {
        let (own, full) = (
            self.weights.steer_change_s3_per_m2,
            self.caution.steer_change_s3_per_m2,
        );
        ChangeWeights {
            traction: self.weights.traction_change_s3_per_m2,
            steer: own + caution * (full - own).max(0.0),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn changes_of_steer_cost_less_far_beside_the_path_than_on_it() {
        let contact = ContactMpcConfig::default();
        let factor = |distance_m| contact.steer_change(distance_m);
        assert_eq!(factor(0.0), contact.steer_change_on_path);
        let half_way = 0.5 * (contact.steer_change_on_path + contact.steer_change_off_path);
        assert!((factor(-contact.off_path_m) - half_way).abs() < 1e-12);
        assert!((factor(100.0) - contact.steer_change_off_path).abs() < 1e-6);
    }
}
