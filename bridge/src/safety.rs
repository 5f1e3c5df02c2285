//! When the vehicle may move: a state machine between the controller and the drives.
//!
//! ```text
//! Disarmed -> Zeroing -> Enabling -> Driving -> Stopping -> Latched -> (re-armed) Zeroing
//! ```
//!
//! Only Driving passes commands on. Every doubt leads to Latched, through a ramp where the drives
//! can be expected to follow one and at once where they cannot; only an operator leads out of it.
//! Time is an argument; there is no clock, no bus and no thread in here.

use crate::can::layout::DriveMode;
use serde::{Deserialize, Serialize};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MotorSpeeds;
use sidehill_plant::vehicle::RangeError;

/// Limits of the state machine.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SafetyConfig {
    /// Largest age of a command that is still driven on, s.
    pub command_timeout_s: f64,
    /// Largest age of the drives' feedback, s.
    pub feedback_timeout_s: f64,
    /// Longest time for which no frame can be sent, s.
    pub transmit_timeout_s: f64,
    /// Time for which zeros are sent, disabled, before the drives are switched on, s.
    pub zeroing_time_s: f64,
    /// Longest time for each part of the handshake, the controller's first command included, s.
    pub handshake_timeout_s: f64,
    /// Speed below which a motor stands, m/s.
    pub standstill_m_s: f64,
    /// Largest commanded speed of either motor, m/s.
    pub speed_max_m_s: f64,
    /// Deceleration of a controlled stop, for each motor, m/s^2.
    pub deceleration_m_s2: f64,
    /// Difference between feedback and command that is plausible, m/s.
    pub plausible_difference_m_s: f64,
    /// Time within which the drives reach a command: feedback is compared with the least and the
    /// greatest command of this time, s.
    pub response_time_s: f64,
    /// Time for which feedback may be implausible, s.
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
        for (key, value, low, high, range) in [
            (
                "safety.command_timeout_s",
                self.command_timeout_s,
                0.01,
                1.0,
                "from 0.01 to 1 s",
            ),
            (
                "safety.feedback_timeout_s",
                self.feedback_timeout_s,
                0.01,
                1.0,
                "from 0.01 to 1 s",
            ),
            (
                "safety.transmit_timeout_s",
                self.transmit_timeout_s,
                0.01,
                1.0,
                "from 0.01 to 1 s",
            ),
            (
                "safety.zeroing_time_s",
                self.zeroing_time_s,
                0.05,
                10.0,
                "from 0.05 to 10 s",
            ),
            (
                "safety.handshake_timeout_s",
                self.handshake_timeout_s,
                0.1,
                10.0,
                "from 0.1 to 10 s",
            ),
            (
                "safety.standstill_m_s",
                self.standstill_m_s,
                0.001,
                0.2,
                "from 0.001 to 0.2 m/s",
            ),
            (
                "safety.speed_max_m_s",
                self.speed_max_m_s,
                0.01,
                20.0,
                "from 0.01 to 20 m/s",
            ),
            (
                "safety.deceleration_m_s2",
                self.deceleration_m_s2,
                0.1,
                20.0,
                "from 0.1 to 20 m/s^2",
            ),
            (
                "safety.plausible_difference_m_s",
                self.plausible_difference_m_s,
                0.01,
                5.0,
                "from 0.01 to 5 m/s",
            ),
            (
                "safety.response_time_s",
                self.response_time_s,
                0.0,
                1.0,
                "from 0 to 1 s",
            ),
            (
                "safety.implausible_time_s",
                self.implausible_time_s,
                0.0,
                5.0,
                "from 0 to 5 s",
            ),
        ] {
            RangeError::check(key, value, low, high, range)?;
        }
        Ok(())
    }
}

/// What the controller says in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Intent {
    /// Cycle for which it was decided, s.
    pub time_s: f64,
    /// Speeds it wants.
    pub command: MotorSpeeds,
    /// Whether it can drive.
    pub pilot: PilotState,
}

/// Whether the controller can drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum PilotState {
    /// It waits for its first readings.
    Waiting,
    /// It drives.
    Driving,
    /// It stops the vehicle.
    Stopped,
    /// It has followed its reference to the end.
    Finished,
}

/// What both drives say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DriveFeedback {
    /// Effective speeds reached.
    pub speeds: MotorSpeeds,
    /// State; the worse of the two drives'.
    pub mode: DriveMode,
}

