//! The controller as the loop sees it: run in the loop, or in a thread that may be late.

use super::channel::ControllerEnd;
use super::learned::LearnedOutlet;
use super::tap::ControllerTap;
use crate::safety::{ControllerOutput, ControllerState};
use crate::system::{ThreadId, thread_id};
use sidehill_controller::controller::{Controller, Decision, DriveResponse, Status};
use sidehill_plant::sample::Sample;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use triple_buffer::{Input, Output, triple_buffer};

/// Runs a controller once a cycle.
pub trait ControllerRunner {
    /// Returns the newest decision, which may be that of an earlier cycle. `engaged` says whether
    /// commands reach the drives, and `patience` how long to wait at most; none in simulated time.
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision>;

    /// Returns how the drives respond, as learned until the newest decision; none if nothing learns it.
    fn drives(&self) -> Option<DriveResponse> {
        None
    }
}

/// Returns what a decision means to the safety state machine.
pub(super) fn controller_output(decision: &Decision) -> ControllerOutput {
    ControllerOutput {
        time_s: decision.time_s,
        command: decision.command_effective,
        state: match decision.status {
            Status::Waiting => ControllerState::Waiting,
            Status::Tracking | Status::Fallback { .. } => ControllerState::Driving,
            Status::Stopping(why) => ControllerState::Stopped(why),
            Status::Finished => ControllerState::Finished,
        },
    }
}

/// The controller run in the loop itself, for simulated time.
pub struct InlineRunner {
    controller: Controller,
    engaged: bool,
    channel: Option<ControllerEnd>,
    tap: Option<ControllerTap>,
    learned: Option<LearnedOutlet>,
}

/// Lets the controller drive from nothing where it becomes `engaged`, and holds it where it no longer
/// is.
pub fn engage(controller: &mut Controller, engaged: bool) {
    if engaged {
        controller.rearm();
    } else {
        controller.request_stop();
    }
}

impl InlineRunner {
    /// Returns a runner whose controller holds until it is engaged.
    pub fn new(controller: Controller) -> Self {
        Self::with_channel(controller, None, None)
    }

    /// Returns a runner whose steps are recorded.
    pub fn recorded(controller: Controller, tap: ControllerTap) -> Self {
        Self::with_channel(controller, None, Some(tap))
    }

    /// Returns a runner that takes paths from a channel and whose steps are recorded, where they are given.
    pub fn with_channel(
        mut controller: Controller,
        channel: Option<ControllerEnd>,
        tap: Option<ControllerTap>,
    ) -> Self {
        controller.request_stop();
        Self {
            controller,
            engaged: false,
            channel,
            tap,
            learned: None,
        }
    }

    /// Leaves what was learned where it is time for it.
    fn leave_learned(&mut self, time_s: f64) {
        if let Some(outlet) = &mut self.learned {
            outlet.serve(time_s, self.engaged, &self.controller);
        }
    }
}

impl ControllerRunner for InlineRunner {
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision> {
        if engaged != self.engaged {
            self.engaged = engaged;
            engage(&mut self.controller, engaged);
            if let Some(outlet) = self.learned.as_mut().filter(|_| !engaged) {
                outlet.disarmed();
            }
        }
        let path = match &mut self.channel {
            Some(channel) => channel.apply_path(&mut self.controller),
            None => 0,
        };
        let deadline = patience.map(|patience| Instant::now() + patience);
        let decision = self.controller.step(sample, deadline);
        if let Some(channel) = &mut self.channel {
            channel.publish(sample.time_s, &decision, &self.controller);
        }
        if let Some(tap) = &mut self.tap {
            tap.take(sample, engaged, path, &decision, &self.controller);
        }
        Some(decision)
    }

    fn drives(&self) -> Option<DriveResponse> {
        Some(self.controller.drive_response())
    }
}

/// A decision, with how the drives respond.
type Decided = (Decision, DriveResponse);

/// What the loop asks the controller's thread to decide on.
#[derive(Debug, Clone, Copy)]
struct Task {
    sample: Sample,
    engaged: bool,
    patience: Option<Duration>,
}

/// The controller in its own thread, `controller`: the loop continues if it is late or dies.
pub struct ThreadedRunner {
    task: Input<Option<Task>>,
    decision: Output<Option<Decided>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ThreadedRunner {
    /// Starts the thread. It wakes the calling thread with each decision.
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(
        controller: Controller,
        channel: Option<ControllerEnd>,
        tap: Option<ControllerTap>,
        learned: Option<LearnedOutlet>,
    ) -> Result<Self, std::io::Error> {
        let (task, mut newest_task) = triple_buffer(&None::<Task>);
        let (mut decided, decision) = triple_buffer(&None::<Decided>);
        let end = Arc::new(AtomicBool::new(false));
        let (ended, caller) = (Arc::clone(&end), std::thread::current());
        let thread = std::thread::Builder::new()
            .name("controller".to_owned())
            .spawn(move || {
                let mut runner = InlineRunner::with_channel(controller, channel, tap);
                runner.learned = learned;
                while !ended.load(Ordering::Relaxed) {
                    if !newest_task.update() {
                        std::thread::park_timeout(Duration::from_millis(100));
                        continue;
                    }
                    if let Some(task) = *newest_task.output_buffer() {
                        let decision = runner.decide(&task.sample, task.engaged, task.patience);
                        decided.write(decision.zip(runner.drives()));
                        caller.unpark();
                        runner.leave_learned(task.sample.time_s);
                    }
                }
            })?;
        Ok(Self {
            task,
            decision,
            end,
            thread: Some(thread),
        })
    }

    /// Returns the system's identifier of the thread.
    pub fn thread_id(&self) -> Option<ThreadId> {
        self.thread.as_ref().map(thread_id)
    }
}

impl ControllerRunner for ThreadedRunner {
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision> {
        self.task.write(Some(Task {
            sample: *sample,
            engaged,
            patience,
        }));
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        let deadline = Instant::now() + patience.unwrap_or_default();
        while !self.decision.update() {
            let now = Instant::now();
            if now >= deadline {
                break;
            }
            std::thread::park_timeout(deadline - now);
        }
        self.decision.output_buffer().map(|(decision, _)| decision)
    }

    fn drives(&self) -> Option<DriveResponse> {
        self.decision.output_buffer().map(|(_, drives)| drives)
    }
}

/// Longest wait for the thread on drop.
const END_WAIT_MAX: Duration = Duration::from_millis(500);

impl Drop for ThreadedRunner {
    /// Waits for the decision in progress. A controller that hangs is left behind.
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        let Some(thread) = self.thread.take() else {
            return;
        };
        thread.thread().unpark();
        let deadline = Instant::now() + END_WAIT_MAX;
        while !thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
