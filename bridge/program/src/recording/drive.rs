use sidehill::recording::DIAGNOSTICS_PERIOD_S;
use sidehill_bridge::control_loop::record::{CycleRow, LogEntry};
use sidehill_bridge::control_loop::tap::{ControllerLog, PathRecord, StepRecord};
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::safety::Transition;
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::{
    DriveMessages, FixState, GeneralState, LogLine, Marker, Obstacles, RecordingStatus, Sinks,
};
use sidehill_ros2::port::FixReading;
use std::sync::{Arc, OnceLock};

/// Records a real-time drive, or shows it, from a thread that may wait for the disk.
pub(crate) struct DriveRecording {
    sinks: Sinks,
    log: ControllerLog,
    messages: DriveMessages,
    batch: Vec<(f64, Item)>,
    newest_s: f64,
    diagnostics_s: f64,
    /// Reports why the recording ended.
    ended: Arc<OnceLock<String>>,
}

enum Item {
    Step(Box<StepRecord>),
    Cycle(CycleRow),
    Event {
        name: &'static str,
        text: String,
        level: u8,
    },
    Fix(FixState),
    Obstacles(Obstacles),
}

impl DriveRecording {
    pub(crate) fn new(
        mut sinks: Sinks,
        log: ControllerLog,
        (vehicle, ground): (&Vehicle, &[Marker]),
        epoch: Epoch,
        initial: Option<&PathRecord>,
        ended: Arc<OnceLock<String>>,
    ) -> Self {
        let messages = DriveMessages::new(vehicle, epoch.unix_s(0.0));
        messages.begin(0.0, ground, &mut sinks);
        if let Some(path) = initial {
            messages.path(0.0, path, &mut sinks);
        }
        Self {
            sinks,
            log,
            messages,
            batch: Vec::new(),
            newest_s: 0.0,
            diagnostics_s: f64::NEG_INFINITY,
            ended,
        }
    }

    /// Takes the entries of the loop or a port.
    pub(crate) fn entry(&mut self, time_s: f64, entry: &LogEntry) {
        let item = match entry {
            LogEntry::Message(_) => return,
            LogEntry::Cycle(row) => Item::Cycle(*row),
            LogEntry::Event {
                event,
                transition,
                reason,
                warns,
            } => {
                let level = match warns {
                    true => LogLine::WARN,
                    false => LogLine::INFO,
                };
                if let (Some(live), Some(transition)) = (&self.sinks.live, transition) {
                    live.transition(transition);
                }
                Item::Event {
                    name: event,
                    level,
                    text: match transition {
                        Some(Transition { from, to, .. }) => {
                            format!("{from:?} -> {to:?}: {reason}")
                        }
                        None => reason.clone(),
                    },
                }
            }
        };
        self.batch.push((time_s, item));
    }

    /// Takes a fix of the satellite receiver.
    pub(crate) fn fix(&mut self, fix: &FixReading) {
        let state = FixState {
            time_s: fix.time_s,
            status: fix.status,
            sigma_m: fix.sigma_m,
            used: fix.used,
        };
        self.batch.push((fix.arrived_s, Item::Fix(state)));
    }

    /// Takes the obstacles that are known at a time.
    pub(crate) fn obstacles(&mut self, time_s: f64, obstacles: Obstacles) {
        self.batch.push((time_s, Item::Obstacles(obstacles)));
    }

    /// Writes all waiting entries, ordered by time.
    pub(crate) fn write(&mut self) {
        let sinks = &mut self.sinks;
        // Read steps first: a path is queued before the step that follows it.
        while let Some(step) = self.log.steps.pop() {
            self.batch
                .push((step.sample.time_s, Item::Step(Box::new(step))));
        }
        while let Some(path) = self.log.next_path() {
            self.messages.path(self.newest_s, &path, sinks);
        }
        self.batch.sort_by(|(a_s, _), (b_s, _)| a_s.total_cmp(b_s));
        for (time_s, item) in self.batch.drain(..) {
            self.newest_s = self.newest_s.max(time_s);
            match item {
                Item::Step(step) => self.messages.step(&step, sinks),
                Item::Cycle(row) => self.messages.loop_cycle(&row, sinks),
                Item::Fix(fix) => self.messages.fix(time_s, &fix, sinks),
                Item::Obstacles(obstacles) => self.messages.obstacles(time_s, &obstacles, sinks),
                Item::Event { name, text, level } => {
                    self.messages.event(time_s, level, name, &text, sinks);
                }
            }
        }
        if let Some(plan) = self.log.new_plan() {
            self.messages.plan(plan, sinks);
        }
        if self.newest_s >= self.diagnostics_s + DIAGNOSTICS_PERIOD_S {
            self.diagnostics_s = self.newest_s;
            let status = sinks.status().cloned();
            let general = GeneralState {
                recording: status.as_ref(),
                lost: self.log.lost(),
            };
            self.messages.diagnostics(self.newest_s, &general, sinks);
        }
        sinks.flush_when_due();
        if let Some(reason) = sinks.status().and_then(|status| status.ended.as_ref()) {
            let _ = self.ended.set(reason.clone());
        }
    }

    /// Returns the status of the recording, and the number of steps that were dropped.
    pub(crate) fn status(&self) -> Option<(&RecordingStatus, u64)> {
        Some((self.sinks.status()?, self.log.lost()))
    }

    /// Writes the remaining entries and closes the file.
    pub(crate) fn finish(mut self) -> Option<RecordingStatus> {
        self.write();
        self.sinks.finish()
    }
}
