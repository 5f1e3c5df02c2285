//! What is logged: the loop, and each port's threads, leave plain values in bounded rings without
//! waiting; [`Recorder`], outside the real-time threads, makes text of them.

use super::actions::ActionWatch;
use crate::drives::{Epoch, LinkState, SendError};
use crate::safety::{Reason, SafetyState, Transition};
use serde::Serialize;
use sidehill_controller::controller::DriveResponse;
use sidehill_controller::path::{PendingActions, RouteAction};
use std::io::{Error, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// A plain value to log; ports have their own kinds.
pub trait Record: Copy + Send + 'static {
    /// Returns the instant, s.
    fn time_s(&self) -> f64;

    /// Returns what is written. May allocate: only the recorder calls it.
    fn entry(&self) -> LogEntry;
}

/// What a record is written as.
#[derive(Debug, Clone, PartialEq)]
pub enum LogEntry {
    /// A message on the link, as `candump -l` writes it after the interface.
    Message(String),
    /// Something that happened.
    Event {
        /// What, in one word.
        event: &'static str,
        /// The transition, of a change of state.
        transition: Option<Transition>,
        /// Details.
        reason: String,
        /// Whether somebody should look at it.
        warns: bool,
    },
    /// A control cycle.
    Cycle(CycleRow),
}

impl LogEntry {
    /// Returns an event that is not a transition.
    pub fn event(event: &'static str, reason: String) -> Self {
        Self::Event {
            event,
            transition: None,
            reason,
            warns: false,
        }
    }

    /// Returns an event that is not a transition, and that somebody should look at.
    pub fn warning(event: &'static str, reason: String) -> Self {
        Self::Event {
            event,
            transition: None,
            reason,
            warns: true,
        }
    }
}

/// What the control loop leaves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LoopRecord {
    /// A command could not be sent, after one that could.
    Unsent {
        /// When, s.
        time_s: f64,
        /// Why.
        error: SendError,
    },
    /// The vehicle could not be armed in time at the start of the run.
    ArmingExpired {
        /// When, s.
        time_s: f64,
        /// In which time, s.
        within_s: f64,
    },
    /// The safety changed its state.
    Transition(Transition),
    /// The drives respond in another way than was recorded before, see [`differs`].
    Drives {
        /// When, s.
        time_s: f64,
        /// How they respond.
        response: DriveResponse,
    },
    /// A cycle.
    Cycle(CycleRow),
}

impl Record for LoopRecord {
    fn time_s(&self) -> f64 {
        match self {
            Self::Unsent { time_s, .. }
            | Self::ArmingExpired { time_s, .. }
            | Self::Drives { time_s, .. }
            | Self::Transition(Transition { time_s, .. })
            | Self::Cycle(CycleRow { time_s, .. }) => *time_s,
        }
    }

    fn entry(&self) -> LogEntry {
        match self {
            Self::Unsent { error, .. } => LogEntry::warning("unsent", error.to_string()),
            Self::ArmingExpired { within_s, .. } => LogEntry::warning(
                "arming",
                format!(
                    "expired: the link and fresh feedback were not there within {within_s:.0} s"
                ),
            ),
            Self::Transition(transition) => LogEntry::Event {
                event: "state",
                transition: Some(*transition),
                reason: transition.reason.to_string(),
                warns: transition.reason.is_fault(),
            },
            Self::Drives { response, .. } => {
                let text = response.to_string();
                if text.is_empty() {
                    let all_reached = "the motors reach the commanded speeds";
                    LogEntry::event("drives", all_reached.to_owned())
                } else {
                    LogEntry::warning("drives", text)
                }
            }
            Self::Cycle(row) => LogEntry::Cycle(*row),
        }
    }
}

/// Share by which the largest speed or the gain of a motor, or the share of commands that is followed, falls for the
/// response of the drives to be another.
const LOSS: f64 = 0.1;

/// Returns whether a response of the drives is worth another record than the last: a motor falls short of its
/// commands, reaches them again, or runs at a gain of them, or what it reaches has fallen by a tenth. That it rises is
/// not: it does while less is commanded.
pub fn differs(last: Option<&DriveResponse>, now: &DriveResponse) -> bool {
    let reached = |response: &DriveResponse| {
        let (traction, steer) = (&response.traction, &response.steer);
        [
            traction.short_m_s(),
            steer.short_m_s(),
            traction.gain_off(),
            steer.gain_off(),
            response.scaled(),
        ]
    };
    let before = last.map_or([None; 5], reached);
    let pairs = before.into_iter().zip(reached(now));
    pairs.into_iter().any(|pair| match pair {
        (Some(before), Some(now)) => now < (1.0 - LOSS) * before,
        (before, now) => before.is_some() != now.is_some(),
    })
}