/// State of the bus as far as the port knows it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BusState {
    /// In order.
    #[default]
    Active,
    /// Many errors.
    Warning,
    /// Too many errors: the node only listens for them.
    Passive,
    /// The node has left the bus.
    BusOff,
    /// The interface is down.
    Down,
    /// There is no interface.
    Absent,
}

impl BusState {
    /// Returns whether frames may get through.
    pub fn carries(self) -> bool {
        matches!(self, Self::Active | Self::Warning | Self::Passive)
    }
}

/// What an operator asks for; each is a level, and arming acts where it rises.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Operator {
    /// Drive.
    pub arm: bool,
    /// Stop on the ramp.
    pub stop: bool,
    /// Zero and disable at once: an emergency stop, or the program ends.
    pub halt: bool,
}

/// Everything the state machine looks at in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Observation {
    /// Instant, s.
    pub time_s: f64,
    /// Newest intent of the controller.
    pub intent: Option<Intent>,
    /// Newest feedback of both drives, with the instant of the older half.
    pub feedback: Option<Stamped<DriveFeedback>>,
    /// State of the bus.
    pub bus: BusState,
    /// Since when nothing could be sent, s; none where the last frame went out.
    pub unsent_since_s: Option<f64>,
    /// The operator.
    pub operator: Operator,
}

/// What the drives are told.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Order {
    /// Effective speeds.
    pub speeds: MotorSpeeds,
    /// Whether the drives shall be on.
    pub enable: bool,
}

impl Order {
    /// Zero, and off.
    pub const OFF: Self = Self {
        speeds: MotorSpeeds::STOP,
        enable: false,
    };
}

/// Where the state machine is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum State {
    /// Off since the start; waits for an operator.
    Disarmed,
    /// Sends zeros, off, until the drives say that they stand and are off.
    Zeroing,
    /// Sends zeros, on, until the drives say that they are on.
    Enabling,
    /// Passes commands on.
    Driving,
    /// Leads the speeds to zero.
    Stopping,
    /// Off until an operator re-arms.
    Latched,
}

/// Why a state changed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum Reason {
    /// An operator armed.
    #[error("armed by the operator")]
    Armed,
    /// Zeros were sent for long enough and the drives stand, off.
    #[error("the drives stand and are off")]
    Standing,
    /// The drives say that they are on.
    #[error("the drives are on")]
    Enabled,
    /// The ramp has ended.
    #[error("the ramp has ended")]
    RampEnded,
    /// An operator asked for a stop.
    #[error("a stop was asked for")]
    OperatorStop,
    /// An emergency stop or the end of the program.
    #[error("halted by the operator or the end of the program")]
    Halted,
    /// The drives report an emergency stop.
    #[error("the drives report an emergency stop")]
    EmergencyStop,
    /// A drive reports a fault.
    #[error("a drive reports a fault")]
    DriveFault,
    /// A drive has switched itself off.
    #[error("a drive has switched itself off")]
    DriveOff,
    /// The controller's command is too old.
    #[error("the command is {age_s:.3} s old")]
    CommandTimeout {
        /// Its age, s.
        age_s: f64,
    },
    /// The controller's command is not finite.
    #[error("the command is not finite")]
    CommandNotFinite,
    /// The controller stops the vehicle.
    #[error("the controller stops")]
    ControllerStopped,
    /// The controller has followed its reference to the end.
    #[error("the reference has been followed to its end")]
    Finished,
    /// The drives' feedback is too old, or there was none.
    #[error("the feedback is {age_s:.3} s old")]
    FeedbackTimeout {
        /// Its age, s; infinite where there was none.
        age_s: f64,
    },
    /// Feedback is not what was commanded.
    #[error(
        "traction differs by {traction_m_s:.3} m/s and steer by {steer_m_s:.3} m/s from the command for {time_s:.2} s"
    )]
    Implausible {
        /// Traction beyond the commands, m/s.
        traction_m_s: f64,
        /// Steer beyond the commands, m/s.
        steer_m_s: f64,
        /// For how long, s.
        time_s: f64,
    },
    /// The bus carries nothing.
    #[error("the bus is {state:?}")]
    Bus {
        /// Its state.
        state: BusState,
    },
    /// Nothing could be sent.
    #[error("nothing could be sent for {time_s:.3} s")]
    TransmitTimeout {
        /// For how long, s.
        time_s: f64,
    },
    /// The drives did not answer the handshake.
    #[error("the drives did not follow within {time_s:.2} s, they are {mode:?}")]
    Handshake {
        /// For how long was waited, s.
        time_s: f64,
        /// What the drives said last.
        mode: DriveMode,
    },
    /// Time went back or is no number.
    #[error("the time went from {before_s} s to {now_s} s")]
    Clock {
        /// Of the step before, s.
        before_s: f64,
        /// Of this step, s.
        now_s: f64,
    },
}

