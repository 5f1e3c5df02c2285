//! From the cycle to files without waiting: bounded rings of plain values, and who writes them.

use crate::bus::{RestartAnswer, SendFault};
use crate::can::cia402::DriveEvent;
use crate::can::frame::Frame;
use crate::can::message::FrameFault;
use crate::clock::Epoch;
use crate::safety::{BusState, State, Transition};
use serde::Serialize;
use std::io::{Error, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Something worth keeping; a plain value, so that keeping it costs a copy.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Record {
    /// A frame on the bus.
    Frame {
        /// When, s.
        time_s: f64,
        /// Whether this program sent it.
        sent: bool,
        /// The frame.
        frame: Frame,
    },
    /// A frame that is not believed.
    Refused {
        /// When, s.
        time_s: f64,
        /// The frame.
        frame: Frame,
        /// Why.
        fault: FrameFault,
    },
    /// The state of the bus has changed.
    Bus {
        /// When, s.
        time_s: f64,
        /// To what.
        state: BusState,
    },
    /// A restart after a bus-off was tried.
    Restart {
        /// When, s.
        time_s: f64,
        /// How many were tried.
        attempt: u32,
        /// The system's answer.
        answer: RestartAnswer,
    },
    /// Something about a drive that speaks CANopen.
    Drive {
        /// When, s.
        time_s: f64,
        /// Its node number.
        node: u8,
        /// What.
        event: DriveEvent,
    },
    /// A command could not be sent, where the one before could.
    Unsent {
        /// When, s.
        time_s: f64,
        /// Why.
        fault: SendFault,
    },
    /// The safety changed its state.
    Transition(Transition),
    /// A cycle.
    Cycle(CycleRow),
}

/// One cycle of the bridge.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CycleRow {
    /// Time for which the cycle was due, s.
    pub time_s: f64,
    /// How much later it began, s.
    pub lateness_s: f64,
    /// What was left of the period when it ended, s.
    pub slack_s: f64,
    /// State of the safety.
    pub state: State,
    /// Whether the drives were told to be on.
    pub enable: bool,
    /// Traction told, m/s.
    pub traction_m_s: f64,
    /// Steer told, m/s.
    pub steer_m_s: f64,
    /// Whether it could be sent.
    pub sent: bool,
    /// Traction fed back, m/s; NaN without feedback.
    pub feedback_traction_m_s: f64,
    /// Steer fed back, m/s; NaN without feedback.
    pub feedback_steer_m_s: f64,
    /// Age of the feedback, s; infinite without.
    pub feedback_age_s: f64,
    /// State of the bus.
    pub bus: BusState,
    /// Estimated X_g, m; NaN without an estimate.
    pub x_m: f64,
    /// Estimated Y_g, m.
    pub y_m: f64,
    /// Estimated heading, rad.
    pub yaw_rad: f64,
    /// Estimated distance from the path, m, left positive; none without a path or an estimate.
    pub cross_track_m: Option<f64>,
    /// Time within the QP solver, us; NaN without a solution.
    pub solve_us: f64,
    /// Frames refused since the start.
    pub refused: u64,
    /// Cycles left out since the start because those before took too long.
    pub skipped: u64,
}

/// Where a thread leaves its records; never waits.
pub struct RecordSink {
    ring: rtrb::Producer<Record>,
    lost: Arc<AtomicU64>,
}

