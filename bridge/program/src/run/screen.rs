//! The output of `run`: its inputs at the start, then its state and missing inputs.

use super::files::Files;
use crate::recording::DriveRecording;
use serde::Serialize;
use sidehill::console::Printer;
use sidehill::drive::RunFormat;
use sidehill_bridge::control_loop::record::{CycleRow, EventLine, LogEntry, Outputs, Recorder};
use sidehill_bridge::control_loop::{RunOptions, RunReport};
use sidehill_bridge::drives::{Epoch, Input};
use sidehill_bridge::safety::SafetyState;
use sidehill_recording::RecordingStatus;
use std::fmt::Write as _;
use std::io::{IsTerminal, Write as _};

/// Time between two states in text that is not on a terminal, s; what changes is an event.
const STATE_EVERY_S: f64 = 60.0;
/// Events other than changes of state that are printed in a second, at most.
const EVENTS_MAX: u32 = 5;

/// One line per second on standard output.
#[derive(Serialize)]
struct StatusLine<'a> {
    unix_s: f64,
    #[serde(flatten)]
    cycle: &'a CycleRow,
    records_lost: u64,
    /// Inputs that are missing, with the reason; absent while there are none.
    #[serde(skip_serializing_if = "<[_]>::is_empty")]
    waits_for: &'a [&'a Input],
    /// Dropped lines of text; absent while there are none.
    #[serde(skip_serializing_if = "is_zero")]
    lines_dropped: u64,
    /// Batches of records that could not be written to --out; absent while there are none.
    #[serde(skip_serializing_if = "is_zero")]
    batches_unwritten: u64,
    /// Status of the recording; absent without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    recording: Option<&'a RecordingStatus>,
    /// Steps of the controller that are missing in it; absent while there are none.
    #[serde(skip_serializing_if = "is_zero")]
    steps_lost: u64,
}

fn is_zero(count: &u64) -> bool {
    *count == 0
}

/// Standard output and standard error of a run.
pub(super) struct Screen<'a> {
    printer: &'a Printer,
    format: RunFormat,
    /// Whether the line of the state is replaced in place.
    terminal: bool,
    /// Whether events go to standard error, because they are not written to a file.
    events_to_error: bool,
    /// What it waits for when nothing is missing.
    ready: String,
    /// Why the state changed last.
    reason: String,
    state_s: f64,
    /// Events since the last state.
    events: u32,
    batches_unwritten: u64,
}

impl<'a> Screen<'a> {
    pub(super) fn new(
        format: Option<RunFormat>,
        printer: &'a Printer,
        events_to_error: bool,
        ready: String,
    ) -> Self {
        let terminal = std::io::stdout().is_terminal();
        let usual = match terminal {
            true => RunFormat::Text,
            false => RunFormat::Json,
        };
        Self {
            printer,
            format: format.unwrap_or(usual),
            terminal,
            events_to_error,
            ready,
            reason: String::new(),
            state_s: f64::NEG_INFINITY,
            events: 0,
            batches_unwritten: 0,
        }
    }

