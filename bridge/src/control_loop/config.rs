use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// Settings of the control loop.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CycleConfig {
    /// Period, from 0.01 (100 Hz) to 0.2 s; the same as `settings.period_s`.
    pub period_s: f64,
    /// Longest wait for the controller in a cycle; a later decision counts in the next.
    pub decision_time_s: f64,
}

impl Default for CycleConfig {
    fn default() -> Self {
        Self {
            period_s: 0.05,
            decision_time_s: 0.03,
        }
    }
}

impl CycleConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        Bounds::new(0.01, 0.2, "s").check("cycle.period_s", self.period_s)?;
        Bounds::new(0.001, self.period_s, "s")
            .with_note("at most cycle.period_s")
            .check("cycle.decision_time_s", self.decision_time_s)?;
        Ok(())
    }
}
