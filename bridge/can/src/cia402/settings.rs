use super::node::{NMT, SYNC};
use super::node_id::NodeId;
use super::sdo::SdoRequest;
use crate::frame::FrameId;

/// What a layout of CiA 402 has besides its messages.
#[derive(Debug, Clone, PartialEq)]
pub struct Cia402 {
    /// This program's node.
    pub own: NodeId,
    /// Whether a SYNC follows the commands.
    pub sync: bool,
    /// Time of a quick stop, s.
    pub quick_stop_time_s: f64,
    /// Longest wait for an answer, s.
    pub answer_time_s: f64,
    /// The drives' nodes, in the order of the layout.
    pub nodes: [NodeId; 2],
    /// What is written to each drive and read back.
    pub setup: [Vec<SdoRequest>; 2],
    /// Whether the setup gives the drive a deadline for its commands, and what it does then.
    pub deadline: [bool; 2],
    /// Mode of operation that the setup gives each drive, as its display has it.
    pub mode: [Option<u32>; 2],
}

impl Cia402 {
    /// Returns the identifiers that no PDO may have.
    pub(crate) fn service_ids(&self) -> Vec<FrameId> {
        let mut ids = vec![NMT, SYNC, self.own.heartbeat()];
        for node in self.nodes {
            ids.extend(node.received_ids());
            ids.push(node.request());
        }
        ids
    }
}
