//! Drives that speak CANopen with the profile CiA 402, in a velocity mode.
//!
//! No crate is used: those there are cover CiA 301 with object dictionaries, block transfers and
//! runtimes of their own, are young, and leave CiA 402 to the user; what is needed of CiA 301 here
//! is four kinds of frames.

mod config;
mod drive;
mod master;
mod node;
mod objects;
mod power;
mod sdo;

pub use config::{Cia402Config, Cia402Drive, CommandPdo, FeedbackPdo, ObjectType, ObjectValue};
pub use drive::VirtualDrives;
pub use master::{DriveEvent, Master};
pub use node::{Emergency, NmtCommand, NmtState, NodeId, NodeReading};
pub use power::{Controlword, PowerState};
pub use sdo::{SdoAnswer, SetupFault};

use super::config::Protection;
use super::database::Database;
use super::frame::{Frame, FrameId};
use super::layout::{Builder, DriveCodec, DriveStates, LayoutError};
use super::message::{DriveRole, MessageCodec, Quantity};
use sidehill_plant::vehicle::RangeError;

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
    /// What is written to each drive, with its frame.
    pub setup: [Vec<(ObjectValue, Frame)>; 2],
}

impl NodeId {
    /// Returns the identifiers, apart from PDOs, that this program listens to.
    pub(in crate::can) fn heard_ids(self) -> [FrameId; 3] {
        [self.heartbeat(), self.answer(), self.emergency()]
    }
}

impl Cia402 {
    /// Returns the identifiers that no PDO may have.
    pub(in crate::can) fn service_ids(&self) -> Vec<FrameId> {
        let mut ids = vec![node::NMT, node::SYNC, self.own.heartbeat()];
        for node in self.nodes {
            ids.extend(node.heard_ids());
            ids.push(node.request());
        }
        ids
    }
}

/// Returns what is sent and heard, and the rest, of two drives.
pub(in crate::can) fn layout(
    config: &Cia402Config,
    database: &Database,
) -> Result<(Vec<MessageCodec>, [DriveCodec; 2], Cia402), LayoutError> {
    use DriveRole::{Left, Right, Steer, Traction};
    let [first, second] = &config.drives;
    if !matches!((first.role, second.role), (Traction, Steer) | (Left, Right)) {
        return Err(LayoutError::Roles);
    }
    let mut numbers = Vec::new();
    for node in [config.node_id, first.node_id, second.node_id] {
        if NodeId::new(node).is_none() || numbers.contains(&node) {
            return Err(LayoutError::Node { node });
        }
        numbers.push(node);
    }
    let id = |node| NodeId::new(node).ok_or(LayoutError::Node { node });
    let range = |key, value, low, range| {
        RangeError::check(key, value, low, 10.0, range).map_err(LayoutError::Cia402)
    };
    let setup = |drive: &Cia402Drive| {
        let node = id(drive.node_id)?;
        let frames = drive.setup.iter().map(|object| {
            let frame = object.request(node).ok_or(LayoutError::Object {
                object: object.object,
                sub: object.sub,
                value: object.value,
            })?;
            Ok((*object, frame))
        });
        frames.collect::<Result<Vec<_>, LayoutError>>()
    };
    let cia402 = Cia402 {
        own: id(config.node_id)?,
        sync: config.sync,
        quick_stop_time_s: range(
            "quick_stop_time_s",
            config.quick_stop_time_s,
            0.05,
            "from 0.05 to 10 s",
        )?,
        answer_time_s: range(
            "answer_time_s",
            config.answer_time_s,
            0.05,
            "from 0.05 to 10 s",
        )?,
        nodes: [id(first.node_id)?, id(second.node_id)?],
        setup: [setup(first)?, setup(second)?],
    };
    let commands = vec![command(database, first)?, command(database, second)?];
    let drives = [feedback(database, first)?, feedback(database, second)?];
    Ok((commands, drives, cia402))
}

fn command(database: &Database, drive: &Cia402Drive) -> Result<MessageCodec, LayoutError> {
    let pdo = &drive.command;
    Builder::new(database, &pdo.message)?
        .word(Quantity::Controlword, &pdo.controlword)?
        .scaled(Quantity::Command(drive.role), &pdo.target_velocity)?
        .finish(&Protection::default())
}

fn feedback(database: &Database, drive: &Cia402Drive) -> Result<DriveCodec, LayoutError> {
    let pdo = &drive.feedback;
    let message = Builder::new(database, &pdo.message)?
        .scaled(Quantity::Speed(drive.role), &pdo.actual_velocity)?
        .word(Quantity::DriveState, &pdo.statusword)?
        .finish(&Protection::default())?;
    Ok(DriveCodec {
        role: drive.role,
        message,
        states: DriveStates::Statusword,
    })
}

#[cfg(test)]
mod tests;
