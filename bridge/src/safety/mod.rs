//! When the vehicle may move: a state machine between the controller and the drives.
//!
//! ```text
//! Disarmed -> Zeroing -> Enabling -> Driving -> Stopping -> Latched -> (re-armed) Zeroing
//! ```
//!
//! Only Driving passes the controller's commands on. Every fault leads to Latched: through Stopping, a
//! ramp to zero, where the drives can be expected to follow, and at once where they cannot. Only an
//! operator's arming leaves Disarmed and Latched. Time is an argument; the module has no clock, no bus
//! and no thread.

mod alarm;
mod checks;
mod config;
mod dead_man;
mod discrepancy;
mod geofence;
mod recent;
mod vocabulary;

pub use config::SafetyConfig;
pub use dead_man::DeadMan;
pub use geofence::{Geofence, GeofenceError};
pub use vocabulary::{
    ControllerOutput, ControllerState, OperatorRequests, Reason, SafetyInputs, SafetyState,
    StopCause, Transition,
};

use crate::drives::{DriveCommand, DriveFeedback, DriveMode};
use alarm::Alarm;
use discrepancy::Discrepancy;
use recent::RecentCommands;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::RangeError;

/// The state machine.
#[derive(Debug, Clone)]
pub struct Safety {
    config: SafetyConfig,
    state: SafetyState,
    since_s: f64,
    last_s: Option<f64>,
    armed_before: bool,
    command: DriveCommand,
    /// Speeds that the drives should have reached.
    recent: RecentCommands,
    /// Speeds that were commanded.
    commanded: RecentCommands,
    /// Whether the controller has driven since the drives were enabled.
    following: bool,
    implausible: Option<Discrepancy>,
}

impl Safety {
    /// Returns a disarmed state machine.
    ///
    /// # Errors
    /// [`RangeError`] for a setting out of range.
    pub fn new(config: SafetyConfig) -> Result<Self, RangeError> {
        config.validate()?;
        Ok(Self {
            config,
            state: SafetyState::Disarmed,
            since_s: 0.0,
            last_s: None,
            // A request to arm that is there from the start must fall first.
            armed_before: true,
            command: DriveCommand::OFF,
            recent: RecentCommands::new(),
            commanded: RecentCommands::new(),
            following: false,
            implausible: None,
        })
    }

    /// Returns the limits.
    pub fn config(&self) -> &SafetyConfig {
        &self.config
    }

    /// Returns the state.
    pub fn state(&self) -> SafetyState {
        self.state
    }

    /// Returns the command to the drives and, where the state changed, the transition.
    ///
    /// At most one transition a step. Every input has a command.
    pub fn step(&mut self, inputs: &SafetyInputs) -> (DriveCommand, Option<Transition>) {
        let armed = inputs.requests.arm && !self.armed_before;
        self.armed_before = inputs.requests.arm;
        let before_s = self.last_s.unwrap_or(inputs.time_s);
        let elapsed_s = inputs.time_s - before_s;
        // Written so that a NaN alarms.
        let clock = if elapsed_s >= 0.0 && elapsed_s.is_finite() {
            self.last_s = Some(inputs.time_s);
            None
        } else {
            if inputs.time_s.is_finite() {
                self.last_s = Some(inputs.time_s);
            }
            Some(Reason::Clock {
                before_s,
                now_s: inputs.time_s,
            })
        };
        let elapsed_s = if clock.is_some() { 0.0 } else { elapsed_s };
        let next = self.next(inputs, armed, clock);
        let transition = next.map(|(to, reason)| {
            let from = self.state;
            self.state = to;
            self.since_s = inputs.time_s;
            self.recent.clear();
            self.commanded.clear();
            self.following = false;
            self.implausible = None;
            Transition {
                time_s: inputs.time_s,
                from,
                to,
                reason,
            }
        });
        self.command = self.command_in_state(inputs, elapsed_s);
        self.recent
            .push(inputs.time_s, self.expected_speeds(inputs));
        self.commanded.push(inputs.time_s, self.command.speeds);
        (self.command, transition)
    }

