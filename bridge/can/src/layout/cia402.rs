use super::builder::Builder;
use super::drives::{DriveCodec, DriveStates};
use super::error::LayoutError;
use crate::cia402::{Cia402, NodeId};
use crate::config::{Cia402Config, Cia402Drive, ObjectValue, Protection};
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
        let mut requests = Vec::new();
        for object in &drive.setup {
            requests.push(object.write(node).ok_or(LayoutError::Object {
                object: object.object,
                sub: object.sub,
                value: object.value,
            })?);
        }
        // Read when all is written: one object may change another.
        requests.extend(drive.setup.iter().filter_map(|object| object.check(node)));
        Ok::<_, LayoutError>(requests)
    };
    let is_set = |drive: &Cia402Drive, is: &dyn Fn(&ObjectValue) -> bool| {
        drive
            .setup
            .iter()
            .any(|object| is(object) && object.value != 0)
    };
    let deadline = |drive: &Cia402Drive| {
        is_set(drive, &ObjectValue::is_deadline) && is_set(drive, &|object| object.object == 0x6007)
    };
    let mode = |drive: &Cia402Drive| {
        let mut modes = drive.setup.iter().rev();
        let mode = modes.find(|object| object.object == 0x6060)?;
        Some(mode.value as u32 & 0xFF)
    };
    let cia402 = Cia402 {
        own: id(config.node_id)?,
        sync: config.sync,
        quick_stop_time_s: time_s("quick_stop_time_s", config.quick_stop_time_s)?,
        answer_time_s: time_s("answer_time_s", config.answer_time_s)?,
        nodes: [id(first.node_id)?, id(second.node_id)?],
        setup: [setup(first)?, setup(second)?],
        deadline: [deadline(first), deadline(second)],
        mode: [mode(first), mode(second)],
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
