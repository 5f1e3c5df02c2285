//! What an MPC is set up with besides its model.

use super::StageTimes;
use super::limits::InputLimits;
use super::step_limit::StepLimit;

/// Settings of the controller.
#[derive(Debug, Clone, PartialEq)]
pub struct MpcSettings {
    /// Number of stages N.
    pub stages: usize,
    /// Duration of the first stage, s.
    pub step_s: f64,
    /// Duration of the last stage, s; those between grow geometrically.
    pub last_step_s: f64,
    /// Control period, s: the first change of the inputs has this time, the later ones a stage's.
    pub period_s: f64,
    /// Weight of headings far from the path's tangent.
    pub heading_excess: HeadingExcess,
    /// Weight of the position across the path, 1/m^2.
    pub cross_per_m2: f64,
    /// Limits of the inputs.
    pub limits: InputLimits,
    /// How far a QP's solution is followed.
    pub step_limit: StepLimit,
    /// Solver settings.
    pub qp: QpSettings,
}

impl MpcSettings {
    /// Returns the times of the stages.
    pub fn stage_times(&self) -> StageTimes {
        StageTimes::new(self.stages, self.step_s, self.last_step_s)
    }
}

/// Weights of changes of the inputs, divided by a stage's duration where they are applied.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChangeWeights {
    /// Of traction, s/(m/s)^2.
    pub traction: f64,
    /// Of steer, s/(m/s)^2.
    pub steer: f64,
}

/// Weight of headings that no slide asks for: they are where a wrong model leads, and from them a vehicle that is heavy
/// in front turns downhill on a steep slope, and does not come back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingExcess {
    /// Heading error up to which nothing is added, rad, positive.
    pub free_rad: f64,
    /// What is added at twice that error, 1/rad^2.
    pub per_rad2: f64,
}

impl Default for HeadingExcess {
    fn default() -> Self {
        Self {
            free_rad: 0.5,
            per_rad2: 10.0,
        }
    }
}

impl HeadingExcess {
    /// Returns what a planned heading error adds to a stage's weight of the heading, 1/rad^2: it
    /// grows with the square of what is beyond `free_rad`, up to three times `free_rad`.
    pub fn weight(&self, error_rad: f64) -> f64 {
        /// Where the weight stops growing, in `free_rad` beyond it.
        const LARGEST: f64 = 2.0;
        let excess = ((error_rad.abs() - self.free_rad) / self.free_rad).clamp(0.0, LARGEST);
        self.per_rad2 * excess * excess
    }
}

/// Largest number of iterations of any solve.
pub const ITERATIONS_MAX: u32 = 100;

/// How a QP is solved.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum QpMode {
    /// By its active rows, beginning with those of the cycle before, and by the interior-point method where they are not
    /// found.
    ActiveSet,
    /// By the interior-point method: what tests and benches compare with.
    InteriorPoint,
}

/// Limits and tolerances of a solve.
#[derive(Debug, Clone, Copy, PartialEq)]
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
            mode: QpMode::ActiveSet,
            max_iterations: 60,
            tolerance: 1e-6,
            accepted_residual: 1e-3,
            accepted_gap: 0.2,
        }
    }
}
