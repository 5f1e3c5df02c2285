//! Settings of a controller as a configuration file gives them; every key has a default.

use crate::estimator::EstimatorSettings;
use crate::mpc::limits::{InputLimits, MotorLimits};
use crate::mpc::{ChangeWeights, Corridor, MpcSettings, QpMode, QpSettings, StageWeights};
use crate::pure_pursuit::PurePursuitSettings;
use crate::reference::Tracking;
use crate::trajectory::Motion;
use serde::{Deserialize, Serialize};
use sidehill_plant::vehicle::RangeError;

/// Which law turns estimate and reference into commands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum ControllerKind {
    /// MPC that predicts with ICRIK.
    IcrikMpc,
    /// The same MPC that predicts with ICRHK, the model for level ground.
    IcrhkMpc,
    /// The same MPC that predicts with an ideal differential drive.
    DiffdriveMpc,
    /// Regulated pure pursuit.
    PurePursuit,
}

impl ControllerKind {
    /// All kinds there are.
    pub const ALL: [Self; 4] = [
        Self::IcrikMpc,
        Self::IcrhkMpc,
        Self::DiffdriveMpc,
        Self::PurePursuit,
    ];

    /// Returns the name that command lines and tables use.
    pub fn name(self) -> &'static str {
        match self {
            Self::IcrikMpc => "icrik-mpc",
            Self::IcrhkMpc => "icrhk-mpc",
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
    /// The plane the vehicle stands on now, as its attitude shows it.
    Measured,
    /// A map of the ground, where there is one; else as `Measured`.
    Terrain,
}

/// Weights of the MPC's errors.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Weights {
    /// Position error along the path, 1/m^2.
    pub along_per_m2: f64,
    /// Position error across the path, 1/m^2.
    pub cross_per_m2: f64,
    /// Heading error while driving, 1/rad^2. Small: the heading that keeps the path is not its
    /// tangent.
    pub heading_per_rad2: f64,
    /// Added to the heading's weight where the plan's heading is off the tangent by twice
    /// `heading_free_rad`, in proportion to the square of what is beyond it, 1/rad^2. No slide asks for
    /// such headings: they are where a wrong model leads.
    pub heading_excess_per_rad2: f64,
    /// Heading error that a slide may ask for, rad.
    pub heading_free_rad: f64,
    /// Position error while turning on the spot, 1/m^2.
    pub pivot_position_per_m2: f64,
    /// Heading error while turning on the spot or standing at the end, 1/rad^2.
    pub pivot_heading_per_rad2: f64,
    /// Change of traction, s/(m/s)^2: divided by the duration of a stage.
    pub traction_change_s3_per_m2: f64,
    /// Change of steer, s/(m/s)^2.
    pub steer_change_s3_per_m2: f64,
    /// Factor on the errors at the end of the horizon.
    pub terminal_factor: f64,
}

impl Default for Weights {
    fn default() -> Self {
        Self {
            along_per_m2: 50.0,
            cross_per_m2: 50.0,
            heading_per_rad2: 0.02,
            heading_excess_per_rad2: 10.0,
            heading_free_rad: 0.5,
            pivot_position_per_m2: 5.0,
            pivot_heading_per_rad2: 5.0,
            traction_change_s3_per_m2: 0.05,
            steer_change_s3_per_m2: 0.05,
            terminal_factor: 1.0,
        }
    }
}

/// How the MPC grows calmer where its model has been seen to err: the weights of a change of steer and
/// of the heading rise from their own values to these with the square of the model's error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CautionConfig {
    /// Error of the predicted velocity at which caution is full, m/s; poses show it.
    pub error_m_s: f64,
    /// Weight of a change of steer at full caution, s/(m/s)^2.
    pub steer_change_s3_per_m2: f64,
    /// Weight of the heading error at full caution, 1/rad^2.
    pub heading_per_rad2: f64,
}

