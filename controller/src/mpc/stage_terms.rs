//! The QP of a horizon stage by stage, without condensing.
//!
//! ```text
//! xi_{k+1} = A xi_k + B u_k,   A = I + a e_3',   xi_0 = 0,   u_{-1} = 0
//! cost = sum_k  1/2 xi_{k+1}' Q xi_{k+1} + f' xi_{k+1}
//!        + 1/2 sum_m [ r_m (u_k - u_{k-1} + o)_m^2  +  d_m (u_k)_m^2 ]
//!        + 1/2 w (s' (e_3' xi_k, u_k) + t)^2
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
    /// Q.
    pub(super) weight: [[f64; 3]; 3],
    /// f.
    pub(super) force: [f64; 3],
    /// r, 1/(m/s)^2.
    pub(super) change_weight: [f64; MOTORS],
    /// o: planned change from the stage before, m/s.
    pub(super) change: [f64; MOTORS],
    /// d, 1/(m/s)^2.
    pub(super) damping: f64,
    /// s: derivatives of a speed by the yaw before and the inputs.
    pub(super) speed_row: [f64; 1 + MOTORS],
    /// w, 1/(m/s)^2.
    pub(super) speed_weight: f64,
    /// t, m/s.
    pub(super) speed_error: f64,
}

impl StageTerms {
    /// Numbers that the terms consist of.
    pub const COUNT: usize = 34;

    /// Returns a, B by columns, three zeros, Q, f, r, o, d, s, w, t. The zeros were where a step ends, less the plan's next
    /// state.
    pub fn to_array(&self) -> [f64; Self::COUNT] {
        let mut copy = *self;
        let mut all = [0.0; Self::COUNT];
        for (place, from) in Self::places().zip(copy.numbers()) {
            all[place] = *from;
        }
        all
    }

    /// Returns the terms of [`Self::to_array`]'s numbers; those that are missing are 0.
    pub fn from_numbers(numbers: &[f64]) -> Self {
        let mut terms = Self::default();
        for (place, to) in Self::places().zip(terms.numbers()) {
            *to = numbers.get(place).copied().unwrap_or(0.0);
        }
        terms
    }

    /// Returns where the numbers stand in the array.
    fn places() -> impl Iterator<Item = usize> {
        (0..9).chain(12..Self::COUNT)
    }

    fn numbers(&mut self) -> impl Iterator<Item = &mut f64> {
        let motion = self
            .by_yaw
            .iter_mut()
            .chain(self.by_input.as_flattened_mut());
        let error = self.weight.as_flattened_mut().iter_mut();
        motion
            .chain(error)
            .chain(&mut self.force)
            .chain(&mut self.change_weight)
            .chain(&mut self.change)
            .chain(std::slice::from_mut(&mut self.damping))
            .chain(&mut self.speed_row)
            .chain([&mut self.speed_weight, &mut self.speed_error])
    }

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