/// A change of state.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Transition {
    /// When, s.
    pub time_s: f64,
    /// From.
    pub from: State,
    /// To.
    pub to: State,
    /// Why.
    pub reason: Reason,
}

/// How an alarm ends the drive.
enum Alarm {
    /// On the ramp: the drives can be expected to follow.
    Ramp(Reason),
    /// At once.
    Cut(Reason),
}

/// The state machine.
#[derive(Debug, Clone)]
pub struct Safety {
    config: SafetyConfig,
    state: State,
    since_s: f64,
    last_s: Option<f64>,
    armed_before: bool,
    order: Order,
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
            state: State::Disarmed,
            since_s: 0.0,
            last_s: None,
            // An arm level that stands from the start must fall first.
            armed_before: true,
            order: Order::OFF,
            recent: RecentCommands::new(),
            following: false,
            implausible_since_s: None,
        })
    }

    /// Returns the state.
    pub fn state(&self) -> State {
        self.state
    }

    /// Returns what the drives are told now and, where the state changed, why.
    ///
    /// At most one transition a step. Total: there is an order for every observation.
    pub fn step(&mut self, seen: &Observation) -> (Order, Option<Transition>) {
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
            if to == State::Enabling {
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
        seen: &Observation,
        armed: bool,
        clock: Option<Reason>,
    ) -> Option<(State, Reason)> {
        match self.state {
            State::Disarmed | State::Latched => {
                let halted = seen.operator.halt || seen.operator.stop;
                (armed && !halted).then_some((State::Zeroing, Reason::Armed))
            }
            State::Zeroing => {
                if let Some(reason) = clock {
                    return Some((State::Latched, reason));
                }
                let alarm = self.alarm(seen);
                if let Some(Alarm::Ramp(reason) | Alarm::Cut(reason)) = alarm {
                    return Some((State::Latched, reason));
                }
                let feedback = seen.feedback?.value;
                let time_s = seen.time_s - self.since_s;
                let off = feedback.mode == DriveMode::Disabled && self.stands(&feedback);
                if off && time_s >= self.config.zeroing_time_s {
                    return Some((State::Enabling, Reason::Standing));
                }
                self.handshake_late(time_s, self.config.zeroing_time_s, feedback.mode)
            }
            State::Enabling => {
                if let Some(reason) = clock {
                    return Some((State::Latched, reason));
                }
                let alarm = self.alarm(seen);
                if let Some(Alarm::Ramp(reason) | Alarm::Cut(reason)) = alarm {
                    return Some((State::Latched, reason));
                }
                let feedback = seen.feedback?.value;
                if feedback.mode == DriveMode::Enabled {
                    return Some((State::Driving, Reason::Enabled));
                }
                self.handshake_late(seen.time_s - self.since_s, 0.0, feedback.mode)
            }
            State::Driving => {
                let ramp = |reason| Some((State::Stopping, reason));
                match self.alarm(seen) {
                    Some(Alarm::Cut(reason)) => return Some((State::Latched, reason)),
                    Some(Alarm::Ramp(reason)) => return ramp(reason),
                    None => {}
                }
                clock
                    .or_else(|| self.intent_alarm(seen))
                    .or_else(|| self.implausible(seen))
                    .and_then(ramp)
            }
            State::Stopping => {
                if let Some(Alarm::Cut(reason)) = self.alarm(seen) {
                    return Some((State::Latched, reason));
                }
                (self.order.speeds == MotorSpeeds::STOP)
                    .then_some((State::Latched, Reason::RampEnded))
            }
        }
    }

    /// What forbids to drive whatever the controller says.
    fn alarm(&self, seen: &Observation) -> Option<Alarm> {
        if seen.operator.halt {
            return Some(Alarm::Cut(Reason::Halted));
        }
        let age_s = seen
            .feedback
            .map_or(f64::INFINITY, |feedback| seen.time_s - feedback.time_s);
        let stale = !(..=self.config.feedback_timeout_s).contains(&age_s);
        if let (Some(feedback), false) = (seen.feedback, stale) {
            let on = matches!(self.state, State::Driving | State::Stopping);
            match feedback.value.mode {
                DriveMode::EmergencyStop => return Some(Alarm::Cut(Reason::EmergencyStop)),
                DriveMode::Fault => return Some(Alarm::Cut(Reason::DriveFault)),
                DriveMode::Disabled if on => return Some(Alarm::Cut(Reason::DriveOff)),
                DriveMode::Disabled | DriveMode::Enabled => {}
            }
        }
        if !seen.bus.carries() {
            return Some(Alarm::Ramp(Reason::Bus { state: seen.bus }));
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
            .then_some(Alarm::Ramp(Reason::OperatorStop))
    }

    /// What forbids to drive because of the controller. Its first plan takes longer than those
    /// after it: until it follows, the vehicle stands, and there is the time of a handshake.
    fn intent_alarm(&mut self, seen: &Observation) -> Option<Reason> {
        let intent = self.current_intent(seen);
        let age_s = seen.time_s - intent.map_or(self.since_s, |intent| intent.time_s);
        let fresh = (..=self.config.command_timeout_s).contains(&age_s);
        if !self.following {
            self.following =
                fresh && intent.is_some_and(|intent| intent.pilot != PilotState::Waiting);
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
            PilotState::Finished => Some(Reason::Finished),
            PilotState::Stopped => Some(Reason::ControllerStopped),
            PilotState::Driving if !intent.command.is_finite() => Some(Reason::CommandNotFinite),
            PilotState::Driving | PilotState::Waiting => None,
        }
    }

    /// The intent, where it was made since the drive began and is not from the future.
    fn current_intent(&self, seen: &Observation) -> Option<Intent> {
        seen.intent
            .filter(|intent| intent.time_s > self.since_s && intent.time_s <= seen.time_s)
    }

    fn implausible(&mut self, seen: &Observation) -> Option<Reason> {
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
    ) -> Option<(State, Reason)> {
        (time_s > after_s + self.config.handshake_timeout_s)
            .then_some((State::Latched, Reason::Handshake { time_s, mode }))
    }

    fn order_in_state(&self, seen: &Observation, elapsed_s: f64) -> Order {
        match self.state {
            State::Disarmed | State::Zeroing | State::Latched => Order::OFF,
            State::Enabling => Order {
                speeds: MotorSpeeds::STOP,
                enable: true,
            },
            State::Driving => {
                let limit = self.config.speed_max_m_s;
                let speeds = self
                    .current_intent(seen)
                    .filter(|_| self.following)
                    .map(|intent| intent.command)
                    .filter(MotorSpeeds::is_finite)
                    .unwrap_or(MotorSpeeds::STOP);
                Order {
                    speeds: MotorSpeeds {
                        traction_m_s: speeds.traction_m_s.clamp(-limit, limit),
                        steer_m_s: speeds.steer_m_s.clamp(-limit, limit),
                    },
                    enable: true,
                }
            }
            State::Stopping => {
                let step = self.config.deceleration_m_s2 * elapsed_s;
                Order {
                    speeds: MotorSpeeds {
                        traction_m_s: toward_zero(self.order.speeds.traction_m_s, step),
                        steer_m_s: toward_zero(self.order.speeds.steer_m_s, step),
                    },
                    enable: true,
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

/// The commands of the last second at up to 100 Hz, without allocation.
#[derive(Debug, Clone)]
struct RecentCommands {
    entries: [(f64, MotorSpeeds); Self::LENGTH],
    next: usize,
}

impl RecentCommands {
    const LENGTH: usize = 128;

    fn new() -> Self {
        Self {
            entries: [(f64::NEG_INFINITY, MotorSpeeds::STOP); Self::LENGTH],
            next: 0,
        }
    }

    fn clear(&mut self) {
        *self = Self::new();
    }

    fn push(&mut self, time_s: f64, speeds: MotorSpeeds) {
        self.entries[self.next] = (time_s, speeds);
        self.next = (self.next + 1) % Self::LENGTH;
    }

    /// Least and greatest traction and steer since an instant, and of the command that was in force
    /// then.
    fn range(&self, since_s: f64) -> [[f64; 2]; 2] {
        let mut range = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for i in 1..=Self::LENGTH {
            let (time_s, speeds) = self.entries[(self.next + Self::LENGTH - i) % Self::LENGTH];
            for (range, value) in range
                .iter_mut()
                .zip([speeds.traction_m_s, speeds.steer_m_s])
            {
                *range = [range[0].min(value), range[1].max(value)];
            }
            if time_s < since_s {
                break;
            }
        }
        range
    }
}

#[cfg(test)]
mod tests;
