use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// A kind of fault that can be injected into a virtual rover.
pub trait Fault {
    /// Whether the emergency stop is pressed.
    fn presses_emergency_stop(&self) -> bool {
        false
    }

    /// Whether the motors keep their speeds and ignore commands.
    fn ignores_commands(&self) -> bool {
        false
    }

    /// By how much messages are late, s, from 0 to 10.
    fn delay_s(&self) -> f64 {
        0.0
    }
}

/// No fault is injected.
impl Fault for std::convert::Infallible {}

/// An injected fault and when it is active.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FaultWindow<F> {
    /// When it begins, after the drives were first switched on.
    pub after_enabled_s: f64,
    /// How long it lasts.
    pub for_s: f64,
    /// What goes wrong.
    pub fault: F,
}

impl<F: Fault> FaultWindow<F> {
    /// Checks the ranges of the window and of the delay, whose keys are given in this order.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self, keys: [&'static str; 3]) -> Result<(), RangeError> {
        let [after, duration, delay] = keys;
        for (key, value) in [(after, self.after_enabled_s), (duration, self.for_s)] {
            Bounds::new(0.0, 1e6, "s").check(key, value)?;
        }
        Bounds::new(0.0, 10.0, "s").check(delay, self.fault.delay_s())?;
        Ok(())
    }

    /// Returns whether the fault is active so long after the drives were first enabled.
    pub(super) fn contains(&self, since_s: f64) -> bool {
        (self.after_enabled_s..self.after_enabled_s + self.for_s).contains(&since_s)
    }
}
