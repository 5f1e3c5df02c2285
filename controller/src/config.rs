//! Settings of a controller as a configuration file gives them; every key has a default.

mod supervisor;
mod weights;

pub use supervisor::SupervisorConfig;
pub use weights::Weights;

use crate::estimator::EstimatorSettings;
use crate::guard::GuardConfig;
use crate::memory::MemoryConfig;
use crate::mpc::limits::{InputLimits, MotorLimits};
use crate::mpc::{HeadingExcess, MpcSettings, QpSettings, StepLimit};
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
    /// Control period.
    pub period_s: f64,
    /// Stages of the horizon.
    pub stages: usize,
    /// Duration of the first stage.
    pub step_s: f64,
    /// Speed within which |traction| and the turning direction are rounded off, m/s.
    #[serde(skip)]
    pub smoothing_m_s: f64,
    /// Time from a command to its arrival at the motors.
    pub command_delay_s: f64,
    /// Time constant of the motors.
    pub motor_lag_s: f64,
    /// Where the attitude along the horizon comes from.
    pub attitude_preview: AttitudePreview,
    /// [Point of the vehicle](#tracked-point) that follows the path.
    pub tracked_point: TrackedPoint,
    /// [Weights](#weights) of the MPC.
    pub weights: Weights,
    /// How far a QP's solution is followed in a cycle.
    #[serde(skip)]
    pub step_limit: StepLimit,
    /// [Limits](#limits) of both motors.
    pub limits: InputLimits,
    /// QP solver.
    #[serde(skip)]
    pub solver: QpSettings,
    /// [State estimation](#estimator).
    pub estimator: EstimatorSettings,
    /// [Supervision](#supervisor).
    pub supervisor: SupervisorConfig,
    /// [Steepness guard](#guard); off without it, `guard: {}` switches it on.
    pub guard: Option<GuardConfig>,
    /// [What is kept](#memory) of what was learned; nothing without it, `memory: {}` switches it on.
    pub memory: Option<MemoryConfig>,
    /// Pure pursuit.
    #[serde(skip)]
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
            smoothing_m_s: 0.02,
            command_delay_s: 0.0,
            motor_lag_s: 0.0,
            attitude_preview: AttitudePreview::Measured,
            tracked_point: TrackedPoint::ORIGIN,
            weights: Weights::default(),
            step_limit: StepLimit::default(),
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

/// Duration of the horizon's last stage, in first stages; those between grow geometrically. What is far needs less detail.
const LAST_STEP: f64 = 22.0 / 15.0;

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
        Bounds::new(0.0, DELAY_MAX_S, "s")
            .check("command_delay_s + motor_lag_s", self.delay_s())?;
        Bounds::new(0.0, DELAY_MAX_S, "s").check("command_delay_s", self.command_delay_s)?;
        self.tracked_point.validate()?;
        self.weights.validate()?;
        self.limits.validate()?;
        self.supervisor.validate()?;
        if let Some(guard) = &self.guard {
            guard.validate()?;
        }
        self.estimator.validate()
    }

    /// Returns the time after which a command acts: delay and, as a further delay, the motors' lag.
    pub fn delay_s(&self) -> f64 {
        self.command_delay_s + self.motor_lag_s
    }

    /// Returns the settings of the MPC.
    pub fn mpc(&self) -> MpcSettings {
        MpcSettings {
            stages: self.stages,
            step_s: self.step_s,
            period_s: self.period_s,
            heading_excess: HeadingExcess::default(),
            cross_per_m2: self.weights.cross_per_m2,
            limits: self.limits,
            last_step_s: LAST_STEP * self.step_s,
            step_limit: self.step_limit,
            qp: self.solver,
        }
    }
}