impl Default for CautionConfig {
    fn default() -> Self {
        Self {
            error_m_s: 0.01,
            steer_change_s3_per_m2: 0.2,
            heading_per_rad2: 0.4,
        }
    }
}

/// Soft bound on the cross-track error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CorridorConfig {
    /// Half width, m.
    pub half_width_m: f64,
    /// Weight of leaving it, 1/m^2.
    pub weight_per_m2: f64,
}

/// Settings of the QP solver.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SolverConfig {
    /// Largest number of interior-point iterations.
    pub max_iterations: u32,
    /// Tolerance of the solver.
    pub tolerance: f64,
    /// Largest relative primal and dual residual that the controller's own check accepts.
    pub accepted_residual: f64,
    /// Largest relative duality gap that it accepts.
    pub accepted_gap: f64,
    /// How the solver is used.
    pub mode: QpMode,
}

impl Default for SolverConfig {
    fn default() -> Self {
        Self {
            max_iterations: 25,
            tolerance: 1e-6,
            accepted_residual: 1e-3,
            accepted_gap: 0.2,
            mode: QpMode::RelaxedFirst,
        }
    }
}

/// When the controller gives up and stops the vehicle.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SupervisorConfig {
    /// Oldest pose that is still driven on, s.
    pub pose_timeout_s: f64,
    /// Oldest attitude that is still driven on, s.
    pub attitude_timeout_s: f64,
    /// Oldest tread speeds that are still driven on, s.
    pub speeds_timeout_s: f64,
    /// Largest distance from the path, m.
    pub cross_track_max_m: f64,
    /// Largest difference between heading and reference, rad.
    pub heading_error_max_rad: f64,
    /// Cycles in a row that may drive on the shifted previous plan.
    pub fallback_cycles: u32,
    /// Time after the reference's end within which the vehicle may still move, s.
    pub settle_time_s: f64,
}

impl Default for SupervisorConfig {
    fn default() -> Self {
        Self {
            pose_timeout_s: 0.5,
            attitude_timeout_s: 0.3,
            speeds_timeout_s: 0.3,
            cross_track_max_m: 2.0,
            heading_error_max_rad: 2.0,
            fallback_cycles: 10,
            settle_time_s: 3.0,
        }
    }
}

