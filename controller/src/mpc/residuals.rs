//! How far a point of a QP is from optimal.

use serde::{Deserialize, Serialize};

/// Optimality of a point, computed from the QP and not from the solver's own account.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Residuals {
    /// Largest violation of a row, relative to 1 plus the largest value of one.
    pub primal: f64,
    /// Largest derivative of the Lagrangian by an input, relative to 1 plus the largest linear cost.
    pub dual: f64,
    /// Sum of multipliers times slacks, relative to 1 plus the cost.
    pub gap: f64,
}

impl Residuals {
    /// Returns whether all are at most `limit`; one that is not a number is not.
    pub fn within(&self, limit: f64) -> bool {
        self.primal <= limit && self.dual <= limit && self.gap <= limit
    }
}

/// Returns the larger of two values, or NaN where one is: a NaN must not hide behind a maximum.
pub fn nan_max(a: f64, b: f64) -> f64 {
    // No comparison with a NaN is true.
    if a >= b || a.is_nan() { a } else { b }
}
