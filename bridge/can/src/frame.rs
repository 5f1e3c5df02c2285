//! Classical CAN frames as values, apart from any socket.

/// Largest identifier of 11 bits.
pub const STANDARD_ID_MAX: u32 = 0x7FF;
/// Largest identifier of 29 bits.
pub const EXTENDED_ID_MAX: u32 = 0x1FFF_FFFF;

/// Identifier of a frame; a standard and an extended one of the same number differ.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum FrameId {
    /// 11 bits.
    Standard(u16),
    /// 29 bits.
    Extended(u32),
}

/// A data frame of classical CAN.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Identifier.
    pub id: FrameId,
    /// Number of bytes that count, at most 8.
    pub length: u8,
    /// Payload; the bytes beyond `length` are 0.
    pub data: [u8; 8],
}

impl Frame {
    /// Returns a frame of the bytes given, or `None` where they are more than 8.
    pub fn new(id: FrameId, bytes: &[u8]) -> Option<Self> {
        let mut data = [0; 8];
        data.get_mut(..bytes.len())?.copy_from_slice(bytes);
        Some(Self {
            id,
            length: bytes.len() as u8,
            data,
        })
    }

    /// Returns the bytes that count.
    pub fn bytes(&self) -> &[u8] {
        &self.data[..usize::from(self.length.min(8))]
    }
}

impl std::fmt::Display for FrameId {
    /// Three digits for a standard identifier, eight for an extended one, as candump does.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Standard(id) => write!(f, "{id:03X}"),
            Self::Extended(id) => write!(f, "{id:08X}"),
        }
    }
}

impl std::fmt::Display for Frame {
    /// `123#00FF`, as candump logs it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}#", self.id)?;
        self.bytes()
            .iter()
            .try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}