    /// Writes the entries of all threads to the files and the recording, if there are any. Write errors are counted.
    pub(super) fn record(
        &mut self,
        recorder: &mut Recorder,
        files: Option<&mut Files>,
        mut recording: Option<&mut DriveRecording>,
    ) {
        let printer = self.printer;
        let text = self.format == RunFormat::Text;
        let json_to_error = self.events_to_error && !text;
        let mut seen = |event: &EventLine<'_>| {
            if text {
                self.event(event);
            }
        };
        let mut all = |time_s: f64, entry: &LogEntry| {
            if let Some(recording) = recording.as_deref_mut() {
                recording.entry(time_s, entry);
            }
        };
        let written = match files {
            Some(files) => files.write(recorder, &mut seen, &mut all),
            None => {
                let mut errors = printer.errors();
                let outputs = &mut Outputs {
                    events: json_to_error.then_some(&mut errors as &mut dyn std::io::Write),
                    seen: Some(&mut seen),
                    all: Some(&mut all),
                    ..Outputs::default()
                };
                recorder.drain(outputs).map_err(anyhow::Error::from)
            }
        };
        if let Some(recording) = recording {
            recording.write();
        }
        if let Err(error) = written {
            if self.batches_unwritten == 0 {
                self.warn("records not written", &format!("{error:#}"));
            }
            self.batches_unwritten += 1;
        }
    }

    /// Prints an event that the files do not have.
    pub(super) fn warn(&self, event: &str, reason: &str) {
        if self.format == RunFormat::Text {
            self.line(&format!("{event}: {reason}"));
        } else {
            let line = serde_json::json!({ "event": event, "reason": reason });
            let _ = writeln!(self.printer.errors(), "{line}");
        }
    }

    /// Prints an event as text.
    fn event(&mut self, event: &EventLine<'_>) {
        let EventLine {
            time_s,
            event,
            from,
            to,
            reason,
            ..
        } = *event;
        match (event, to) {
            ("start", _) => self.line(reason),
            ("waits_for", _) => {
                for input in reason.split("; waits for ") {
                    let input = input.trim_start_matches("waits for ");
                    self.line(&format!("{time_s:7.1} s  waits for {input}"));
                }
            }
            (_, Some(to)) => {
                self.line(&format!("{time_s:7.1} s  {}: {reason}", name(to)));
                // The end of the ramp is not why the vehicle stopped.
                if from != Some(SafetyState::Stopping) {
                    reason.clone_into(&mut self.reason);
                }
            }
            _ => {
                self.events += 1;
                if self.events <= EVENTS_MAX {
                    self.line(&format!("{time_s:7.1} s  {event}: {reason}"));
                }
            }
        }
    }

    /// Prints the state, once a second.
    pub(super) fn status(
        &mut self,
        now_s: f64,
        recorder: &Recorder,
        missing: &[&Input],
        recording: Option<(&RecordingStatus, u64)>,
        epoch: Epoch,
    ) {
        let cycle = recorder.latest();
        if self.format == RunFormat::Json {
            let Some(cycle) = cycle else { return };
            let line = StatusLine {
                unix_s: epoch.unix_s(cycle.time_s),
                cycle,
                records_lost: recorder.lost(),
                waits_for: missing,
                lines_dropped: self.printer.dropped(),
                batches_unwritten: self.batches_unwritten,
                recording: recording.map(|(status, _)| status),
                steps_lost: recording.map_or(0, |(_, lost)| lost),
            };
            if let Ok(line) = serde_json::to_string(&line) {
                self.printer.line(line);
            }
            return;
        }
        if self.events > EVENTS_MAX {
            let more = self.events - EVENTS_MAX;
            self.line(&format!("           and {more} more such events"));
        }
        self.events = 0;
        if !self.terminal && now_s < self.state_s + STATE_EVERY_S {
            return;
        }
        self.state_s = now_s;
        let mut line = format!("{now_s:7.1} s  {}", self.state(cycle, missing));
        if self.batches_unwritten > 0 {
            let _ = write!(line, "; records not written: {}", self.batches_unwritten);
        }
        if let Some(reason) = recording.and_then(|(status, _)| status.ended.as_ref()) {
            let _ = write!(line, "; not recorded: {reason}");
        }
        match self.terminal {
            true => self.printer.renew(line),
            false => self.printer.line(line),
        }
    }

    /// Returns the state in words.
    pub(super) fn state(&self, cycle: Option<&CycleRow>, missing: &[&Input]) -> String {
        let names: Vec<&str> = missing.iter().map(|input| input.input.as_str()).collect();
        let waits = match names.as_slice() {
            [] => self.ready.clone(),
            names => format!("waits for {}", names.join(", ")),
        };
        let Some(cycle) = cycle else { return waits };
        match cycle.state {
            SafetyState::Disarmed => waits,
            SafetyState::Latched => format!("stopped ({}); {waits}", self.reason),
            SafetyState::Zeroing | SafetyState::Enabling => "arming".to_owned(),
            SafetyState::Stopping => format!("stopping ({})", self.reason),
            SafetyState::Driving => {
                let mut line = format!("driving {:.2} m/s", cycle.feedback_traction_m_s);
                if let Some(cross_track_m) = cycle.cross_track_m {
                    let side = if cross_track_m < 0.0 { "right" } else { "left" };
                    let distance_cm = 100.0 * cross_track_m.abs();
                    let _ = write!(line, ", {distance_cm:.1} cm {side} of the path");
                }
                let _ = write!(line, ", at ({:.2}, {:.2}) m", cycle.x_m, cycle.y_m);
                if !names.is_empty() {
                    let _ = write!(line, ", without {}", names.join(", "));
                }
                line
            }
        }
    }

    /// Prints how the run ended, unless it failed.
    pub(super) fn end(&mut self, report: Option<&RunReport>) {
        match (self.format, report) {
            (RunFormat::Json, Some(report)) => {
                if let Ok(line) = serde_json::to_string(report) {
                    self.printer.line(line);
                }
            }
            (RunFormat::Json, None) => {}
            (RunFormat::Text, None) => self.line("ended by an error"),
            (RunFormat::Text, Some(report)) => {
                let ended = serde_json::to_value(report.ended).unwrap_or_default();
                let timing = &report.timing;
                self.line(&format!(
                    "ended: {} in state {}; {} cycles, {} skipped, {} commands not sent, start lateness {:.1} ms (99 %)",
                    ended.as_str().unwrap_or_default().replace('_', " "),
                    name(report.state),
                    timing.cycles,
                    timing.skipped,
                    timing.unsent,
                    1e3 * timing.lateness_p99_s,
                ));
            }
        }
    }

    /// Prints a permanent line.
    fn line(&self, line: &str) {
        match self.terminal {
            true => self.printer.above(line),
            false => self.printer.line(line),
        }
    }
}

fn name(state: SafetyState) -> String {
    format!("{state:?}").to_lowercase()
}

/// Returns what a run waits for when nothing is missing and no goals come from ROS 2.
pub(super) fn ready_to_arm(arm: bool) -> String {
    let how = format!(
        "waits for SIGUSR1 to arm (kill -USR1 {})",
        std::process::id()
    );
    if arm {
        let within_s = RunOptions::ARM_WITHIN_S;
        return format!("arms once by itself in the first {within_s:.0} s, then {how}");
    }
    how
}

/// Returns the inputs of a run; empty if there are none.
pub(super) fn listens_to(inputs: &[Input]) -> String {
    let names: Vec<String> = inputs
        .iter()
        .map(|input| format!("{} {}", input.input, input.source))
        .collect();
    match names.is_empty() {
        true => String::new(),
        false => format!("; listens to {}", names.join(", ")),
    }
}

/// Returns the missing inputs with their reasons; empty if there are none.
pub(super) fn waits_for(missing: &[&Input]) -> String {
    let each: Vec<String> = missing
        .iter()
        .map(|input| format!("waits for {input}"))
        .collect();
    each.join("; ")
}