impl RecordSink {
    /// Leaves a record, or counts it as lost where the ring is full.
    pub fn push(&mut self, record: Record) {
        if self.ring.push(record).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// The other end of a [`RecordSink`].
pub struct RecordSource {
    ring: rtrb::Consumer<Record>,
    lost: Arc<AtomicU64>,
}

/// Returns both ends of a ring for `capacity` records.
pub fn ring(capacity: usize) -> (RecordSink, RecordSource) {
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

/// Writes what several threads have left.
pub struct Recorder {
    sources: Vec<RecordSource>,
    epoch: Epoch,
    interface: String,
    batch: Vec<Record>,
    latest: Option<CycleRow>,
}

/// Takes a cycle with its time of the world, s since 1970.
pub type TakeCycle<'a> = dyn FnMut(f64, &CycleRow) -> Result<(), Error> + 'a;

/// Where the recorder writes to; what is absent is not written.
#[derive(Default)]
pub struct Outputs<'a> {
    /// Frames as `candump -l` logs them.
    pub candump: Option<&'a mut dyn Write>,
    /// One JSON object a line for everything that is no frame and no cycle.
    pub events: Option<&'a mut dyn Write>,
    /// Takes each cycle.
    pub cycles: Option<&'a mut TakeCycle<'a>>,
}

#[derive(Serialize)]
struct EventLine<'a> {
    unix_s: f64,
    time_s: f64,
    event: &'a str,
    #[serde(skip_serializing_if = "Option::is_none")]
    from: Option<State>,
    #[serde(skip_serializing_if = "Option::is_none")]
    to: Option<State>,
    reason: String,
}

impl Recorder {
    /// Returns a recorder for these sources; `interface` is what the candump log names.
    pub fn new(sources: Vec<RecordSource>, epoch: Epoch, interface: &str) -> Self {
        Self {
            sources,
            epoch,
            interface: interface.to_owned(),
            batch: Vec::new(),
            latest: None,
        }
    }

    /// Returns the newest cycle.
    pub fn latest(&self) -> Option<&CycleRow> {
        self.latest.as_ref()
    }

    /// Returns the number of records that found their ring full.
    pub fn lost(&self) -> u64 {
        let lost = |source: &RecordSource| source.lost.load(Ordering::Relaxed);
        self.sources.iter().map(lost).sum()
    }

    /// Writes everything that has been left since the last call, in the order of time.
    ///
    /// # Errors
    /// The first output that cannot be written.
    pub fn drain(&mut self, outputs: &mut Outputs<'_>) -> Result<(), Error> {
        self.batch.clear();
        for source in &mut self.sources {
            while let Ok(record) = source.ring.pop() {
                self.batch.push(record);
            }
        }
        self.batch.sort_by(|a, b| time_of(a).total_cmp(&time_of(b)));
        for record in &self.batch {
            let time_s = time_of(record);
            let unix_s = self.epoch.unix_s(time_s);
            match record {
                Record::Frame { frame, .. } => {
                    if let Some(out) = &mut outputs.candump {
                        writeln!(out, "({unix_s:.6}) {} {frame}", self.interface)?;
                    }
                }
                Record::Cycle(row) => {
                    self.latest = Some(*row);
                    if let Some(take) = &mut outputs.cycles {
                        take(unix_s, row)?;
                    }
                }
                other => {
                    if let Some(out) = &mut outputs.events {
                        let line = event_line(other, unix_s, time_s);
                        serde_json::to_writer(&mut *out, &line)?;
                        writeln!(out)?;
                    }
                }
            }
        }
        Ok(())
    }
}

fn time_of(record: &Record) -> f64 {
    match record {
        Record::Frame { time_s, .. }
        | Record::Refused { time_s, .. }
        | Record::Bus { time_s, .. }
        | Record::Restart { time_s, .. }
        | Record::Drive { time_s, .. }
        | Record::Unsent { time_s, .. }
        | Record::Transition(Transition { time_s, .. })
        | Record::Cycle(CycleRow { time_s, .. }) => *time_s,
    }
}

fn event_line(record: &Record, unix_s: f64, time_s: f64) -> EventLine<'_> {
    let (mut from, mut to) = (None, None);
    let (event, reason) = match record {
        Record::Transition(transition) => {
            (from, to) = (Some(transition.from), Some(transition.to));
            ("state", transition.reason.to_string())
        }
        Record::Refused { frame, fault, .. } => ("refused", format!("{frame}: {fault}")),
        Record::Bus { state, .. } => ("bus", format!("{state:?}")),
        Record::Restart {
            attempt, answer, ..
        } => ("restart", format!("attempt {attempt}: {answer:?}")),
        Record::Drive { node, event, .. } => ("drive", format!("node {node}: {event}")),
        Record::Unsent { fault, .. } => ("unsent", fault.to_string()),
        Record::Frame { .. } | Record::Cycle(_) => ("", String::new()),
    };
    EventLine {
        unix_s,
        time_s,
        event,
        from,
        to,
        reason,
    }
}
