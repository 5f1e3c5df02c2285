use anyhow::Result;
use sidehill_bridge::drives::DriveMode;
use sidehill_plant::simulation::TrueState;

/// A virtual rover with its port.
pub(super) trait Rover {
    /// Takes commands, simulates until `now_s`, and sends a report if one is due; returns whether it
    /// did.
    fn advance(&mut self, now_s: f64) -> Result<bool>;
    /// Recovers the port after the process was suspended.
    fn resume(&mut self) -> Result<()> {
        Ok(())
    }
    /// The true state.
    fn state(&self) -> &TrueState;
    /// State of the drives.
    fn mode(&self) -> DriveMode;
}
