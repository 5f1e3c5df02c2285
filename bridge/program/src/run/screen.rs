//! The output of `run`: its inputs at the start, then its state and missing inputs.

use super::files::Files;
use crate::recording::DriveRecording;
use serde::Serialize;
use sidehill::console::{Level, Printer, is_journal};
use sidehill::drive::{RunArgs, RunFormat};
use sidehill_bridge::control_loop::record::{CycleRow, EventLine, LogEntry, Outputs, Recorder};
use sidehill_bridge::control_loop::{RunOptions, RunReport};
use sidehill_bridge::drives::{Epoch, Input};
use sidehill_bridge::safety::SafetyState;
use sidehill_recording::RecordingStatus;
use std::fmt::Write as _;
use std::io::IsTerminal;

/// Time between two states that are not on a terminal, s.
const STATE_EVERY_S: f64 = 60.0;
/// Events other than changes of state that are printed in a second, at most.
const EVENTS_MAX: u32 = 5;

/// The state on standard output.
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

/// What makes the printed state another.
#[derive(PartialEq)]
struct Shown {
    state: SafetyState,
    missing: Vec<String>,
    /// Whether there is an estimate of the pose.
    located: bool,
    /// Whether records, and the recording, are not written.
    unwritten: [bool; 2],
}

/// Standard output and standard error of a run.
pub(super) struct Screen<'a> {
    printer: &'a Printer,
    format: RunFormat,
    /// Whether the line of the state is replaced in place.
    terminal: bool,
    /// What is printed.
    level: Level,
    /// Whether lines have priorities: those on standard output, and on standard error.
    journals: [bool; 2],
    /// Whether events go to standard error, because they are not written to a file.
    events_to_error: bool,
    /// What it waits for when nothing is missing.
    ready: String,
    /// Why the state changed last.
    reason: String,
    state_s: f64,
    /// What makes the printed state another.
    shown: Option<Shown>,
    /// Events since the last state.
    events: u32,
    batches_unwritten: u64,
}

