use super::channel::LoopEnd;
use super::cycle::ControlLoop;
use super::record::{CycleRow, LoopRecord};
use super::runner::ControllerRunner;
use crate::drives::Port;
use crate::safety::{OperatorRequests, Reason, SafetyState, StopCause};
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

/// Cycles that send zero and disable after the end was decided, before the loop returns.
const FINAL_CYCLES: u32 = 5;

/// How a run of the control loop ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum RunEnding {
    /// The course was followed to its end.
    Finished,
    /// The time of the run was over while the vehicle was driving.
    TimeOver,
    /// The time of the run was over while the vehicle was not driving.
    #[serde(rename = "stopped")]
    TimeOverStopped,
    /// A signal ended the program before the course was finished.
    #[serde(rename = "signal")]
    Interrupted,
    /// A signal ended a loop that takes its paths through a command channel. Nothing else ends it.
    #[serde(rename = "signal")]
    ShutDown,
    /// The process was suspended and resumed; the middleware of ROS 2 does not survive that.
    Suspended,
}

impl RunEnding {
    /// Returns the cause that the safety reports for halting the drives at this end.
    fn cause(self) -> StopCause {
        match self {
            Self::Finished | Self::Interrupted | Self::ShutDown => StopCause::ProgramEnds,
            Self::TimeOver | Self::TimeOverStopped => StopCause::TimeOver,
            Self::Suspended => StopCause::Suspended,
        }
    }
}

/// Options of a run.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RunOptions {
    /// Arms once, as soon as the drives' feedback is fresh, within [`RunOptions::ARM_WITHIN_S`] of the first cycle.
    pub arm: bool,
    /// Ends the run at this time, s.
    pub duration_s: Option<f64>,
}

impl RunOptions {
    /// Time within which the run arms by itself, s. After that the request has expired: drives that are switched on
    /// later do not set the vehicle off.
    pub const ARM_WITHIN_S: f64 = 5.0;
}

/// What the loop shares with signal handlers and other threads: requests, and a sign of life. Clones share the same values.
#[derive(Debug, Clone, Default)]
pub struct Signals {
    /// Ends the run.
    pub end: Arc<AtomicBool>,
    /// Arms once.
    pub arm: Arc<AtomicBool>,
    /// Stops on the ramp, once.
    pub stop: Arc<AtomicBool>,
    /// The process was suspended and has been resumed.
    pub resumed: Arc<AtomicBool>,
    /// Turns of the loop so far: cycles, and waits for a clock that stands. It grows while the loop is alive.
    pub turns: Arc<AtomicU64>,
}

impl Signals {
    /// Gives a sign of life.
    pub(super) fn turn(&self) {
        self.turns.fetch_add(1, Ordering::Relaxed);
    }
}

impl<P: Port, R: ControllerRunner> ControlLoop<P, R> {
    /// Runs cycles until the run ends, then a few more that send zero and disable.
    ///
    /// Where paths come through `channel`, requests from there are obeyed as well, and the end of a
    /// path does not end the run.
    pub fn run(
        &mut self,
        options: &RunOptions,
        signals: &Signals,
        mut channel: Option<LoopEnd>,
    ) -> RunEnding {
        let mut arm_pending = options.arm;
        let mut arm_until_s = f64::INFINITY;
        let mut requests = OperatorRequests::default();
        let ending = loop {
            while self.clock_stands() && !signals.end.load(Ordering::Relaxed) {
                signals.turn();
            }
            signals.turn();
            let row = self.step_with(requests, channel.as_mut());
            if let Some(ending) = self.ending(&row, options, signals, channel.is_some()) {
                break ending;
            }
            arm_until_s = arm_until_s.min(row.time_s + RunOptions::ARM_WITHIN_S);
            if arm_pending && row.time_s > arm_until_s {
                arm_pending = false;
                let time_s = row.time_s;
                self.record(LoopRecord::ArmingExpired {
                    time_s,
                    within_s: RunOptions::ARM_WITHIN_S,
                });
            }
            let arm_now = arm_pending && self.can_arm(&row);
            arm_pending &= !arm_now;
            let stop = signals.stop.swap(false, Ordering::Relaxed);
            requests = OperatorRequests {
                arm: signals.arm.swap(false, Ordering::Relaxed) || arm_now,
                stop: stop.then_some(StopCause::Operator),
                halt: None,
            };
        };
        requests = OperatorRequests {
            halt: Some(ending.cause()),
            ..OperatorRequests::default()
        };
        for _ in 0..FINAL_CYCLES {
            self.step_with(requests, channel.as_mut());
        }
        ending
    }

    /// Runs one cycle with the local requests and those from the channel.
    pub fn step_with(
        &mut self,
        requests: OperatorRequests,
        channel: Option<&mut LoopEnd>,
    ) -> CycleRow {
        let Some(channel) = channel else {
            return self.step(requests);
        };
        let row = self.step(channel.merge(requests, self.state()));
        channel.publish(row, self.stopped_by(), self.timing());
        row
    }

    /// Returns whether a handshake that begins now finds a link that carries and fresh feedback.
    fn can_arm(&self, row: &CycleRow) -> bool {
        row.bus.carries() && row.feedback_age_s <= self.safety_config().feedback_timeout_s
    }

    /// Returns how the run ends now, where it does. Where several reasons coincide, the one that says
    /// most about the course comes first.
    fn ending(
        &self,
        row: &CycleRow,
        options: &RunOptions,
        signals: &Signals,
        has_channel: bool,
    ) -> Option<RunEnding> {
        let finished = row.state == SafetyState::Latched
            && self.stopped_by() == Some(Reason::Finished)
            && !has_channel;
        if finished {
            return Some(RunEnding::Finished);
        }
        if options
            .duration_s
            .is_some_and(|duration_s| row.time_s >= duration_s)
        {
            return Some(match row.state {
                SafetyState::Driving => RunEnding::TimeOver,
                _ => RunEnding::TimeOverStopped,
            });
        }
        // Whoever ends a program may resume it as well, as systemd does with SIGTERM and SIGCONT.
        if signals.end.load(Ordering::Relaxed) {
            return Some(if has_channel {
                RunEnding::ShutDown
            } else {
                RunEnding::Interrupted
            });
        }
        let resumed = has_channel && signals.resumed.load(Ordering::Relaxed);
        resumed.then_some(RunEnding::Suspended)
    }
}
