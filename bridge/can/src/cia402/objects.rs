//! The object dictionary of a virtual drive, and its answers to SDO uploads and downloads.

use super::node::Emergency;
use super::node_id::NodeId;
use crate::config::ObjectType;
use crate::frame::Frame;
use std::collections::BTreeMap;

/// Index and subindex.
pub(crate) type Address = (u16, u8);

/// Consumer heartbeat: node and time in ms that it may be silent.
pub(crate) const CONSUMER: Address = (0x1016, 1);
/// Time between heartbeats, ms.
pub(crate) const PRODUCER: Address = (0x1017, 0);
/// How long an RPDO may be missing after the first, ms.
pub(crate) const RPDO_TIMER: Address = (0x1400, 5);
/// When the TPDO is sent: 1 to 240 with so many SYNCs, else by its timer.
pub(crate) const TPDO_TYPE: Address = (0x1800, 2);
/// Time between TPDOs, ms.
pub(crate) const TPDO_TIMER: Address = (0x1800, 5);
/// What a drive does that is on where its master falls silent.
pub(crate) const ABORT_OPTION: Address = (0x6007, 0);
/// The state.
pub(crate) const STATUSWORD: Address = (0x6041, 0);
/// How it stops quickly.
pub(crate) const QUICK_STOP_OPTION: Address = (0x605A, 0);
/// What it follows.
pub(crate) const MODE: Address = (0x6060, 0);
/// The same, to be read.
const MODE_DISPLAY: Address = (0x6061, 0);
/// Position by its encoder, counts.
pub(crate) const POSITION: Address = (0x6064, 0);
/// Counts in a turn of the motor, as the drive is told.
pub(crate) const RESOLUTION: Address = (0x608F, 1);
/// Counts that a turn of the motor has in truth.
pub(crate) const COUNTS_PER_TURN: u32 = 4096;
/// Error register.
const ERROR_REGISTER: Address = (0x1001, 0);
/// How many errors there were, as far as they are kept; the newest is the first.
const ERRORS: Address = (0x1003, 0);
/// The newest of them.
const ERROR_CODE: Address = (0x603F, 0);
/// Most errors that are kept.
const ERRORS_MAX: u8 = 4;

/// Abort codes of CiA 301.
mod abort {
    pub(crate) const COMMAND: u32 = 0x0504_0001;
    pub(crate) const READ_ONLY: u32 = 0x0601_0002;
    pub(crate) const NO_OBJECT: u32 = 0x0602_0000;
    pub(crate) const TYPE: u32 = 0x0607_0010;
    pub(crate) const NO_SUBINDEX: u32 = 0x0609_0011;
    pub(crate) const VALUE: u32 = 0x0609_0030;
}

/// Type, value at the start, and whether it can be written. Speeds are in the PDOs alone, whose
/// mapping is that of the database, whatever a client writes here.
const OBJECTS: [(Address, ObjectType, u32, bool); 41] = {
    use ObjectType::{I8, I16, I32, U8, U16, U32};
    [
        // A servo drive of CiA 402.
        ((0x1000, 0), U32, 0x0002_0192, false),
        (ERROR_REGISTER, U8, 0, false),
        (ERRORS, U8, 0, true),
        ((0x1003, 1), U32, 0, false),
        ((0x1003, 2), U32, 0, false),
        ((0x1003, 3), U32, 0, false),
        ((0x1003, 4), U32, 0, false),
        ((0x1016, 0), U8, 1, false),
        (CONSUMER, U32, 0, true),
        (PRODUCER, U16, 0, true),
        ((0x1018, 0), U8, 4, false),
        // Nobody's vendor number.
        ((0x1018, 1), U32, 0, false),
        ((0x1018, 2), U32, 402, false),
        ((0x1018, 3), U32, 0x0001_0000, false),
        ((0x1018, 4), U32, 1, false),
        ((0x1400, 0), U8, 5, false),
        ((0x1400, 1), U32, 0, true),
        ((0x1400, 2), U8, 255, true),
        (RPDO_TIMER, U16, 0, true),
        ((0x1600, 0), U8, 2, true),
        ((0x1600, 1), U32, 0x6040_0010, true),
        ((0x1600, 2), U32, 0x60FF_0020, true),
        ((0x1800, 0), U8, 5, false),
        ((0x1800, 1), U32, 0, true),
        (TPDO_TYPE, U8, 255, true),
        ((0x1800, 3), U16, 0, true),
        (TPDO_TIMER, U16, 0, true),
        ((0x1A00, 0), U8, 2, true),
        ((0x1A00, 1), U32, 0x6041_0010, true),
        ((0x1A00, 2), U32, 0x606C_0020, true),
        (ABORT_OPTION, I16, 0, true),
        (ERROR_CODE, U16, 0, false),
        (STATUSWORD, U16, 0, false),
        (QUICK_STOP_OPTION, I16, 2, true),
        (MODE, I8, 0, true),
        (MODE_DISPLAY, I8, 0, false),
        (POSITION, I32, 0, false),
        ((0x608F, 0), U8, 2, false),
        (RESOLUTION, U32, COUNTS_PER_TURN, true),
        ((0x608F, 2), U32, 1, false),
        // Profile velocity and cyclic synchronous velocity.
        ((0x6502, 0), U32, 0x104, false),
    ]
};

