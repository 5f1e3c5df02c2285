use super::Safety;
use super::alarm::Alarm;
use super::discrepancy::Discrepancy;
use super::vocabulary::{ControllerOutput, ControllerState, Reason, SafetyInputs, SafetyState};
use crate::drives::{DriveFeedback, DriveMode, LinkState};
use sidehill_plant::sample::Stamped;
use sidehill_plant::speeds::MotorSpeeds;

/// What forbids driving.
impl Safety {
    /// Returns what forbids driving, regardless of the controller.
    pub(super) fn alarm(&self, inputs: &SafetyInputs) -> Option<Alarm> {
        if let Some(cause) = inputs.requests.halt {
            return Some(Alarm::Cut(Reason::Requested(cause)));
        }
        let age_s = inputs
            .feedback
            .map_or(f64::INFINITY, |feedback| inputs.time_s - feedback.time_s);
        // A report stamped ahead of the clock says nothing of now, and would stay new.
        let limit_s = self.config.feedback_timeout_s;
        let stale = !(-limit_s..=limit_s).contains(&age_s);
        if let Some(feedback) = inputs.feedback {
            let on = matches!(self.state, SafetyState::Driving | SafetyState::Stopping);
            // An emergency stop or a fault holds however old the report is: nothing newer has cleared it.
            match feedback.value.mode {
                DriveMode::EmergencyStop => return Some(Alarm::Cut(Reason::EmergencyStop)),
                // A fault may be reset while zero speed is sent, disabled.
                DriveMode::Fault if self.state == SafetyState::Zeroing => {}
                DriveMode::Fault => return Some(Alarm::Cut(Reason::DriveFault)),
                // It may be set up again while zero speed is sent, disabled.
                DriveMode::NotOperational | DriveMode::OtherMode
                    if self.state == SafetyState::Zeroing => {}
                DriveMode::OtherMode => return Some(Alarm::Cut(Reason::DriveMode)),
                DriveMode::NotOperational => return Some(Alarm::Cut(Reason::DriveNotOperational)),
                DriveMode::Disabled if on && !stale => return Some(Alarm::Cut(Reason::DriveOff)),
                DriveMode::Disabled | DriveMode::Enabled | DriveMode::Frozen => {}
            }
        }
        if inputs.link == LinkState::Foreign {
            // The drives follow somebody else as well: nothing says that they follow a ramp.
            let state = inputs.link;
            return Some(Alarm::Cut(Reason::Link { state }));
        }
        // What ends in a ramp comes after all that switches off at once.
        let frozen = |feedback: Stamped<DriveFeedback>| feedback.value.mode == DriveMode::Frozen;
        if self.state == SafetyState::Driving && inputs.feedback.is_some_and(frozen) {
            return Some(Alarm::Ramp(Reason::FeedbackFrozen));
        }
        if !inputs.link.carries() {
            return Some(Alarm::Ramp(Reason::Link { state: inputs.link }));
        }
        if let Some(since_s) = inputs.unsent_since_s {
            let time_s = inputs.time_s - since_s;
            if !(..=self.config.transmit_timeout_s).contains(&time_s) {
                return Some(Alarm::Ramp(Reason::TransmitTimeout { time_s }));
            }
        }
        if stale {
            return Some(Alarm::Ramp(Reason::FeedbackTimeout { age_s }));
        }
        if inputs.leaves_geofence {
            return Some(Alarm::Ramp(Reason::Geofence));
        }
        inputs
            .requests
            .stop
            .map(|cause| Alarm::Ramp(Reason::Requested(cause)))
    }

    /// Returns what forbids driving because of the controller. Until its first plan the vehicle
    /// stands still, and the controller has the time of a handshake.
    pub(super) fn controller_alarm(&mut self, inputs: &SafetyInputs) -> Option<Reason> {
        let output = self.current_output(inputs);
        let age_s = inputs.time_s - output.map_or(self.since_s, |output| output.time_s);
        let fresh = (..=self.config.command_timeout_s).contains(&age_s);
        if !self.following {
            // One that is nearly too old would leave the next no time to follow it in.
            let prompt = (..=0.5 * self.config.command_timeout_s).contains(&age_s);
            self.following =
                prompt && output.is_some_and(|output| output.state != ControllerState::Waiting);
            let age_s = inputs.time_s - self.since_s;
            if !self.following {
                let late = !(..=self.config.handshake_timeout_s).contains(&age_s);
                return late.then_some(Reason::CommandTimeout { age_s });
            }
        }
        if !fresh {
            return Some(Reason::CommandTimeout { age_s });
        }
        let output = output?;
        match output.state {
            ControllerState::Finished => Some(Reason::Finished),
            ControllerState::Stopped(why) => Some(Reason::ControllerStopped { why }),
            ControllerState::Driving if !output.command.is_finite() => {
                Some(Reason::CommandNotFinite)
            }
            ControllerState::Driving | ControllerState::Waiting => None,
        }
    }

