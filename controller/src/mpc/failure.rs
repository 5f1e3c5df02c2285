//! Why there is no solution to use.

use serde::{Deserialize, Serialize};

/// Why there is no solution to use.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QpFailure {
    /// The data holds a value that is not finite; the solver was not touched.
    #[error("the QP's data is not finite")]
    NotFinite,
    /// The solver did not accept the problem.
    #[error("the solver rejected the QP's data")]
    Rejected,
    /// The time for this cycle was used up.
    #[error("the deadline passed after {iterations} iterations")]
    Deadline {
        /// Iterations done.
        iterations: u32,
    },
    /// The iterations allowed did not suffice.
    #[error("no solution within {iterations} iterations")]
    MaxIterations {
        /// Iterations done.
        iterations: u32,
    },
    /// No point meets the constraints.
    #[error("the QP is infeasible")]
    Infeasible,
    /// The factorisation broke down; the solver is made new.
    #[error("numerical error after {iterations} iterations")]
    Numerical {
        /// Iterations done.
        iterations: u32,
    },
    /// The solver claims success, the residuals do not.
    #[error("residuals too large: primal {primal:e}, dual {dual:e}, gap {gap:e}")]
    Residual {
        /// Largest violation of a constraint.
        primal: f64,
        /// Largest entry of the Lagrangian's gradient.
        dual: f64,
        /// Duality gap.
        gap: f64,
    },
}
