use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;

/// Limits of the state machine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SafetyConfig {
    /// Largest age of the controller's command.
    pub command_timeout_s: f64,
    /// Largest age of the drives' feedback.
    pub feedback_timeout_s: f64,
    /// Longest time without a frame that could be sent.
    pub transmit_timeout_s: f64,
    /// Time of zero commands, disabled, before the drives are switched on.
    pub zeroing_time_s: f64,
    /// Longest time for each step of the handshake and for the controller's first command.
    pub handshake_timeout_s: f64,
    /// Speed below which a motor stands.
    pub standstill_m_s: f64,
    /// Largest commanded speed of either motor.
    pub speed_max_m_s: f64,
    /// Deceleration of a controlled stop, for each motor.
    pub deceleration_m_s2: f64,
    /// Largest plausible difference between feedback and command.
    pub plausible_difference_m_s: f64,
    /// Time for the drives to reach a command. Feedback is compared with the smallest and largest command of this time.
    pub response_time_s: f64,
    /// Longest time with implausible feedback: shorter in proportion where it is further off, five times as long for
    /// motors that turn the right way, but more slowly.
    pub implausible_time_s: f64,
}

impl Default for SafetyConfig {
    fn default() -> Self {
        Self {
            command_timeout_s: 0.15,
            feedback_timeout_s: 0.2,
            transmit_timeout_s: 0.15,
            zeroing_time_s: 0.2,
            handshake_timeout_s: 1.0,
            standstill_m_s: 0.02,
            speed_max_m_s: 1.0,
            deceleration_m_s2: 2.0,
            plausible_difference_m_s: 0.1,
            response_time_s: 0.5,
            implausible_time_s: 0.3,
        }
    }
}

impl SafetyConfig {
    /// Checks every range.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        for (key, value, bounds) in [
            (
                "safety.command_timeout_s",
                self.command_timeout_s,
                Bounds::new(0.01, 1.0, "s"),
            ),
            (
                "safety.feedback_timeout_s",
                self.feedback_timeout_s,
                Bounds::new(0.01, 1.0, "s"),
            ),
            (
                "safety.transmit_timeout_s",
                self.transmit_timeout_s,
                Bounds::new(0.01, 1.0, "s"),
            ),
            (
                "safety.zeroing_time_s",
                self.zeroing_time_s,
                Bounds::new(0.05, 10.0, "s"),
            ),
            (
                "safety.handshake_timeout_s",
                self.handshake_timeout_s,
                Bounds::new(0.1, 10.0, "s"),
            ),
            (
                "safety.standstill_m_s",
                self.standstill_m_s,
                Bounds::new(0.001, 0.2, "m/s"),
            ),
            (
                "safety.speed_max_m_s",
                self.speed_max_m_s,
                Bounds::new(0.01, 20.0, "m/s"),
            ),
            (
                "safety.deceleration_m_s2",
                self.deceleration_m_s2,
                Bounds::new(0.1, 20.0, "m/s^2"),
            ),
            (
                "safety.plausible_difference_m_s",
                self.plausible_difference_m_s,
                Bounds::new(0.01, 5.0, "m/s"),
            ),
            (
                "safety.response_time_s",
                self.response_time_s,
                Bounds::new(0.0, 1.0, "s"),
            ),
            (
                "safety.implausible_time_s",
                self.implausible_time_s,
                Bounds::new(0.0, 5.0, "s"),
            ),
        ] {
            bounds.check(key, value)?;
        }
        Ok(())
    }
}
