use anyhow::Result;
use sidehill_bridge::drives::DriveMode;
use sidehill_plant::simulation::TrueState;

/// A virtual rover with its port.
pub(super) trait Rover {
    /// Takes commands, simulates until `now_s`, and reports where that is due; returns whether it
    /// was.
    fn advance(&mut self, now_s: f64) -> Result<bool>;
    /// What is true.
    fn state(&self) -> &TrueState;
    /// State of the drives.
    fn mode(&self) -> DriveMode;
}