/// What a virtual drive has stored.
#[derive(Debug, Clone)]
pub(crate) struct Objects(BTreeMap<Address, u32>);

impl Objects {
    /// Returns the objects as a drive has them at its start.
    pub(crate) fn new() -> Self {
        Self(OBJECTS.iter().map(|entry| (entry.0, entry.2)).collect())
    }

    /// Returns an object's bits; 0 for one that there is not.
    pub(crate) fn get(&self, address: Address) -> u32 {
        self.0.get(&address).copied().unwrap_or(0)
    }

    /// Sets an object that the drive itself changes.
    pub(crate) fn set(&mut self, address: Address, bits: u32) {
        self.0.insert(address, bits);
    }

    /// Keeps an error, or its end, which has code 0.
    pub(crate) fn keep_error(&mut self, emergency: &Emergency) {
        self.set(ERROR_REGISTER, u32::from(emergency.register));
        self.set(ERROR_CODE, u32::from(emergency.code));
        if emergency.code == 0 {
            return;
        }
        for sub in (1..ERRORS_MAX).rev() {
            self.set((ERRORS.0, sub + 1), self.get((ERRORS.0, sub)));
        }
        self.set((ERRORS.0, 1), u32::from(emergency.code));
        let count = self.get(ERRORS) + 1;
        self.set(ERRORS, count.min(u32::from(ERRORS_MAX)));
    }

    /// Returns the answer to a request of eight bytes; none to an abort.
    pub(crate) fn answer(&mut self, node: NodeId, request: &Frame) -> Option<Frame> {
        let [command, low, high, sub, value @ ..] = request.data;
        let address = (u16::from_le_bytes([low, high]), sub);
        let done = match command >> 5 {
            1 => self
                .write(address, command, u32::from_le_bytes(value))
                .map(|()| (0x60, 0)),
            2 => self.read(address),
            4 => return None,
            _ => Err(abort::COMMAND),
        };
        let (kind, bits) = done.unwrap_or_else(|code| (0x80, code));
        let [a, b, c, d] = bits.to_le_bytes();
        Some(Frame {
            id: node.answer(),
            length: 8,
            data: [kind, low, high, sub, a, b, c, d],
        })
    }

    /// Returns the command byte and the bits of an object, an expedited upload.
    fn read(&self, address: Address) -> Result<(u8, u32), u32> {
        let (_, kind, ..) = entry(address)?;
        Ok((0x43 | (4 - bytes(kind)) << 2, self.get(address)))
    }

    fn write(&mut self, address: Address, command: u8, bits: u32) -> Result<(), u32> {
        const EXPEDITED: u8 = 2;
        const SIZED: u8 = 1;
        let (_, kind, _, writable) = entry(address)?;
        if !writable {
            return Err(abort::READ_ONLY);
        }
        if command & EXPEDITED == 0 {
            return Err(abort::COMMAND);
        }
        if command & SIZED != 0 && 4 - (command >> 2 & 3) != bytes(kind) {
            return Err(abort::TYPE);
        }
        let bits = match bytes(kind) {
            1 => bits & 0xFF,
            2 => bits & 0xFFFF,
            _ => bits,
        };
        let allowed: &[u32] = match address {
            MODE => &[0, 3, 9],
            QUICK_STOP_OPTION => &[0, 1, 2, 5, 6],
            ABORT_OPTION => &[0, 1, 2, 3],
            // It clears them.
            ERRORS => &[0],
            _ => &[],
        };
        if !allowed.is_empty() && !allowed.contains(&bits) {
            return Err(abort::VALUE);
        }
        self.set(address, bits);
        if address == MODE {
            self.set(MODE_DISPLAY, bits);
        }
        Ok(())
    }
}

fn entry(address: Address) -> Result<(Address, ObjectType, u32, bool), u32> {
    let found = OBJECTS.iter().find(|entry| entry.0 == address);
    found.copied().ok_or_else(|| {
        if OBJECTS.iter().any(|entry| entry.0.0 == address.0) {
            abort::NO_SUBINDEX
        } else {
            abort::NO_OBJECT
        }
    })
}

fn bytes(kind: ObjectType) -> u8 {
    match kind {
        ObjectType::U8 | ObjectType::I8 => 1,
        ObjectType::U16 | ObjectType::I16 => 2,
        ObjectType::U32 | ObjectType::I32 => 4,
    }
}