/// One control cycle. The names of its fields are the columns of `cycles.csv`.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CycleRow {
    /// When the cycle began, s.
    pub time_s: f64,
    /// How much later than due, s.
    pub lateness_s: f64,
    /// What was left of the period when it ended, s.
    pub slack_s: f64,
    /// State of the safety.
    pub state: SafetyState,
    /// Whether the drives were commanded to be enabled.
    pub enable: bool,
    /// Commanded traction, m/s.
    pub traction_m_s: f64,
    /// Commanded steer, m/s.
    pub steer_m_s: f64,
    /// Whether the command could be sent.
    pub sent: bool,
    /// Traction fed back, m/s; NaN without feedback.
    pub feedback_traction_m_s: f64,
    /// Steer fed back, m/s; NaN without feedback.
    pub feedback_steer_m_s: f64,
    /// Age of the feedback, s; infinite without.
    pub feedback_age_s: f64,
    /// State of the link to the drives.
    pub bus: LinkState,
    /// Estimated X_g, m; NaN without an estimate.
    pub x_m: f64,
    /// Estimated Y_g, m.
    pub y_m: f64,
    /// Estimated heading, rad.
    pub yaw_rad: f64,
    /// Estimated distance from the path, m, left positive; none without a path or an estimate.
    pub cross_track_m: Option<f64>,
    /// Arc length of the nearest point of the path, m; none without a path or an estimate.
    pub arc_length_m: Option<f64>,
    /// Time in the QP solver, us; NaN without a solution.
    pub solve_us: f64,
    /// Messages refused since the start.
    pub refused: u64,
    /// Cycles skipped since the start because earlier ones took too long.
    pub skipped: u64,
}

/// Where a thread leaves its records; never waits.
pub struct RecordSink<R> {
    ring: rtrb::Producer<R>,
    lost: Arc<AtomicU64>,
}

impl<R> RecordSink<R> {
    /// Leaves a record, or counts it as lost where the ring is full.
    pub fn push(&mut self, record: R) {
        if self.ring.push(record).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The reading end of a [`RecordSink`].
pub struct RecordSource<R> {
    ring: rtrb::Consumer<R>,
    lost: Arc<AtomicU64>,
}

impl<R> RecordSource<R> {
    /// Returns the oldest record that has been left.
    pub fn pop(&mut self) -> Option<R> {
        self.ring.pop().ok()
    }

    /// Returns the number of records that found the ring full.
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

/// Returns both ends of a ring for `capacity` records.
pub fn ring<R>(capacity: usize) -> (RecordSink<R>, RecordSource<R>) {
    let (producer, consumer) = rtrb::RingBuffer::new(capacity);
    let lost = Arc::new(AtomicU64::new(0));
    (
        RecordSink {
            ring: producer,
            lost: Arc::clone(&lost),
        },
        RecordSource {
            ring: consumer,
            lost,
        },
    )
}

/// A [`RecordSource`] of any kind of record.
pub trait LogSource {
    /// Appends everything that has been left, with its instant, s.
    fn drain(&mut self, into: &mut Vec<(f64, LogEntry)>);

    /// Returns the number of records that found their ring full.
    fn lost(&self) -> u64;
}

impl<R: Record> LogSource for RecordSource<R> {
    fn drain(&mut self, into: &mut Vec<(f64, LogEntry)>) {
        while let Ok(record) = self.ring.pop() {
            into.push((record.time_s(), record.entry()));
        }
    }

    fn lost(&self) -> u64 {
        Self::lost(self)
    }
}

/// Writes what several threads have left.
pub struct Recorder {
    sources: Vec<Box<dyn LogSource>>,
    epoch: Epoch,
    interface: String,
    batch: Vec<(f64, LogEntry)>,
    latest: Option<CycleRow>,
    /// Events that no thread has left.
    notes: Vec<(f64, LogEntry)>,
    actions: ActionWatch,
}

/// Takes an event.
pub type TakeEvent<'a> = dyn FnMut(&EventLine<'_>) + 'a;

/// Takes a cycle with its time of the world, s since 1970.
pub type TakeCycle<'a> = dyn FnMut(f64, &CycleRow) -> Result<(), Error> + 'a;

/// Takes an entry with its instant, s.
pub type TakeEntry<'a> = dyn FnMut(f64, &LogEntry) + 'a;

/// Where the recorder writes to; what is absent is not written.
#[derive(Default)]
pub struct Outputs<'a> {
    /// Messages as `candump -l` logs them.
    pub candump: Option<&'a mut dyn Write>,
    /// One JSON object a line for each event.
    pub events: Option<&'a mut dyn Write>,
    /// Takes each event.
    pub seen: Option<&'a mut TakeEvent<'a>>,
    /// Takes each cycle.
    pub cycles: Option<&'a mut TakeCycle<'a>>,
    /// Takes every entry, with its instant, s.
    pub all: Option<&'a mut TakeEntry<'a>>,
}

/// An event. The names of its fields are those of `events.jsonl`.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct EventLine<'a> {
    /// When, s since 1970.
    pub unix_s: f64,
    /// When, s since the start.
    pub time_s: f64,
    /// What, in one word.
    pub event: &'a str,
    /// The state before, of a transition.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub from: Option<SafetyState>,
    /// The state after.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub to: Option<SafetyState>,
    /// Details.
    pub reason: &'a str,
    /// Whether somebody should look at it.
    #[serde(skip)]
    pub warns: bool,
}

