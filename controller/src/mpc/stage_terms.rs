//! The QP of a horizon stage by stage, without condensing.
//!
//! ```text
//! xi_{k+1} = A xi_k + B u_k + c,   A = I + a e_3',   xi_0 = 0,   u_{-1} = 0
//! cost = sum_k  1/2 xi_{k+1}' Q xi_{k+1} + f' xi_{k+1}  +  1/2 sum_m r_m (u_k - u_{k-1} + o)_m^2
//! ```

/// Inputs of a stage: traction and steer.
pub const MOTORS: usize = 2;

/// Dynamics and cost of a stage.
#[derive(Debug, Clone, Copy, Default)]
pub struct StageTerms {
    /// a: change of the state by the yaw before.
    pub(super) by_yaw: [f64; 3],
    /// Columns of B, 1/(m/s).
    pub(super) by_input: [[f64; 3]; MOTORS],
    /// c: where the step ends, less the plan.
    pub(super) defect: [f64; 3],
    /// Q.
    pub(super) weight: [[f64; 3]; 3],
    /// f.
    pub(super) force: [f64; 3],
    /// r, 1/(m/s)^2.
    pub(super) change_weight: [f64; MOTORS],
    /// o: planned change from the stage before, m/s.
    pub(super) change: [f64; MOTORS],
}

impl StageTerms {
    /// Returns A' of a vector.
    pub(super) fn back(&self, mut vector: [f64; 3]) -> [f64; 3] {
        vector[2] += dot(&self.by_yaw, &vector);
        vector
    }
}

/// Returns the product of two vectors.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}
