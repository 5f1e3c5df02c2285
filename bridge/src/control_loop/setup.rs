use super::channel::{ControllerEnd, LoopEnd};
use super::config::CycleConfig;
use super::cycle::ControlLoop;
use super::learned::LearnedOutlet;
use super::record::{LoopRecord, RecordSink};
use super::run::{RunEnding, RunOptions, Signals};
use super::runner::ThreadedRunner;
use super::scheduling::{RealtimeConfig, RealtimeError};
use super::tap::ControllerTap;
use super::timing::LoopTiming;
use crate::drives::{Clock, Port};
use crate::safety::{Geofence, SafetyConfig, SafetyState};
use serde::Serialize;
use sidehill_controller::controller::Controller;
use sidehill_plant::vehicle::RangeError;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::Duration;

/// Everything that a real-time run of the control loop needs.
pub struct LoopSetup {
    /// Period and waits.
    pub cycle: CycleConfig,
    /// Limits of the safety.
    pub safety: SafetyConfig,
    /// Area that the vehicle may not leave.
    pub geofence: Option<Geofence>,
    /// Priorities, CPU and memory lock.
    pub realtime: RealtimeConfig,
    /// The loop's clock: the machine's, or one that is set from outside.
    pub clock: Clock,
    /// The vehicle.
    pub port: Box<dyn Port + Send>,
    /// The controller; it holds until the safety drives.
    pub controller: Controller,
    /// Where paths and requests come from, unless the controller has its course.
    pub channel: Option<(LoopEnd, ControllerEnd)>,
    /// Takes the controller's steps, where they are recorded.
    pub tap: Option<ControllerTap>,
    /// Takes what the controller has learned, from time to time and whenever it is disarmed.
    pub learned: Option<LearnedOutlet>,
    /// Takes transitions and cycles.
    pub records: RecordSink<LoopRecord>,
    /// When to arm and to end.
    pub options: RunOptions,
    /// Requests of signal handlers.
    pub signals: Signals,
}

/// Why a run could not start or did not return.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    /// A setting is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// The system refused a real-time setting.
    #[error(transparent)]
    Realtime(#[from] RealtimeError),
    /// The system has no thread left.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
    /// The loop has panicked.
    #[error("the control loop has panicked; zero speed and disable were sent to the drives")]
    Panicked,
}

/// A finished run, as `sidehill run` prints it last.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RunReport {
    /// How it ended.
    pub ended: RunEnding,
    /// State of the safety after the last cycle.
    pub state: SafetyState,
    /// How well the loop kept its times.
    #[serde(flatten)]
    pub timing: LoopTiming,
}

/// The loop in its thread, `cycle`.
pub struct LoopThread(JoinHandle<Result<RunReport, LoopError>>);

impl LoopSetup {
    /// Starts the loop in its own thread.
    ///
    /// # Errors
    /// [`LoopError::Thread`]. What is wrong with a setting comes from [`LoopThread::join`].
    pub fn start(self) -> Result<LoopThread, LoopError> {
        let thread = std::thread::Builder::new()
            .name("cycle".to_owned())
            .spawn(move || self.run())?;
        Ok(LoopThread(thread))
    }

    fn run(self) -> Result<RunReport, LoopError> {
        if let Clock::External(clock) = &self.clock {
            // Cycles begin with the first time that is set.
            while clock.now_s().is_none() && !self.signals.end.load(Ordering::Relaxed) {
                self.signals.turn();
                std::thread::sleep(Duration::from_millis(20));
            }
        }
        let (loop_end, controller_end) = self.channel.unzip();
        // The controller's thread starts first: it would inherit this thread's CPU and priority.
        let runner =
            ThreadedRunner::start(self.controller, controller_end, self.tap, self.learned)?;
        self.realtime.apply_to_loop()?;
        let helpers = self.port.helper_threads().into_iter();
        for helper in helpers.chain(runner.thread_id()) {
            self.realtime.apply_to_helper(helper)?;
        }
        let mut control_loop = ControlLoop::new(
            self.cycle,
            self.safety,
            self.clock,
            self.port,
            runner,
            self.records,
        )?
        .within(self.geofence);
        let ended = control_loop.run(&self.options, &self.signals, loop_end);
        Ok(RunReport {
            ended,
            state: control_loop.state(),
            timing: control_loop.timing(),
        })
    }
}

impl LoopThread {
    /// Returns whether the loop has returned or panicked.
    pub fn is_finished(&self) -> bool {
        self.0.is_finished()
    }

    /// Waits for the end of the loop and returns its report.
    ///
    /// # Errors
    /// A setting that is out of range or refused by the system, or a panic of the loop.
    pub fn join(self) -> Result<RunReport, LoopError> {
        self.0.join().map_err(|_| LoopError::Panicked)?
    }
}
