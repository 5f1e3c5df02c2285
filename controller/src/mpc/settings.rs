//! What an MPC is set up with besides its model.

use super::limits::InputLimits;
use serde::{Deserialize, Serialize};
use sidehill_plant::vehicle::RangeError;

/// Settings of the controller.
#[derive(Debug, Clone, PartialEq)]
pub struct MpcSettings {
    /// Number of stages N.
    pub stages: usize,
    /// Duration of a stage, s.
    pub step_s: f64,
    /// Control period, s: the first change of the inputs has this time, the later ones a stage's.
    pub period_s: f64,
    /// Stages condensed into one block.
    pub block_stages: usize,
    /// Weights of changes of the inputs, divided by the stage's duration, s/(m/s)^2.
    pub change_weights: ChangeWeights,
    /// Factor on the weights of the last stage.
    pub terminal_factor: f64,
    /// Limits of the inputs.
    pub limits: InputLimits,
    /// Soft bound on the cross-track error.
    pub corridor: Option<Corridor>,
    /// Solver settings.
    pub qp: QpSettings,
}

/// Weights of changes of the inputs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeWeights {
    /// Of traction.
    pub traction: f64,
    /// Of steer.
    pub steer: f64,
}

/// A soft bound on the cross-track error.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Corridor {
    /// Half width, m.
    pub half_width_m: f64,
    /// Weight of leaving it, 1/m^2.
    pub weight_per_m2: f64,
}

impl Corridor {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        for (key, value, high, range) in [
            (
                "corridor.half_width_m",
                self.half_width_m,
                100.0,
                "from 0.001 to 100 m",
            ),
            (
                "corridor.weight_per_m2",
                self.weight_per_m2,
                1e6,
                "from 0.001 to 1e6",
            ),
        ] {
            RangeError::check(key, value, 1e-3, high, range)?;
        }
        Ok(())
    }
}

/// Largest number of iterations of any solve.
pub const ITERATIONS_MAX: u32 = 100;

/// How the QP is handed to the solver.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QpMode {
    /// By the rows that bind, beginning with those of the cycle before, and by the interior-point
    /// method where they are not found.
    #[serde(alias = "relaxed_first")]
    WorkingSet,
    /// By the interior-point method, with one solver made at start, updated in place, set up for small
    /// well-scaled QPs.
    InPlace,
    /// By the interior-point method, with a solver of clarabel's defaults made new in each cycle: what
    /// tests and benches compare with.
    FreshDefaults,
}

/// Limits and tolerances of a solve.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct QpSettings {
    /// How the solver is used.
    pub mode: QpMode,
    /// Largest number of interior-point iterations: what ends a solve that gets nowhere; the deadline is
    /// what keeps the cycle's time.
    pub max_iterations: u32,
    /// Feasibility and gap tolerance of the solver.
    pub tolerance: f64,
    /// Largest primal and dual residual accepted by our own check, relative to the size of the terms
    /// they sum.
    pub accepted_residual: f64,
    /// Largest duality gap accepted, relative to the cost: a feasible point so far from the optimum
    /// is still a plan.
    pub accepted_gap: f64,
}

impl Default for QpSettings {
    fn default() -> Self {
        Self {
            mode: QpMode::WorkingSet,
            max_iterations: 60,
            tolerance: 1e-6,
            accepted_residual: 1e-3,
            accepted_gap: 0.2,
        }
    }
}

impl QpSettings {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        let check = RangeError::check;
        check(
            "solver.max_iterations",
            f64::from(self.max_iterations),
            1.0,
            f64::from(ITERATIONS_MAX),
            "from 1 to 100",
        )?;
        check(
            "solver.tolerance",
            self.tolerance,
            1e-12,
            1e-2,
            "from 1e-12 to 0.01",
        )?;
        check(
            "solver.accepted_residual",
            self.accepted_residual,
            1e-9,
            1.0,
            "from 1e-9 to 1",
        )?;
        check(
            "solver.accepted_gap",
            self.accepted_gap,
            1e-9,
            1.0,
            "from 1e-9 to 1",
        )?;
        Ok(())
    }
}
