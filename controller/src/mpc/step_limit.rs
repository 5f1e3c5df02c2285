//! How far a QP's solution is followed: as far as its linearisation is accurate.
//!
//! A QP about the previous plan predicts a cost; the model itself, run through the horizon with the new
//! inputs, gives the actual cost. With the actual over the predicted reduction of the cost
//!
//! ```text
//! rho = (J(u) - J(u + s du)) / (J(u) - J_linear(u + s du))
//! ```
//!
//! a step is taken where rho is large enough, and halved where it is not. Where the first try of a cycle has a small
//! rho, the QPs of the cycles to come have a price on corrections of planned inputs, d (du)^2, as in the method of
//! Levenberg and Marquardt (Marquardt, "An algorithm for least-squares estimation of nonlinear parameters", 1963):
//! it grows from cycle to cycle until predictions come true again, and then falls.

/// Bounds of the steps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StepLimit {
    /// Largest correction of planned steer in a cycle, m/s.
    pub steer_m_s: f64,
    /// Share of the predicted cost reduction that must be achieved for a step to be taken.
    pub accepted_share: f64,
    /// Largest price d on corrections of planned inputs, s^2/m^2; 0 for none.
    pub damping_max_s2_per_m2: f64,
}

impl Default for StepLimit {
    fn default() -> Self {
        Self {
            steer_m_s: 0.5,
            accepted_share: 0.1,
            damping_max_s2_per_m2: 1000.0,
        }
    }
}

impl StepLimit {
    /// Returns the share of a correction of steer by at most `largest_m_s` that is tried first.
    pub(super) fn first_share(&self, largest_m_s: f64) -> f64 {
        (self.steer_m_s / largest_m_s.max(1e-12)).min(1.0)
    }
}

/// Halvings of a step at most.
pub(super) const HALVINGS: usize = 3;

/// Costs of a plan before a step, as the QP predicts them after it, and as the model has them.
#[derive(Debug, Clone, Copy)]
pub(super) struct StepCosts {
    pub(super) before: f64,
    pub(super) predicted: f64,
    pub(super) actual: f64,
}

impl StepCosts {
    /// Returns the largest actual cost with which a share of the predicted reduction is achieved.
    pub(super) fn largest(&self, share: f64) -> f64 {
        self.before - share * (self.before - self.predicted)
    }

    /// Returns whether a share of the predicted reduction was achieved.
    pub(super) fn achieve(&self, share: f64) -> bool {
        self.actual <= self.largest(share)
    }
}

/// The price on corrections of planned inputs as the cycles before left it.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Damping {
    /// d, s^2/m^2.
    pub(super) s2_per_m2: f64,
}

impl Damping {
    /// Share of the predicted reduction below which the price grows.
    const GOOD_SHARE: f64 = 0.5;
    /// Smallest price, s^2/m^2.
    const SMALLEST: f64 = 3.0;
    /// Factor between the prices of two cycles.
    const FACTOR: f64 = 4.0;

    /// Sets the price of the next cycle by how the first try of this one came out.
    pub(super) fn learn(&mut self, costs: &StepCosts, limit: &StepLimit) {
        self.s2_per_m2 = if !costs.achieve(Self::GOOD_SHARE) {
            (Self::FACTOR * self.s2_per_m2)
                .max(Self::SMALLEST)
                .min(limit.damping_max_s2_per_m2)
        } else if self.s2_per_m2 > Self::SMALLEST {
            self.s2_per_m2 / Self::FACTOR
        } else {
            0.0
        };
    }
}
