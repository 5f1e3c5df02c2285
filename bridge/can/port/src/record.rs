use super::bus_monitor::RestartAnswer;
use sidehill_bridge::control_loop::record::{LogEntry, Record};
use sidehill_bridge::drives::LinkState;
use sidehill_can::cia402::DriveEvent;
use sidehill_can::frame::Frame;
use sidehill_can::message::FrameFault;

/// What the CAN port leaves for the log.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CanRecord {
    /// A frame on the bus, sent or received.
    Frame {
        /// When, s.
        time_s: f64,
        /// The frame.
        frame: Frame,
    },
    /// A received frame that failed a check.
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
        state: LinkState,
    },
    /// Another node sends with an identifier of this program, for the first time or again.
    Foreign {
        /// When, s.
        time_s: f64,
        /// Its newest frame.
        frame: Frame,
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
    /// News of a CANopen drive.
    Drive {
        /// When, s.
        time_s: f64,
        /// Its node number.
        node: u8,
        /// What.
        event: DriveEvent,
    },
}

impl Record for CanRecord {
    fn time_s(&self) -> f64 {
        match self {
            Self::Frame { time_s, .. }
            | Self::Refused { time_s, .. }
            | Self::Bus { time_s, .. }
            | Self::Foreign { time_s, .. }
            | Self::Restart { time_s, .. }
            | Self::Drive { time_s, .. } => *time_s,
        }
    }

    fn entry(&self) -> LogEntry {
        let (event, reason) = match self {
            Self::Frame { frame, .. } => return LogEntry::Message(frame.to_string()),
            Self::Refused { frame, fault, .. } => ("refused", format!("{frame}: {fault}")),
            Self::Bus { state, .. } => ("bus", format!("{state:?}")),
            Self::Foreign { frame, .. } => (
                "foreign",
                format!("{frame}: another node sends with an identifier of this program"),
            ),
            Self::Restart {
                attempt, answer, ..
            } => ("restart", format!("attempt {attempt}: {answer:?}")),
            Self::Drive { node, event, .. } => ("drive", format!("node {node}: {event}")),
        };
        let warns = match self {
            Self::Refused { .. } | Self::Foreign { .. } | Self::Restart { .. } => true,
            Self::Bus { state, .. } => !state.carries(),
            Self::Frame { .. } | Self::Drive { .. } => false,
        };
        match warns {
            true => LogEntry::warning(event, reason),
            false => LogEntry::event(event, reason),
        }
    }
}
