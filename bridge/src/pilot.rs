//! The controller as the cycle sees it: in the cycle itself, or in a thread that may be late.

use crate::mission::PilotDesk;
use crate::safety::{Intent, PilotState};
use sidehill_controller::controller::{Controller, Decision, Status};
use sidehill_plant::sample::Sample;
use std::os::unix::thread::JoinHandleExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use thread_priority::ThreadId;
use triple_buffer::{Input, Output, triple_buffer};

/// Decides in every cycle.
pub trait Pilot {
    /// Returns the newest decision, which may be that of an earlier cycle; `engaged` says whether
    /// commands are passed on, and `patience` how long to wait at most, where time is real.
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision>;
}

/// Returns what a decision means to the safety.
pub fn intent(decision: &Decision) -> Intent {
    Intent {
        time_s: decision.time_s,
        command: decision.command_effective,
        pilot: match decision.status {
            Status::Waiting => PilotState::Waiting,
            Status::Tracking | Status::Fallback { .. } => PilotState::Driving,
            Status::Stopping(why) => PilotState::Stopped(why),
            Status::Finished => PilotState::Finished,
        },
    }
}

/// The controller within the cycle, for virtual time.
pub struct InlinePilot {
    controller: Controller,
    engaged: bool,
    desk: Option<PilotDesk>,
}

impl InlinePilot {
    /// Returns a pilot that holds its controller until it is engaged.
    pub fn new(mut controller: Controller) -> Self {
        controller.request_stop();
        Self {
            controller,
            engaged: false,
            desk: None,
        }
    }

    /// Returns this pilot with a desk where it takes paths and leaves what it decides.
    pub fn at(mut self, desk: Option<PilotDesk>) -> Self {
        self.desk = desk;
        self
    }
}

impl Pilot for InlinePilot {
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision> {
        if engaged != self.engaged {
            self.engaged = engaged;
            if engaged {
                self.controller.rearm();
            } else {
                self.controller.request_stop();
            }
        }
        if let Some(desk) = &mut self.desk {
            desk.take_path(&mut self.controller);
        }
        let deadline = patience.map(|patience| Instant::now() + patience);
        let decision = self.controller.step(sample, deadline);
        if let Some(desk) = &mut self.desk {
            desk.leave(&decision, &self.controller);
        }
        Some(decision)
    }
}

/// What the cycle asks the thread.
#[derive(Debug, Clone, Copy)]
struct Question {
    sample: Sample,
    engaged: bool,
    patience: Option<Duration>,
}

/// The controller in a thread of its own, so that it can be late or die without the cycle.
pub struct ThreadedPilot {
    questions: Input<Option<Question>>,
    answers: Output<Option<Decision>>,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl ThreadedPilot {
    /// Returns a pilot whose thread wakes the calling one when it has decided.
    ///
    /// # Errors
    /// The system's, where it has no thread left.
    pub fn start(controller: Controller, desk: Option<PilotDesk>) -> Result<Self, std::io::Error> {
        let (questions, mut asked) = triple_buffer(&None::<Question>);
        let (mut answer, answers) = triple_buffer(&None::<Decision>);
        let stop = Arc::new(AtomicBool::new(false));
        let (ended, cycle) = (Arc::clone(&stop), std::thread::current());
        let thread = std::thread::Builder::new()
            .name("controller".to_owned())
            .spawn(move || {
                let mut pilot = InlinePilot::new(controller).at(desk);
                while !ended.load(Ordering::Relaxed) {
                    if !asked.update() {
                        std::thread::park_timeout(Duration::from_millis(100));
                        continue;
                    }
                    if let Some(question) = *asked.output_buffer() {
                        answer.write(pilot.decide(
                            &question.sample,
                            question.engaged,
                            question.patience,
                        ));
                        cycle.unpark();
                    }
                }
            })?;
        Ok(Self {
            questions,
            answers,
            stop,
            thread: Some(thread),
        })
    }

    /// Returns the system's name of the thread.
    pub fn thread_id(&self) -> Option<ThreadId> {
        self.thread.as_ref().map(JoinHandleExt::as_pthread_t)
    }
}

impl Pilot for ThreadedPilot {
    fn decide(
        &mut self,
        sample: &Sample,
        engaged: bool,
        patience: Option<Duration>,
    ) -> Option<Decision> {
        self.questions.write(Some(Question {
            sample: *sample,
            engaged,
            patience,
        }));
        if let Some(thread) = &self.thread {
            thread.thread().unpark();
        }
        let deadline = Instant::now() + patience.unwrap_or_default();
        while !self.answers.update() {
            let now = Instant::now();
            if now >= deadline {
                break;
            }
            std::thread::park_timeout(deadline - now);
        }
        *self.answers.output_buffer()
    }
}

/// Longest wait for the thread at the end: more than a decision, and short for a person.
const END_PATIENCE: Duration = Duration::from_millis(500);

impl Drop for ThreadedPilot {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        let Some(thread) = self.thread.take() else {
            return;
        };
        thread.thread().unpark();
        let deadline = Instant::now() + END_PATIENCE;
        // A controller that hangs is left to the end of the program; a panic has shown itself as a
        // command time-out.
        while !thread.is_finished() && Instant::now() < deadline {
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}