impl<'a> Screen<'a> {
    pub(super) fn new(args: &RunArgs, printer: &'a Printer, ready: String) -> Self {
        let terminal = std::io::stdout().is_terminal();
        let usual = match terminal {
            true => RunFormat::Text,
            false => RunFormat::Json,
        };
        Self {
            printer,
            format: args.format.unwrap_or(usual),
            terminal,
            level: args.log_level,
            journals: [
                is_journal(&std::io::stdout()),
                is_journal(&std::io::stderr()),
            ],
            events_to_error: args.out.is_none(),
            ready,
            reason: String::new(),
            state_s: f64::NEG_INFINITY,
            shown: None,
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
        let mut seen = |event: &EventLine<'_>| match self.format {
            RunFormat::Text => self.event(event),
            RunFormat::Json if self.events_to_error => {
                if let Ok(line) = serde_json::to_string(event) {
                    self.error_line(level(event), &line);
                }
            }
            RunFormat::Json => {}
        };
        let mut all = |time_s: f64, entry: &LogEntry| {
            if let Some(recording) = recording.as_deref_mut() {
                recording.entry(time_s, entry);
            }
        };
        let written = match files {
            Some(files) => files.write(recorder, &mut seen, &mut all),
            None => {
                let outputs = &mut Outputs {
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
                self.fault("records not written", &format!("{error:#}"));
            }
            self.batches_unwritten += 1;
        }
    }

    /// Prints a fault that the files do not have.
    pub(super) fn fault(&self, event: &str, reason: &str) {
        if self.format == RunFormat::Text {
            self.line(Level::Error, &format!("{event}: {reason}"));
        } else {
            let line = serde_json::json!({ "event": event, "reason": reason });
            self.error_line(Level::Error, &line.to_string());
        }
    }

    /// Prints an event as text.
    fn event(&mut self, line: &EventLine<'_>) {
        let EventLine {
            time_s,
            event,
            from,
            to,
            reason,
            ..
        } = *line;
        let level = level(line);
        match (event, to) {
            ("start", _) => self.line(level, reason),
            ("waits_for", _) => {
                for input in reason.split("; waits for ") {
                    let input = input.trim_start_matches("waits for ");
                    self.line(level, &format!("{time_s:7.1} s  waits for {input}"));
                }
            }
            (_, Some(to)) => {
                self.line(level, &format!("{time_s:7.1} s  {}: {reason}", name(to)));
                // The end of the ramp is not why the vehicle stopped.
                if from != Some(SafetyState::Stopping) {
                    reason.clone_into(&mut self.reason);
                }
            }
            _ => {
                self.events += 1;
                if self.events <= EVENTS_MAX {
                    self.line(level, &format!("{time_s:7.1} s  {event}: {reason}"));
                }
            }
        }
    }

    /// Prints the state, if it is to be; called once a second.
    pub(super) fn status(
        &mut self,
        now_s: f64,
        recorder: &Recorder,
        missing: &[&Input],
        recording: Option<(&RecordingStatus, u64)>,
        epoch: Epoch,
    ) {
        let cycle = recorder.latest();
        if self.events > EVENTS_MAX {
            let more = self.events - EVENTS_MAX;
            self.line(
                Level::Info,
                &format!("           and {more} more such events"),
            );
        }
        self.events = 0;
        let level = match self.is_due(now_s, cycle, missing, recording) {
            true => Level::Info,
            false => Level::Debug,
        };
        if level > self.level {
            return;
        }
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
                self.output(level, &line);
            }
            return;
        }
        let mut line = format!("{now_s:7.1} s  {}", self.state(cycle, missing));
        if self.batches_unwritten > 0 {
            let _ = write!(line, "; records not written: {}", self.batches_unwritten);
        }
        if let Some(reason) = recording.and_then(|(status, _)| status.ended.as_ref()) {
            let _ = write!(line, "; not recorded: {reason}");
        }
        match self.terminal {
            true => self.printer.renew(line),
            false => self.output(level, &line),
        }
    }

    /// Returns whether the state is printed at the usual level: each time on a terminal, else where a minute has passed
    /// and, in JSON, where it is another; in text its changes are events.
    fn is_due(
        &mut self,
        now_s: f64,
        cycle: Option<&CycleRow>,
        missing: &[&Input],
        recording: Option<(&RecordingStatus, u64)>,
    ) -> bool {
        let shown = cycle.map(|cycle| {
            let names = missing.iter().map(|input| input.input.clone());
            let ended = recording.is_some_and(|(status, _)| status.ended.is_some());
            Shown {
                state: cycle.state,
                missing: names.collect(),
                located: cycle.x_m.is_finite(),
                unwritten: [self.batches_unwritten > 0, ended],
            }
        });
        let changed = self.format == RunFormat::Json && shown != self.shown;
        let due = self.terminal || changed || now_s >= self.state_s + STATE_EVERY_S;
        if due {
            self.state_s = now_s;
            self.shown = shown;
        }
        due
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
                    self.output(Level::Info, &line);
                }
            }
            (RunFormat::Json, None) => {}
            (RunFormat::Text, None) => self.line(Level::Error, "ended by an error"),
            (RunFormat::Text, Some(report)) => {
                let ended = serde_json::to_value(report.ended).unwrap_or_default();
                let timing = &report.timing;
                self.line(Level::Info, &format!(
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

    /// Prints a permanent line, if its level is.
    fn line(&self, level: Level, line: &str) {
        match self.terminal {
            _ if level > self.level => {}
            true => self.printer.above(line),
            false => self.output(level, line),
        }
    }

    /// Prints to standard output.
    fn output(&self, level: Level, line: &str) {
        let prefix = if self.journals[0] { level.prefix() } else { "" };
        self.printer.line(format_args!("{prefix}{line}"));
    }

    /// Prints to standard error, if the level is printed.
    fn error_line(&self, level: Level, line: &str) {
        if level <= self.level {
            let prefix = if self.journals[1] { level.prefix() } else { "" };
            self.printer.error_line(format_args!("{prefix}{line}"));
        }
    }
}

fn level(event: &EventLine<'_>) -> Level {
    match event.warns {
        true => Level::Warn,
        false => Level::Info,
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