    /// Returns the controller's output if it was decided in this drive and not in the future.
    pub(super) fn current_output(&self, inputs: &SafetyInputs) -> Option<ControllerOutput> {
        inputs
            .controller
            .filter(|output| output.time_s > self.since_s && output.time_s <= inputs.time_s)
    }

    /// Returns the speeds that the drives should reach: those commanded, or what a node on the way to the
    /// drives has made of them.
    ///
    /// Such a node may slow the vehicle down, and no more: what it forwards counts only between zero and the
    /// commands it can have had. One that has been silent for longer than a response is ignored.
    pub(super) fn expected_speeds(&self, inputs: &SafetyInputs) -> MotorSpeeds {
        let command = self.command.speeds;
        let response_s = self.config.response_time_s;
        let forwarded = inputs.forwarded.filter(|forwarded| {
            let age_s = inputs.time_s - forwarded.time_s;
            (..=response_s).contains(&age_s) && forwarded.value.is_finite()
        });
        let Some(forwarded) = forwarded else {
            return command;
        };
        let [traction, steer] = self.commanded.range(inputs.time_s - response_s);
        let within = |[low, high]: [f64; 2], command: f64, value: f64| {
            value.clamp(low.min(command).min(0.0), high.max(command).max(0.0))
        };
        MotorSpeeds {
            traction_m_s: within(traction, command.traction_m_s, forwarded.value.traction_m_s),
            steer_m_s: within(steer, command.steer_m_s, forwarded.value.steer_m_s),
        }
    }

    pub(super) fn implausible(&mut self, inputs: &SafetyInputs) -> Option<Reason> {
        let speeds = inputs.feedback?.value.speeds;
        let [traction, steer] = self
            .recent
            .range(inputs.time_s - self.config.response_time_s);
        let (traction_m_s, steer_m_s) = (
            outside(traction, speeds.traction_m_s),
            outside(steer, speeds.steer_m_s),
        );
        let limit = self.config.plausible_difference_m_s;
        if traction_m_s <= limit && steer_m_s <= limit {
            self.implausible = None;
            return None;
        }
        let feedback_s = inputs.feedback?.time_s;
        let new = Discrepancy::new(inputs.time_s, feedback_s);
        let discrepancy = self.implausible.get_or_insert(new);
        let time_s = discrepancy.grow(inputs.time_s, traction_m_s.max(steer_m_s));
        let mut longest_s = self.config.implausible_time_s;
        let within = |[low, high]: [f64; 2], value: f64| {
            outside([low, high], value) <= limit || is_weak([low, high], value)
        };
        let weak = within(traction, speeds.traction_m_s) && within(steer, speeds.steer_m_s);
        if weak {
            // The controller learns that, and asks for less.
            longest_s *= WEAK_TIMES;
        }
        // Twice as far off is judged in half the time.
        let far = !weak && discrepancy.has_come(limit * longest_s, feedback_s);
        (far || time_s >= longest_s).then_some(Reason::Implausible {
            traction_m_s,
            steer_m_s,
            time_s,
        })
    }
}

/// How much longer a motor may stay below its commands than feedback may be implausible.
const WEAK_TIMES: f64 = 5.0;
/// Share of the least command that a weak motor reaches; one that reaches less is stuck.
const WEAK_SHARE: f64 = 0.3;

/// Returns whether a value below a range of commands is that of a motor that turns the right way, but more slowly.
fn is_weak([low, high]: [f64; 2], value: f64) -> bool {
    let (least, reached) = if low > 0.0 {
        (low, value)
    } else {
        (-high, -value)
    };
    // Empty where the commands have both signs.
    (WEAK_SHARE * least..least).contains(&reached)
}

/// Distance of a value from a range; NaN counts as far away.
fn outside([low, high]: [f64; 2], value: f64) -> f64 {
    if value.is_nan() {
        return f64::INFINITY;
    }
    (low - value).max(value - high).max(0.0)
}
