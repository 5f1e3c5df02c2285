//! How far a QP's solution is followed: as far as its linearisation is accurate.
//!
//! A QP about the previous plan predicts a cost; the model itself, run through the horizon with the new
//! inputs, gives the actual cost. With the actual over the predicted reduction of the cost
//!
//! ```text
//! rho = (J(u) - J(u + s du)) / (J(u) - J_linear(u + s du))
//! ```
//!
//! a step is taken where rho is large enough, and halved where it is not; the largest change of steer that
//! a step may start with (the trust region) grows after good predictions and shrinks to what was taken
//! after bad ones.

use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::{Bounds, RangeError};

/// Bounds of the trust region.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct StepLimit {
    /// Largest correction of planned steer in a cycle that is always tried, m/s.
    pub steer_min_m_s: f64,
    /// Largest correction of planned steer in a cycle after good predictions, m/s.
    pub steer_max_m_s: f64,
    /// Share of the predicted cost reduction that must be achieved for a step to be taken.
    pub accepted_share: f64,
}

impl Default for StepLimit {
    fn default() -> Self {
        Self {
            steer_min_m_s: 0.5,
            steer_max_m_s: 0.5,
            accepted_share: 0.1,
        }
    }
}

impl StepLimit {
    /// Whole steps, halved only where too little of the predicted reduction is achieved.
    pub(super) const WHOLE_STEP: Self = Self {
        steer_min_m_s: 100.0,
        steer_max_m_s: 100.0,
        accepted_share: 0.1,
    };

    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(1e-3, 100.0, "m/s").check("step_limit.steer_min_m_s", self.steer_min_m_s)?;
        Bounds::new(self.steer_min_m_s, 100.0, "m/s")
            .with_note("at least steer_min_m_s")
            .check("step_limit.steer_max_m_s", self.steer_max_m_s)?;
        Bounds::new(0.0, 1.0, "").check("step_limit.accepted_share", self.accepted_share)?;
        Ok(())
    }
}

/// Share of the predicted reduction above which the region grows.
const GOOD_SHARE: f64 = 0.7;
/// Halvings of a step at most.
pub(super) const HALVINGS: usize = 3;

/// The region as the cycles before left it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TrustRegion {
    limit: StepLimit,
    steer_m_s: f64,
}

impl TrustRegion {
    pub(super) fn new(limit: StepLimit) -> Self {
        Self {
            steer_m_s: limit.steer_min_m_s,
            limit,
        }
    }

    /// Returns the share of a correction of steer by at most `largest_m_s` that is tried first.
    pub(super) fn first_share(&self, largest_m_s: f64) -> f64 {
        (self.steer_m_s / largest_m_s.max(1e-12)).min(1.0)
    }

    /// Returns whether a step is taken whose costs were and are these.
    pub(super) fn takes(&self, before: f64, promised: f64, actual: f64) -> bool {
        before - actual >= self.limit.accepted_share * (before - promised)
    }

    /// Remembers how a step of at most `taken_m_s` came out; `at_once` marks a first try.
    pub(super) fn learn(
        &mut self,
        before: f64,
        promised: f64,
        actual: f64,
        taken_m_s: f64,
        at_once: bool,
    ) {
        if !at_once {
            self.steer_m_s = taken_m_s;
        } else if before - actual >= GOOD_SHARE * (before - promised) {
            self.steer_m_s *= 2.0;
        }
        self.steer_m_s = self
            .steer_m_s
            .clamp(self.limit.steer_min_m_s, self.limit.steer_max_m_s);
    }
}
