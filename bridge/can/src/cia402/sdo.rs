use super::node_id::NodeId;
use crate::config::{ObjectType, ObjectValue};
use crate::frame::Frame;

/// An object that is written to a drive or read from it, in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoRequest {
    /// Index.
    pub object: u16,
    /// Subindex.
    pub sub: u8,
    /// What is sent.
    pub frame: Frame,
    /// The bits that must be read; none where it is written.
    pub expected: Option<u32>,
}

impl SdoRequest {
    /// Returns the request to read an object, an expedited upload.
    pub fn read(node: NodeId, object: u16, sub: u8, expected: u32) -> Self {
        let [low, high] = object.to_le_bytes();
        Self {
            object,
            sub,
            frame: Frame {
                id: node.request(),
                length: 8,
                data: [0x40, low, high, sub, 0, 0, 0, 0],
            },
            expected: Some(expected),
        }
    }
}

/// A node's answer to an object that was written or read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SdoAnswer {
    /// Index.
    pub object: u16,
    /// Subindex.
    pub sub: u8,
    /// The bits that were read, none if it was written; or the abort code.
    pub result: Result<Option<u32>, u32>,
}

/// Why a drive could not be set up.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum SetupFault {
    /// No answer in time.
    #[error("object {object:#06X}:{sub:02X}: no answer")]
    Silent {
        /// Index.
        object: u16,
        /// Subindex.
        sub: u8,
    },
    /// It was written and has another value.
    #[error("object {object:#06X}:{sub:02X}: {written:#X} was written, {read:#X} is read")]
    Differs {
        /// Index.
        object: u16,
        /// Subindex.
        sub: u8,
        /// Bits that were written.
        written: u32,
        /// Bits that are read.
        read: u32,
    },
    /// Refused.
    #[error("object {object:#06X}:{sub:02X}: refused with abort code {code:#010X}, {}", meaning(*.code))]
    Refused {
        /// Index.
        object: u16,
        /// Subindex.
        sub: u8,
        /// Abort code of CiA 301.
        code: u32,
    },
}

impl ObjectValue {
    /// Returns the value's bytes, `None` where it does not fit its type.
    fn bytes(&self) -> Option<([u8; 4], u8)> {
        let (bits, signed) = match self.kind {
            ObjectType::U8 => (8, false),
            ObjectType::U16 => (16, false),
            ObjectType::U32 => (32, false),
            ObjectType::I8 => (8, true),
            ObjectType::I16 => (16, true),
            ObjectType::I32 => (32, true),
        };
        let (low, high) = if signed {
            (-(1_i64 << (bits - 1)), (1_i64 << (bits - 1)) - 1)
        } else {
            (0, (1_i64 << bits) - 1)
        };
        (low..=high).contains(&self.value).then(|| {
            let length = bits / 8;
            let mut bytes = [0; 4];
            let all = self.value.to_le_bytes();
            bytes[..length].copy_from_slice(&all[..length]);
            (bytes, length as u8)
        })
    }

    /// Returns the request that writes the object, an expedited download; `None` where the value does
    /// not fit its type.
    pub fn write(&self, node: NodeId) -> Option<SdoRequest> {
        let (value, length) = self.bytes()?;
        let [low, high] = self.object.to_le_bytes();
        Some(SdoRequest {
            object: self.object,
            sub: self.sub,
            frame: Frame {
                id: node.request(),
                length: 8,
                data: [
                    0x23 | (4 - length) << 2,
                    low,
                    high,
                    self.sub,
                    value[0],
                    value[1],
                    value[2],
                    value[3],
                ],
            },
            expected: None,
        })
    }

    /// Returns the request that reads the object back if the drive's stop without this program depends on it.
    pub(crate) fn check(&self, node: NodeId) -> Option<SdoRequest> {
        let guards =
            self.is_deadline() || matches!((self.object, self.sub), (0x1016, 1..) | (0x6007, 0));
        let (bits, _) = self.bytes().filter(|_| guards)?;
        let expected = u32::from_le_bytes(bits);
        Some(SdoRequest::read(node, self.object, self.sub, expected))
    }

    /// Returns whether it is the event timer of an RPDO: how long the drive waits for commands.
    pub(crate) fn is_deadline(&self) -> bool {
        matches!((self.object, self.sub), (0x1400..=0x15FF, 5))
    }
}

/// Returns what a frame answers to an object that was written or read at once; `None` for any other answer.
pub(super) fn answer(frame: &Frame) -> Option<SdoAnswer> {
    let [kind, low, high, sub, code @ ..] = frame.data;
    let bits = u32::from_le_bytes(code);
    let result = match kind {
        0x60 => Ok(None),
        0x80 => Err(bits),
        0x42 | 0x43 => Ok(Some(bits)),
        0x47 => Ok(Some(bits & 0xFF_FFFF)),
        0x4B => Ok(Some(bits & 0xFFFF)),
        0x4F => Ok(Some(bits & 0xFF)),
        _ => return None,
    };
    Some(SdoAnswer {
        object: u16::from_le_bytes([low, high]),
        sub,
        result,
    })
}

/// The abort codes that a setup meets, in the words of CiA 301.
fn meaning(code: u32) -> &'static str {
    match code {
        0x0504_0000 => "SDO protocol timed out",
        0x0504_0001 => "command specifier not valid or unknown",
        0x0601_0000 => "unsupported access",
        0x0601_0002 => "attempt to write a read only object",
        0x0602_0000 => "object does not exist",
        0x0604_0041 => "object cannot be mapped to the PDO",
        0x0604_0042 => "mapped objects would exceed the PDO's length",
        0x0604_0043 => "general parameter incompatibility",
        0x0606_0000 => "access failed by a hardware error",
        0x0607_0010 => "data type does not match",
        0x0609_0011 => "subindex does not exist",
        0x0609_0030 => "value range exceeded",
        0x0609_0031 => "value too high",
        0x0609_0032 => "value too low",
        0x0800_0000 => "general error",
        0x0800_0020 => "data cannot be stored",
        0x0800_0021 => "data cannot be stored because of local control",
        0x0800_0022 => "data cannot be stored in the present device state",
        _ => "see the drive's manual",
    }
}
