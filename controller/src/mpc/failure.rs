//! Why a QP has no usable solution.

use serde::{Deserialize, Serialize};

/// Why a QP has no usable solution.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum QpFailure {
    /// The data holds a value that is not finite; the solver was not touched.
    #[error("the QP's data is not finite")]
    NotFinite,
    /// The solver did not accept the problem.
    #[error("the solver rejected the QP's data")]
    Rejected,
    /// The deadline of this cycle passed.
    #[error("the deadline passed after {iterations} iterations")]
    Deadline {
        /// Iterations done.
        iterations: u32,
    },
    /// The iteration limit was reached.
    #[error("no solution within {iterations} iterations")]
    MaxIterations {
        /// Iterations done.
        iterations: u32,
    },
    /// No point meets the constraints.
    #[error("the QP is infeasible")]
    Infeasible,
    /// The factorisation broke down; the solver is rebuilt.
    #[error("numerical error after {iterations} iterations")]
    Numerical {
        /// Iterations done.
        iterations: u32,
    },
    /// The solver reports success, but the residuals are too large.
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