/// Everything a controller is set up with besides vehicle, reference and terrain.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ControllerConfig {
    /// Control period, s.
    pub period_s: f64,
    /// Stages of the horizon.
    pub stages: usize,
    /// Duration of a stage, s.
    pub step_s: f64,
    /// Stages condensed into one block of the QP.
    pub block_stages: usize,
    /// Speed within which |traction| and the turning direction are rounded off, m/s.
    pub smoothing_m_s: f64,
    /// Time from a command to its arrival at the motors, s.
    pub command_delay_s: f64,
    /// Time constant of the motors, s.
    pub motor_lag_s: f64,
    /// Largest distance by which the reference may run ahead of the vehicle on a path, m; a
    /// trajectory given in time hardly waits.
    pub lead_max_m: f64,
    /// Where the attitude along the horizon comes from.
    pub attitude_preview: AttitudePreview,
    /// Weights of the MPC.
    pub weights: Weights,
    /// Calm where the model errs.
    pub caution: CautionConfig,
    /// Soft corridor, none by default.
    pub corridor: Option<CorridorConfig>,
    /// Limits of both motors.
    pub limits: InputLimits,
    /// QP solver.
    pub solver: SolverConfig,
    /// State estimation.
    pub estimator: EstimatorSettings,
    /// Supervision.
    pub supervisor: SupervisorConfig,
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
            block_stages: 5,
            smoothing_m_s: 0.02,
            command_delay_s: 0.0,
            motor_lag_s: 0.0,
            lead_max_m: 0.3,
            attitude_preview: AttitudePreview::Measured,
            weights: Weights::default(),
            caution: CautionConfig::default(),
            corridor: None,
            limits: InputLimits {
                traction: motor,
                steer: motor,
                tread_speed_m_s: 2.0,
            },
            solver: SolverConfig::default(),
            estimator: EstimatorSettings::default(),
            supervisor: SupervisorConfig::default(),
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
        let check = RangeError::check;
        check("period_s", self.period_s, 0.005, 1.0, "from 0.005 to 1 s")?;
        check("stages", self.stages as f64, 2.0, 200.0, "from 2 to 200")?;
        check(
            "step_s",
            self.step_s,
            self.period_s,
            2.0,
            "from period_s to 2 s",
        )?;
        check(
            "block_stages",
            self.block_stages as f64,
            1.0,
            20.0,
            "from 1 to 20",
        )?;
        check(
            "smoothing_m_s",
            self.smoothing_m_s,
            1e-4,
            1.0,
            "from 0.0001 to 1 m/s",
        )?;
        check(
            "command_delay_s + motor_lag_s",
            self.delay_s(),
            0.0,
            DELAY_MAX_S,
            "from 0 to 1 s",
        )?;
        check(
            "command_delay_s",
            self.command_delay_s,
            0.0,
            DELAY_MAX_S,
            "from 0 to 1 s",
        )?;
        check(
            "lead_max_m",
            self.lead_max_m,
            0.01,
            10.0,
            "from 0.01 to 10 m",
        )?;
        let w = &self.weights;
        for (key, value) in [
            ("weights.along_per_m2", w.along_per_m2),
            ("weights.cross_per_m2", w.cross_per_m2),
            ("weights.heading_per_rad2", w.heading_per_rad2),
            ("weights.heading_excess_per_rad2", w.heading_excess_per_rad2),
            ("weights.pivot_position_per_m2", w.pivot_position_per_m2),
            ("weights.pivot_heading_per_rad2", w.pivot_heading_per_rad2),
            ("weights.terminal_factor", w.terminal_factor),
        ] {
            check(key, value, 0.0, 1e6, "from 0 to 1e6")?;
        }
        check(
            "weights.heading_free_rad",
            w.heading_free_rad,
            0.01,
            3.2,
            "from 0.01 to 3.2 rad",
        )?;
        // Without a price on changes the QP would not be strictly convex.
        for (key, value) in [
            (
                "weights.traction_change_s3_per_m2",
                w.traction_change_s3_per_m2,
            ),
            ("weights.steer_change_s3_per_m2", w.steer_change_s3_per_m2),
        ] {
            check(key, value, 1e-6, 1e6, "from 1e-6 to 1e6")?;
        }
        let caution = &self.caution;
        for (key, value) in [
            ("caution.error_m_s", caution.error_m_s),
            (
                "caution.steer_change_s3_per_m2",
                caution.steer_change_s3_per_m2,
            ),
            ("caution.heading_per_rad2", caution.heading_per_rad2),
        ] {
            check(key, value, 1e-6, 1e6, "from 1e-6 to 1e6")?;
        }
        if let Some(corridor) = &self.corridor {
            check(
                "corridor.half_width_m",
                corridor.half_width_m,
                1e-3,
                100.0,
                "from 0.001 to 100 m",
            )?;
            check(
                "corridor.weight_per_m2",
                corridor.weight_per_m2,
                1e-3,
                1e6,
                "from 0.001 to 1e6",
            )?;
        }
        self.limits.validate()?;
        let solver = &self.solver;
        check(
            "solver.max_iterations",
            f64::from(solver.max_iterations),
            1.0,
            200.0,
            "from 1 to 200",
        )?;
        check(
            "solver.tolerance",
            solver.tolerance,
            1e-12,
            1e-2,
            "from 1e-12 to 0.01",
        )?;
        check(
            "solver.accepted_residual",
            solver.accepted_residual,
            1e-9,
            1.0,
            "from 1e-9 to 1",
        )?;
        check(
            "solver.accepted_gap",
            solver.accepted_gap,
            1e-9,
            1.0,
            "from 1e-9 to 1",
        )?;
        let s = &self.supervisor;
        for (key, value) in [
            ("supervisor.pose_timeout_s", s.pose_timeout_s),
            ("supervisor.attitude_timeout_s", s.attitude_timeout_s),
            ("supervisor.speeds_timeout_s", s.speeds_timeout_s),
        ] {
            check(key, value, 0.01, 10.0, "from 0.01 to 10 s")?;
        }
        check(
            "supervisor.cross_track_max_m",
            s.cross_track_max_m,
            0.01,
            100.0,
            "from 0.01 to 100 m",
        )?;
        check(
            "supervisor.heading_error_max_rad",
            s.heading_error_max_rad,
            0.1,
            3.2,
            "from 0.1 to 3.2 rad",
        )?;
        check(
            "supervisor.settle_time_s",
            s.settle_time_s,
            0.0,
            60.0,
            "from 0 to 60 s",
        )?;
        self.estimator.validate()?;
        self.pure_pursuit.validate()
    }

    /// Returns the tracking of a path whose reference waits for the vehicle.
    pub fn along_path(&self) -> Tracking {
        Tracking::Path {
            lead_max_m: self.lead_max_m,
        }
    }

    /// Returns the tracking of a path for a law that looks at one point of it.
    pub fn along_path_by_cusps(&self) -> Tracking {
        Tracking::PathByCusps {
            lead_max_m: self.lead_max_m,
        }
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
            block_stages: self.block_stages,
            change_weights: ChangeWeights {
                traction: self.weights.traction_change_s3_per_m2,
                steer: self.weights.steer_change_s3_per_m2,
            },
            terminal_factor: self.weights.terminal_factor,
            limits: self.limits,
            corridor: self.corridor.map(|c| Corridor {
                half_width_m: c.half_width_m,
                weight_per_m2: c.weight_per_m2,
            }),
            qp: QpSettings {
                mode: self.solver.mode,
                max_iterations: self.solver.max_iterations,
                tolerance: self.solver.tolerance,
                accepted_residual: self.solver.accepted_residual,
                accepted_gap: self.solver.accepted_gap,
            },
        }
    }

    /// Returns the weight of a change of steer at a caution from 0 to 1.
    pub(crate) fn steer_change_weight(&self, caution: f64) -> f64 {
        let (own, full) = (
            self.weights.steer_change_s3_per_m2,
            self.caution.steer_change_s3_per_m2,
        );
        own + caution * (full - own).max(0.0)
    }

    /// Returns what a planned heading error adds to a stage's weight of the heading.
    pub(crate) fn heading_excess_weight(&self, error_rad: f64) -> f64 {
        /// Where the weight stops growing, in `heading_free_rad` beyond it.
        const LARGEST: f64 = 2.0;
        let free_rad = self.weights.heading_free_rad;
        let excess = ((error_rad.abs() - free_rad) / free_rad).clamp(0.0, LARGEST);
        self.weights.heading_excess_per_rad2 * excess * excess
    }

    /// Returns the weights of a stage at a caution from 0 to 1: at the end an error across the path is left as it is, for
    /// there is no way left on which to undo it.
    pub fn stage_weights(&self, motion: Motion, caution: f64) -> StageWeights {
        let w = &self.weights;
        let calmer = (self.caution.heading_per_rad2 - w.heading_per_rad2).max(0.0);
        match motion {
            Motion::Drive => StageWeights {
                along_per_m2: w.along_per_m2,
                cross_per_m2: w.cross_per_m2,
                heading_per_rad2: w.heading_per_rad2 + caution * calmer,
            },
            Motion::Pivot => StageWeights {
                along_per_m2: w.pivot_position_per_m2,
                cross_per_m2: w.pivot_position_per_m2,
                heading_per_rad2: w.pivot_heading_per_rad2,
            },
            Motion::Stand => StageWeights {
                along_per_m2: w.along_per_m2,
                cross_per_m2: 0.0,
                heading_per_rad2: w.pivot_heading_per_rad2,
            },
        }
    }
}