    fn next(
        &mut self,
        inputs: &SafetyInputs,
        armed: bool,
        clock: Option<Reason>,
    ) -> Option<(SafetyState, Reason)> {
        match self.state {
            SafetyState::Disarmed | SafetyState::Latched => {
                let halted = inputs.requests.halt.or(inputs.requests.stop).is_some();
                (armed && !halted).then_some((SafetyState::Zeroing, Reason::Armed))
            }
            SafetyState::Zeroing => {
                let alarm = || self.alarm(inputs).map(Alarm::reason);
                if let Some(reason) = clock.or_else(alarm) {
                    return Some((SafetyState::Latched, reason));
                }
                let feedback = inputs.feedback?.value;
                let time_s = inputs.time_s - self.since_s;
                let off = feedback.mode == DriveMode::Disabled && self.stands(&feedback);
                if off && time_s >= self.config.zeroing_time_s {
                    return Some((SafetyState::Enabling, Reason::Standing));
                }
                self.handshake_late(time_s, self.config.zeroing_time_s, feedback.mode)
            }
            SafetyState::Enabling => {
                let alarm = || self.alarm(inputs).map(Alarm::reason);
                if let Some(reason) = clock.or_else(alarm) {
                    return Some((SafetyState::Latched, reason));
                }
                let feedback = inputs.feedback?.value;
                if feedback.mode == DriveMode::Enabled {
                    return Some((SafetyState::Driving, Reason::Enabled));
                }
                self.handshake_late(inputs.time_s - self.since_s, 0.0, feedback.mode)
            }
            SafetyState::Driving => {
                let ramp = |reason| Some((SafetyState::Stopping, reason));
                match self.alarm(inputs) {
                    Some(Alarm::Cut(reason)) => return Some((SafetyState::Latched, reason)),
                    Some(Alarm::Ramp(reason)) => return ramp(reason),
                    None => {}
                }
                clock
                    .or_else(|| self.controller_alarm(inputs))
                    .or_else(|| self.implausible(inputs))
                    .and_then(ramp)
            }
            SafetyState::Stopping => {
                if let Some(Alarm::Cut(reason)) = self.alarm(inputs) {
                    return Some((SafetyState::Latched, reason));
                }
                if let Some(reason) = clock {
                    // Without a clock the ramp would not end.
                    return Some((SafetyState::Latched, reason));
                }
                (self.command.speeds == MotorSpeeds::STOP)
                    .then_some((SafetyState::Latched, Reason::RampEnded))
            }
        }
    }

    fn stands(&self, feedback: &DriveFeedback) -> bool {
        let limit = self.config.standstill_m_s;
        feedback.speeds.traction_m_s.abs() <= limit && feedback.speeds.steer_m_s.abs() <= limit
    }

    fn handshake_late(
        &self,
        time_s: f64,
        after_s: f64,
        mode: DriveMode,
    ) -> Option<(SafetyState, Reason)> {
        (time_s > after_s + self.config.handshake_timeout_s)
            .then_some((SafetyState::Latched, Reason::Handshake { time_s, mode }))
    }

    fn command_in_state(&self, inputs: &SafetyInputs, elapsed_s: f64) -> DriveCommand {
        match self.state {
            SafetyState::Disarmed | SafetyState::Latched => DriveCommand::OFF,
            SafetyState::Zeroing => DriveCommand {
                fault_reset: true,
                ..DriveCommand::OFF
            },
            SafetyState::Enabling => DriveCommand {
                speeds: MotorSpeeds::STOP,
                enable: true,
                fault_reset: false,
            },
            SafetyState::Driving => {
                let limit = self.config.speed_max_m_s;
                let speeds = self
                    .current_output(inputs)
                    .filter(|output| self.following && output.state == ControllerState::Driving)
                    .map(|output| output.command)
                    .filter(MotorSpeeds::is_finite)
                    .unwrap_or(MotorSpeeds::STOP);
                DriveCommand {
                    speeds: MotorSpeeds {
                        traction_m_s: speeds.traction_m_s.clamp(-limit, limit),
                        steer_m_s: speeds.steer_m_s.clamp(-limit, limit),
                    },
                    enable: true,
                    fault_reset: false,
                }
            }
            SafetyState::Stopping => {
                let step = self.config.deceleration_m_s2 * elapsed_s;
                DriveCommand {
                    speeds: MotorSpeeds {
                        traction_m_s: toward_zero(self.command.speeds.traction_m_s, step),
                        steer_m_s: toward_zero(self.command.speeds.steer_m_s, step),
                    },
                    enable: true,
                    fault_reset: false,
                }
            }
        }
    }
}

fn toward_zero(speed_m_s: f64, step_m_s: f64) -> f64 {
    speed_m_s - speed_m_s.clamp(-step_m_s, step_m_s)
}

#[cfg(test)]
mod tests;
