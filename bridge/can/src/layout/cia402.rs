use super::builder::Builder;
use super::drives::{DriveCodec, DriveStates};
use super::error::LayoutError;
use crate::cia402::{Cia402, NodeId};
use crate::config::{Cia402Config, Cia402Drive, Protection};
use crate::database::Database;
use crate::message::{DriveRole, MessageCodec, Quantity};
use sidehill_plant::bounds::Bounds;

/// Returns the command messages, the feedback and the settings of two CiA 402 drives.
pub(super) fn layout(
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
    let time_s = |key, value_s| {
        let checked = Bounds::new(0.05, 10.0, "s").check(key, value_s);
        checked.map_err(LayoutError::Cia402)
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
        quick_stop_time_s: time_s("quick_stop_time_s", config.quick_stop_time_s)?,
        answer_time_s: time_s("answer_time_s", config.answer_time_s)?,
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
