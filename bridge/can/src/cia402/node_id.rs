use crate::frame::FrameId;

/// Function codes of the predefined connection set: what is added to a node's number.
mod base {
    pub(super) const EMERGENCY: u16 = 0x080;
    pub(super) const ANSWER: u16 = 0x580;
    pub(super) const REQUEST: u16 = 0x600;
    pub(super) const HEARTBEAT: u16 = 0x700;
}

/// Number of a node, from 1 to 127.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NodeId(u8);

impl NodeId {
    /// Returns a number, `None` where CANopen does not have it.
    pub fn new(number: u8) -> Option<Self> {
        (1..=127).contains(&number).then_some(Self(number))
    }

    /// Returns the number.
    pub fn get(self) -> u8 {
        self.0
    }

    /// Returns the identifier of the node's heartbeat.
    pub fn heartbeat(self) -> FrameId {
        self.of(base::HEARTBEAT)
    }

    /// Returns the identifier by which the node's objects are written.
    pub fn request(self) -> FrameId {
        self.of(base::REQUEST)
    }

    /// Returns the identifier of the node's answers to that.
    pub fn answer(self) -> FrameId {
        self.of(base::ANSWER)
    }

    /// Returns the identifier of the node's emergencies.
    pub fn emergency(self) -> FrameId {
        self.of(base::EMERGENCY)
    }

    /// Returns the identifiers, apart from PDOs, of the frames that this program receives from the
    /// node.
    pub(crate) fn received_ids(self) -> [FrameId; 3] {
        [self.heartbeat(), self.answer(), self.emergency()]
    }

    fn of(self, base: u16) -> FrameId {
        FrameId::Standard(base + u16::from(self.0))
    }
}