impl Recorder {
    /// Returns a recorder for these sources; `interface` is what the candump log names.
    pub fn new(sources: Vec<Box<dyn LogSource>>, epoch: Epoch, interface: &str) -> Self {
        Self {
            sources,
            epoch,
            interface: interface.to_owned(),
            batch: Vec::new(),
            latest: None,
            notes: Vec::new(),
            actions: ActionWatch::default(),
        }
    }

    /// Writes an event where the vehicle passes each of these actions of the controller's path.
    #[must_use]
    pub fn with_actions(mut self, actions: PendingActions) -> Self {
        self.actions = ActionWatch::new(actions);
        self
    }

    /// Adds an entry at `time_s` of the loop's time; the next [`Self::drain`] writes it.
    pub fn note(&mut self, time_s: f64, entry: LogEntry) {
        self.notes.push((time_s, entry));
    }

    /// Returns the newest cycle.
    pub fn latest(&self) -> Option<&CycleRow> {
        self.latest.as_ref()
    }

    /// Returns the number of records that found their ring full.
    pub fn lost(&self) -> u64 {
        self.sources.iter().map(|source| source.lost()).sum()
    }

    /// Adds the actions that the vehicle has passed to the batch, each after the cycle in which it did.
    fn add_actions(&mut self) {
        let mut passed = Vec::new();
        for (time_s, entry) in &self.batch {
            let actions = match entry {
                LogEntry::Cycle(row) => self.actions.cycle(row.state, row.arc_length_m),
                LogEntry::Event {
                    transition: Some(transition),
                    ..
                } if transition.reason == Reason::Finished => self.actions.finish(),
                _ => &[],
            };
            let event = |action: &RouteAction| LogEntry::event("action", action.text.clone());
            passed.extend(actions.iter().map(|action| (*time_s, event(action))));
        }
        if !passed.is_empty() {
            self.batch.append(&mut passed);
            self.batch.sort_by(|(a_s, _), (b_s, _)| a_s.total_cmp(b_s));
        }
    }

    /// Writes everything that has been left since the last call, in the order of time.
    ///
    /// # Errors
    /// The first output that cannot be written.
    pub fn drain(&mut self, outputs: &mut Outputs<'_>) -> Result<(), Error> {
        self.batch.clear();
        self.batch.append(&mut self.notes);
        for source in &mut self.sources {
            source.drain(&mut self.batch);
        }
        self.batch.sort_by(|(a_s, _), (b_s, _)| a_s.total_cmp(b_s));
        self.add_actions();
        for (time_s, entry) in &self.batch {
            let unix_s = self.epoch.unix_s(*time_s);
            if let Some(all) = &mut outputs.all {
                all(*time_s, entry);
            }
            match entry {
                LogEntry::Message(text) => {
                    if let Some(out) = &mut outputs.candump {
                        writeln!(out, "({unix_s:.6}) {} {text}", self.interface)?;
                    }
                }
                LogEntry::Cycle(row) => {
                    self.latest = Some(*row);
                    if let Some(take) = &mut outputs.cycles {
                        take(unix_s, row)?;
                    }
                }
                LogEntry::Event {
                    event,
                    transition,
                    reason,
                    warns,
                } => {
                    let line = EventLine {
                        unix_s,
                        time_s: *time_s,
                        event,
                        from: transition.map(|transition| transition.from),
                        to: transition.map(|transition| transition.to),
                        reason,
                        warns: *warns,
                    };
                    if let Some(take) = &mut outputs.seen {
                        take(&line);
                    }
                    if let Some(out) = &mut outputs.events {
                        serde_json::to_writer(&mut *out, &line)?;
                        writeln!(out)?;
                    }
                }
            }
        }
        Ok(())
    }
}
