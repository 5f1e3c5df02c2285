//! When the vehicle may move: a state machine between the controller and the drives.
//!
//! ```text
//! Disarmed -> Zeroing -> Enabling -> Driving -> Stopping -> Latched -> (re-armed) Zeroing
//! ```
//!
//! Only Driving passes commands on. Every doubt leads to Latched, through a ramp where the drives
//! can be expected to follow one and at once where they cannot; only an operator leads out of it.
//! Time is an argument; there is no clock, no bus and no thread in here.

mod config;
mod recent;
mod vocabulary;

pub use config::SafetyConfig;
pub use vocabulary::{
    ControllerOutput, ControllerState, OperatorRequests, Reason, SafetyInputs, SafetyState,
    StopCause, Transition,
};

use crate::drives::{DriveCommand, DriveFeedback, DriveMode};
use recent::RecentCommands;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::RangeError;

/// How an alarm ends the drive.
enum Alarm {
    /// On the ramp: the drives can be expected to follow.
    Ramp(Reason),
    /// At once.
    Cut(Reason),
}

impl Alarm {
    fn reason(self) -> Reason {
        match self {
            Self::Ramp(reason) | Self::Cut(reason) => reason,
        }
    }
}

/// The state machine.
#[derive(Debug, Clone)]
pub struct Safety {
    config: SafetyConfig,
    state: SafetyState,
    since_s: f64,
    last_s: Option<f64>,
    armed_before: bool,
    order: DriveCommand,
    recent: RecentCommands,
    /// Whether the controller has driven since the drives were switched on.
    following: bool,
    implausible_since_s: Option<f64>,
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
            // An arm level that stands from the start must fall first.
            armed_before: true,
            order: DriveCommand::OFF,
            recent: RecentCommands::new(),
            following: false,
            implausible_since_s: None,
        })
    }

    /// Returns the state.
    pub fn state(&self) -> SafetyState {
        self.state
    }

    /// Returns what the drives are told now and, where the state changed, why.
    ///
    /// At most one transition a step. Total: there is an order for every observation.
    pub fn step(&mut self, seen: &SafetyInputs) -> (DriveCommand, Option<Transition>) {
        let armed = seen.operator.arm && !self.armed_before;
        self.armed_before = seen.operator.arm;
        let before_s = self.last_s.unwrap_or(seen.time_s);
        let elapsed_s = seen.time_s - before_s;
        // Written so that a NaN alarms.
        let clock = if elapsed_s >= 0.0 && elapsed_s.is_finite() {
            self.last_s = Some(seen.time_s);
            None
        } else {
            if seen.time_s.is_finite() {
                self.last_s = Some(seen.time_s);
            }
            Some(Reason::Clock {
                before_s,
                now_s: seen.time_s,
            })
        };
        let elapsed_s = if clock.is_some() { 0.0 } else { elapsed_s };
        let next = self.next(seen, armed, clock);
        let transition = next.map(|(to, reason)| {
            let from = self.state;
            self.state = to;
            self.since_s = seen.time_s;
            if to == SafetyState::Enabling {
                self.recent.clear();
                self.following = false;
                self.implausible_since_s = None;
            }
            Transition {
                time_s: seen.time_s,
                from,
                to,
                reason,
            }
        });
        self.order = self.order_in_state(seen, elapsed_s);
        self.recent.push(seen.time_s, self.order.speeds);
        (self.order, transition)
    }

    fn next(
        &mut self,
        seen: &SafetyInputs,
        armed: bool,
        clock: Option<Reason>,
    ) -> Option<(SafetyState, Reason)> {
        match self.state {
            SafetyState::Disarmed | SafetyState::Latched => {
                let halted = seen.operator.halt.or(seen.operator.stop).is_some();
                (armed && !halted).then_some((SafetyState::Zeroing, Reason::Armed))
            }
            SafetyState::Zeroing => {
                let alarm = || self.alarm(seen).map(Alarm::reason);
                if let Some(reason) = clock.or_else(alarm) {
                    return Some((SafetyState::Latched, reason));
                }
                let feedback = seen.feedback?.value;
                let time_s = seen.time_s - self.since_s;
                let off = feedback.mode == DriveMode::Disabled && self.stands(&feedback);
                if off && time_s >= self.config.zeroing_time_s {
                    return Some((SafetyState::Enabling, Reason::Standing));
                }
                self.handshake_late(time_s, self.config.zeroing_time_s, feedback.mode)
            }
            SafetyState::Enabling => {
                let alarm = || self.alarm(seen).map(Alarm::reason);
                if let Some(reason) = clock.or_else(alarm) {
                    return Some((SafetyState::Latched, reason));
                }
                let feedback = seen.feedback?.value;
                if feedback.mode == DriveMode::Enabled {
                    return Some((SafetyState::Driving, Reason::Enabled));
                }
                self.handshake_late(seen.time_s - self.since_s, 0.0, feedback.mode)
            }
            SafetyState::Driving => {
                let ramp = |reason| Some((SafetyState::Stopping, reason));
                match self.alarm(seen) {
                    Some(Alarm::Cut(reason)) => return Some((SafetyState::Latched, reason)),
                    Some(Alarm::Ramp(reason)) => return ramp(reason),
                    None => {}
                }
                clock
                    .or_else(|| self.intent_alarm(seen))
                    .or_else(|| self.implausible(seen))
                    .and_then(ramp)
            }
            SafetyState::Stopping => {
                if let Some(Alarm::Cut(reason)) = self.alarm(seen) {
                    return Some((SafetyState::Latched, reason));
                }
                (self.order.speeds == MotorSpeeds::STOP)
                    .then_some((SafetyState::Latched, Reason::RampEnded))
            }
        }
    }

    /// What forbids to drive whatever the controller says.
    fn alarm(&self, seen: &SafetyInputs) -> Option<Alarm> {
        if let Some(cause) = seen.operator.halt {
            return Some(Alarm::Cut(Reason::Requested(cause)));
        }
        let age_s = seen
            .feedback
            .map_or(f64::INFINITY, |feedback| seen.time_s - feedback.time_s);
        let stale = !(..=self.config.feedback_timeout_s).contains(&age_s);
        if let (Some(feedback), false) = (seen.feedback, stale) {
            let on = matches!(self.state, SafetyState::Driving | SafetyState::Stopping);
            match feedback.value.mode {
                DriveMode::EmergencyStop => return Some(Alarm::Cut(Reason::EmergencyStop)),
                // While zeros are sent, off, a drive may forget its fault.
                DriveMode::Fault if self.state == SafetyState::Zeroing => {}
                DriveMode::Fault => return Some(Alarm::Cut(Reason::DriveFault)),
                DriveMode::Disabled if on => return Some(Alarm::Cut(Reason::DriveOff)),
                DriveMode::Disabled | DriveMode::Enabled => {}
            }
        }
        if !seen.link.carries() {
            return Some(Alarm::Ramp(Reason::Link { state: seen.link }));
        }
        if let Some(since_s) = seen.unsent_since_s {
            let time_s = seen.time_s - since_s;
            if !(..=self.config.transmit_timeout_s).contains(&time_s) {
                return Some(Alarm::Ramp(Reason::TransmitTimeout { time_s }));
            }
        }
        if stale {
            return Some(Alarm::Ramp(Reason::FeedbackTimeout { age_s }));
        }
        seen.operator
            .stop
            .map(|cause| Alarm::Ramp(Reason::Requested(cause)))
    }

    /// What forbids to drive because of the controller. Its first plan takes longer than those
    /// after it: until it follows, the vehicle stands, and there is the time of a handshake.
    fn intent_alarm(&mut self, seen: &SafetyInputs) -> Option<Reason> {
        let intent = self.current_intent(seen);
        let age_s = seen.time_s - intent.map_or(self.since_s, |intent| intent.time_s);
        let fresh = (..=self.config.command_timeout_s).contains(&age_s);
        if !self.following {
            self.following =
                fresh && intent.is_some_and(|intent| intent.pilot != ControllerState::Waiting);
            let age_s = seen.time_s - self.since_s;
            if !self.following {
                let late = !(..=self.config.handshake_timeout_s).contains(&age_s);
                return late.then_some(Reason::CommandTimeout { age_s });
            }
        }
        if !fresh {
            return Some(Reason::CommandTimeout { age_s });
        }
        let intent = intent?;
        match intent.pilot {
            ControllerState::Finished => Some(Reason::Finished),
            ControllerState::Stopped(why) => Some(Reason::ControllerStopped { why }),
            ControllerState::Driving if !intent.command.is_finite() => {
                Some(Reason::CommandNotFinite)
            }
            ControllerState::Driving | ControllerState::Waiting => None,
        }
    }

    /// The intent, where it was made since the drive began and is not from the future.
    fn current_intent(&self, seen: &SafetyInputs) -> Option<ControllerOutput> {
        seen.intent
            .filter(|intent| intent.time_s > self.since_s && intent.time_s <= seen.time_s)
    }

    fn implausible(&mut self, seen: &SafetyInputs) -> Option<Reason> {
        let speeds = seen.feedback?.value.speeds;
        let [traction, steer] = self.recent.range(seen.time_s - self.config.response_time_s);
        let (traction_m_s, steer_m_s) = (
            outside(traction, speeds.traction_m_s),
            outside(steer, speeds.steer_m_s),
        );
        let limit = self.config.plausible_difference_m_s;
        if traction_m_s <= limit && steer_m_s <= limit {
            self.implausible_since_s = None;
            return None;
        }
        let since_s = *self.implausible_since_s.get_or_insert(seen.time_s);
        let time_s = seen.time_s - since_s;
        (time_s >= self.config.implausible_time_s).then_some(Reason::Implausible {
            traction_m_s,
            steer_m_s,
            time_s,
        })
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

    fn order_in_state(&self, seen: &SafetyInputs, elapsed_s: f64) -> DriveCommand {
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
                    .current_intent(seen)
                    .filter(|_| self.following)
                    .map(|intent| intent.command)
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
                        traction_m_s: toward_zero(self.order.speeds.traction_m_s, step),
                        steer_m_s: toward_zero(self.order.speeds.steer_m_s, step),
                    },
                    enable: true,
                    fault_reset: false,
                }
            }
        }
    }
}

fn toward_zero(speed_m_s: f64, step_m_s: f64) -> f64 {
    // Adding 0 makes a negative zero positive.
    (speed_m_s.abs() - step_m_s).max(0.0).copysign(speed_m_s) + 0.0
}

/// Distance of a value from a range; NaN counts as far away.
fn outside([low, high]: [f64; 2], value: f64) -> f64 {
    if value.is_nan() {
        return f64::INFINITY;
    }
    (low - value).max(value - high).max(0.0)
}

#[cfg(test)]
mod tests;
