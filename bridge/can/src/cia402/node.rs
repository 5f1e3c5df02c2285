use super::node_id::NodeId;
use super::power::PowerState;
use super::sdo::{self, SdoAnswer, SdoRequest};
use crate::frame::{Frame, FrameId};
use crate::message::{FrameFault, Quantity};
use serde::Serialize;
use sidehill_plant::sample::Stamped;
use std::fmt;

/// Identifier of the network management.
pub const NMT: FrameId = FrameId::Standard(0x000);
/// Identifier of SYNC.
pub const SYNC: FrameId = FrameId::Standard(0x080);

/// What the network management asks of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum NmtCommand {
    /// Exchange PDOs.
    Start = 0x01,
    /// Exchange nothing but heartbeats.
    Stop = 0x02,
    /// Exchange no PDOs.
    EnterPreOperational = 0x80,
}

impl NmtCommand {
    /// Returns its frame.
    pub fn frame(self, node: NodeId) -> Frame {
        Frame {
            id: NMT,
            length: 2,
            data: [self as u8, node.get(), 0, 0, 0, 0, 0, 0],
        }
    }
}

/// NMT state of a node, as its heartbeat has it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum NmtState {
    /// It has started this moment.
    BootUp,
    /// It exchanges nothing but heartbeats.
    Stopped,
    /// It exchanges PDOs.
    Operational,
    /// It exchanges no PDOs.
    PreOperational,
}

impl NmtState {
    /// Returns the state's byte in a heartbeat.
    pub fn byte(self) -> u8 {
        match self {
            Self::BootUp => 0x00,
            Self::Stopped => 0x04,
            Self::Operational => 0x05,
            Self::PreOperational => 0x7F,
        }
    }

    fn of(byte: u8) -> Option<Self> {
        let mut states = [
            Self::BootUp,
            Self::Stopped,
            Self::Operational,
            Self::PreOperational,
        ]
        .into_iter();
        states.find(|state| state.byte() == byte)
    }

    /// Returns the heartbeat of a node in the state.
    pub fn heartbeat(self, node: NodeId) -> Frame {
        Frame {
            id: node.heartbeat(),
            length: 1,
            data: [self.byte(), 0, 0, 0, 0, 0, 0, 0],
        }
    }
}

impl fmt::Display for NmtState {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::BootUp => "just started",
            Self::Stopped => "stopped",
            Self::Operational => "operational",
            Self::PreOperational => "pre-operational",
        })
    }
}

/// An emergency message of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Emergency {
    /// Error code; 0 for an error that is over.
    pub code: u16,
    /// Error register.
    pub register: u8,
}

impl Emergency {
    /// Returns its frame.
    pub fn frame(self, node: NodeId) -> Frame {
        let [low, high] = self.code.to_le_bytes();
        Frame {
            id: node.emergency(),
            length: 8,
            data: [low, high, self.register, 0, 0, 0, 0, 0],
        }
    }
}

/// Messages of a kind that are kept.
const KEPT: u32 = 8;

/// The newest of messages that come at any time, and how many have come: many more are kept than come in a cycle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Latest<T> {
    count: u32,
    /// Each in the place of its number.
    kept: [Option<T>; KEPT as usize],
}

impl<T: Copy> Latest<T> {
    /// Returns how many have come.
    pub fn count(&self) -> u32 {
        self.count
    }

    /// Returns those that came after the first `before`, as far as they are kept, the oldest first.
    pub fn since(&self, before: u32) -> impl Iterator<Item = T> + '_ {
        let new = self.count.wrapping_sub(before).min(KEPT);
        let numbers = (0..new).rev().map(|back| self.count.wrapping_sub(back));
        numbers.filter_map(|number| self.kept[(number % KEPT) as usize])
    }

    fn push(&mut self, message: T) {
        self.count = self.count.wrapping_add(1);
        self.kept[(self.count % KEPT) as usize] = Some(message);
    }
}

impl<T: Copy> Default for Latest<T> {
    fn default() -> Self {
        Self {
            count: 0,
            kept: [None; KEPT as usize],
        }
    }
}

/// The newest messages of a node other than its PDO. Those that come at any time are counted, so that
/// none is taken twice.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NodeReading {
    /// State of its power, by the newest PDO.
    pub power: Option<PowerState>,
    /// The statusword that says so.
    pub statusword: u16,
    /// State of the node.
    pub nmt: Option<Stamped<NmtState>>,
    /// How often it has started.
    pub boots: u32,
    /// Answers to objects that were written or read.
    pub answers: Latest<SdoAnswer>,
    /// Emergencies.
    pub emergencies: Latest<Emergency>,
}

impl NodeReading {
    /// Returns the answer to a request that was sent after the first `answers` of them.
    pub fn answer_to(&self, request: &SdoRequest, answers: u32) -> Option<SdoAnswer> {
        self.answers.since(answers).find(|answer| {
            // What another client reads is not the answer to a write.
            let fits = answer
                .result
                .is_ok_and(|read| read.is_some() == request.expected.is_some());
            (answer.object, answer.sub) == (request.object, request.sub)
                && (fits || answer.result.is_err())
        })
    }

    /// Takes a frame of the node that is not a PDO.
    ///
    /// # Errors
    /// Which check it failed. It then changes nothing.
    pub(crate) fn take(
        &mut self,
        node: NodeId,
        frame: &Frame,
        time_s: f64,
    ) -> Result<(), FrameFault> {
        let length = |expected| {
            if frame.length == expected {
                Ok(())
            } else {
                Err(FrameFault::Length {
                    found: frame.length,
                    expected,
                })
            }
        };
        if frame.id == node.heartbeat() {
            length(1)?;
            let byte = frame.data[0];
            let state = NmtState::of(byte).ok_or(FrameFault::State {
                quantity: Quantity::NodeState,
                value: f64::from(byte),
            })?;
            if state == NmtState::BootUp {
                self.boots = self.boots.wrapping_add(1);
            }
            self.nmt = Some(Stamped {
                time_s,
                value: state,
            });
        } else if frame.id == node.answer() {
            length(8)?;
            // Segments of another client are ignored.
            if let Some(answer) = sdo::answer(frame) {
                self.answers.push(answer);
            }
        } else if frame.id == node.emergency() {
            length(8)?;
            self.emergencies.push(Emergency {
                code: u16::from_le_bytes([frame.data[0], frame.data[1]]),
                register: frame.data[2],
            });
        }
        Ok(())
    }
}
