//! Whether a layout fits a drive.

use super::{Eds, EdsObject};
use crate::config::{Cia402Drive, ObjectType};
use crate::frame::FrameId;
use crate::message::{MessageCodec, Quantity};
use crate::signal::BitOrder;
use std::collections::BTreeMap;

/// A PDO of a drive.
struct Pdo<'a> {
    name: &'static str,
    /// First index of the communication and of the mapping parameters.
    parameters: [u16; 2],
    message: &'a MessageCodec,
    /// What it carries: object, name, quantity.
    carries: [(u16, &'static str, Quantity); 2],
}

/// PDOs that a drive may have.
const PDOS: u16 = 512;

impl Eds {
    /// Returns what of a drive's layout this data sheet does not allow. `command` and `feedback` are its messages.
    pub fn complaints(
        &self,
        drive: &Cia402Drive,
        command: &MessageCodec,
        feedback: &MessageCodec,
    ) -> Vec<String> {
        let mut complaints = Vec::new();
        // As they are after the setup.
        let stored = self.objects.iter();
        let mut values: BTreeMap<(u16, u8), i64> = stored
            .filter_map(|(address, object)| Some((*address, object.value?)))
            .collect();
        for object in &drive.setup {
            let address = (object.object, object.sub);
            values.insert(address, object.value);
            let fault = match self.objects.get(&address) {
                None => Some(
                    "is not there: take it out of the setup, or write what the drive has in its place"
                        .to_owned(),
                ),
                Some(found) => found.fault(object.kind, object.value),
            };
            let (index, sub) = address;
            complaints.extend(fault.map(|fault| {
                let value = object.value;
                format!("object 0x{index:04X}:{sub:02X} of the setup, to be {value}, {fault}")
            }));
        }
        complaints.extend(mode_fault(&values));
        let pdos = [
            Pdo {
                name: "RPDO",
                parameters: [0x1400, 0x1600],
                message: command,
                carries: [
                    (0x6040, "controlword", Quantity::Controlword),
                    (0x60FF, "target velocity", Quantity::Command(drive.role)),
                ],
            },
            Pdo {
                name: "TPDO",
                parameters: [0x1800, 0x1A00],
                message: feedback,
                carries: [
                    (0x6041, "statusword", Quantity::DriveState),
                    (0x606C, "actual velocity", Quantity::Speed(drive.role)),
                ],
            },
        ];
        for pdo in &pdos {
            complaints.extend(self.pdo_faults(pdo, &values));
        }
        complaints
    }

    fn pdo_faults(&self, pdo: &Pdo<'_>, values: &BTreeMap<(u16, u8), i64>) -> Vec<String> {
        let mut faults = Vec::new();
        for (index, name, _) in pdo.carries {
            match self.objects.get(&(index, 0)) {
                None => faults.push(format!(
                    "object 0x{index:04X}, {name}, is not there: this is no drive of CiA 402 in a velocity mode"
                )),
                Some(object) if !object.mappable => {
                    faults.push(format!("object 0x{index:04X}, {name}, cannot be mapped to a PDO"));
                }
                Some(_) => {}
            }
        }
        let [communication, mapping] = pdo.parameters;
        let used = (0..PDOS).filter_map(|number| {
            let identifier = *values.get(&(communication + number, 1))?;
            Some((number, identifier_of(identifier)?))
        });
        let used: Vec<_> = used.collect();
        let (message, id) = (pdo.message.name(), pdo.message.id());
        let Some((number, _)) = used.iter().find(|(_, used)| *used == id) else {
            if !used.is_empty() {
                let ids: Vec<_> = used.iter().map(|(_, id)| id.to_string()).collect();
                faults.push(format!(
                    "no {} has the identifier {id} of message {message}, they have {}: change the message in the database, or \
                     write object 0x{communication:04X}:01 in the setup",
                    pdo.name,
                    ids.join(", ")
                ));
            }
            return faults;
        };
        let map = mapping + number;
        // Without a default the mapping is not known.
        let Some(count) = values.get(&(map, 0)).filter(|count| **count > 0) else {
            return faults;
        };
        let mut bit = 0;
        let mut mapped = BTreeMap::new();
        for sub in 1..=(*count).min(64) as u8 {
            let Some(entry) = values.get(&(map, sub)) else {
                return faults;
            };
            let bits = (entry & 0xFF) as usize;
            mapped.insert((entry >> 16) as u16, (bit, bits));
            bit += bits;
        }
        for (index, name, quantity) in pdo.carries {
            let Some(field) = pdo.message.fields().iter().find(|f| f.quantity == quantity) else {
                continue;
            };
            let codec = &field.codec;
            let found = (codec.start_bit, codec.bits);
            let fault = match mapped.get(&index) {
                None => format!("does not map 0x{index:04X}, {name}"),
                Some(place)
                    if *place != found || (codec.order != BitOrder::Intel && found.1 > 8) =>
                {
                    format!(
                        "has 0x{index:04X}, {name}, from bit {} on, {} bits, little endian; the signal of message {message} begins \
                         at bit {}, {} bits",
                        place.0, place.1, found.0, found.1
                    )
                }
                Some(_) => continue,
            };
            faults.push(format!(
                "{} 0x{map:04X} {fault}: change the database, or write the mapping in the setup",
                pdo.name
            ));
        }
        faults
    }
}

impl EdsObject {
    /// Returns why a value of a type cannot be written.
    fn fault(&self, kind: ObjectType, value: i64) -> Option<String> {
        if !self.writable {
            return Some("can only be read: take it out of the setup".to_owned());
        }
        if self.kind != Some(kind) {
            let is = match self.kind {
                Some(kind) => format!("has type {}", name(kind)),
                None => "has a type that no setup can write".to_owned(),
            };
            return Some(format!("{is}, not {}", name(kind)));
        }
        let [low, high] = self.limits;
        let is_low = low.is_some_and(|low| value < low);
        let is_high = high.is_some_and(|high| value > high);
        let limit = |limit: Option<i64>| limit.map_or("any".to_owned(), |limit| limit.to_string());
        (is_low || is_high)
            .then(|| format!("is out of the range from {} to {}", limit(low), limit(high)))
    }
}

/// Returns why the mode of operation is not possible, by those that the drive supports.
fn mode_fault(values: &BTreeMap<(u16, u8), i64>) -> Option<String> {
    let mode = *values.get(&(0x6060, 0))?;
    let supported = *values.get(&(0x6502, 0))?;
    let has = |mode: i64| (1..=32).contains(&mode) && supported >> (mode - 1) & 1 == 1;
    (mode > 0 && supported != 0 && !has(mode)).then(|| {
        let modes = (1..=32).filter(|mode| has(*mode));
        let modes: Vec<_> = modes.map(|mode| mode.to_string()).collect();
        format!(
            "object 0x6060 is to be mode {mode}, and object 0x6502 has modes {}: 3 and 9 follow a velocity",
            modes.join(", ")
        )
    })
}

/// Returns the identifier of a PDO; none for one that is switched off.
fn identifier_of(value: i64) -> Option<FrameId> {
    const OFF: i64 = 1 << 31;
    const EXTENDED: i64 = 1 << 29;
    if value & OFF != 0 || value & 0x1FFF_FFFF == 0 {
        return None;
    }
    Some(match value & EXTENDED {
        0 => FrameId::Standard((value & 0x7FF) as u16),
        _ => FrameId::Extended((value & 0x1FFF_FFFF) as u32),
    })
}

fn name(kind: ObjectType) -> &'static str {
    match kind {
        ObjectType::U8 => "u8",
        ObjectType::U16 => "u16",
        ObjectType::U32 => "u32",
        ObjectType::I8 => "i8",
        ObjectType::I16 => "i16",
        ObjectType::I32 => "i32",
    }
}
