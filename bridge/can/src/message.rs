//! One message of the layout: quantities to a protected frame, and a frame to quantities.

use super::frame::{Frame, FrameId};
use super::signal::{SignalCodec, ValueFault};
use crc::{Crc, Table};
use serde::{Deserialize, Serialize};
use sidehill_bridge::drives::MeasuredMotorSpeeds;
use sidehill_bridge::drives::SendError;
use sidehill_plant::speeds::MeasuredTreadSpeeds;

/// What a drive moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum DriveRole {
    /// Both treads alike.
    Traction,
    /// Both treads against each other.
    Steer,
    /// The left tread.
    Left,
    /// The right tread.
    Right,
}

impl DriveRole {
    /// Returns the role as configurations spell it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Traction => "traction",
            Self::Steer => "steer",
            Self::Left => "left",
            Self::Right => "right",
        }
    }

    /// Returns the speed of this drive where the motors turn so, m/s.
    pub fn speed_m_s(self, motors: &MeasuredMotorSpeeds) -> f64 {
        let treads = MeasuredTreadSpeeds::from(*motors);
        match self {
            Self::Traction => motors.traction_m_s,
            Self::Steer => motors.steer_m_s,
            Self::Left => treads.left_m_s,
            Self::Right => treads.right_m_s,
        }
    }
}

/// What a signal carries, in SI units after scaling.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Quantity {
    /// Commanded speed of a drive, m/s.
    Command(DriveRole),
    /// Off or on, as the drives spell it.
    CommandEnable,
    /// Controlword of CiA 402.
    Controlword,
    /// Speed that a drive has reached, m/s.
    Speed(DriveRole),
    /// State of a drive, as it spells it.
    DriveState,
    /// State of a node of CANopen.
    NodeState,
    /// Roll, rad.
    Roll,
    /// Pitch, rad.
    Pitch,
    /// Yaw rate, rad/s.
    YawRate,
    /// X_g, m.
    X,
    /// Y_g, m.
    Y,
    /// Z_g, m.
    Z,
    /// Heading, rad.
    Yaw,
}

/// A quantity's place in a message.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Field {
    /// What it is.
    pub quantity: Quantity,
    /// Where it is.
    pub codec: SignalCodec,
    /// Signal units in one SI unit; not 0.
    pub per_unit: f64,
    /// How much a signal unit is, rad/s; none for a unit that is not of a rotation.
    pub rotation_rad_s: Option<f64>,
}

/// A checksum's place and kind.
#[derive(Clone)]
pub(super) struct ChecksumCodec {
    /// The byte it fills.
    pub(super) byte: usize,
    pub(super) crc: Crc<u8, Table<1>>,
    pub(super) data_id: Vec<u8>,
}

impl ChecksumCodec {
    /// The checksum over the data id and all bytes but its own.
    fn of(&self, bytes: &[u8]) -> u8 {
        let mut digest = self.crc.digest();
        digest.update(&self.data_id);
        for (i, byte) in bytes.iter().enumerate() {
            if i != self.byte {
                digest.update(&[*byte]);
            }
        }
        digest.finalize()
    }
}

impl From<FrameFault> for SendError {
    fn from(_: FrameFault) -> Self {
        Self::Values
    }
}

/// A message with its fields and protection.
#[derive(Clone)]
pub struct MessageCodec {
    pub(super) name: String,
    pub(super) id: FrameId,
    pub(super) length: u8,
    pub(super) fields: Vec<Field>,
    /// Multiplexor and the raw value that shows the fields.
    pub(super) page: Option<(SignalCodec, u64)>,
    pub(super) counter: Option<SignalCodec>,
    pub(super) checksum: Option<ChecksumCodec>,
}

/// Contents of a valid frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contents {
    /// The counter, where the message has one.
    pub counter: Option<u32>,
    values: [Option<(Quantity, f64)>; Self::FIELDS_MAX],
}

impl Contents {
    /// Most fields that a message has.
    pub const FIELDS_MAX: usize = 3;

    /// Returns a quantity of the message.
    pub fn get(&self, quantity: Quantity) -> Option<f64> {
        self.values
            .iter()
            .flatten()
            .find_map(|(present, value)| (*present == quantity).then_some(*value))
    }
}

/// Which check a frame failed.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum FrameFault {
    /// Its length differs from the database's.
    #[error("{found} bytes, expected {expected}")]
    Length {
        /// Found.
        found: u8,
        /// Expected.
        expected: u8,
    },
    /// Its checksum does not fit its contents.
    #[error("checksum {found:#04X}, computed {computed:#04X}")]
    Checksum {
        /// Found.
        found: u8,
        /// Computed.
        computed: u8,
    },
    /// Its counter is that of the frame before.
    #[error("counter {counter} repeated")]
    CounterRepeated {
        /// The counter.
        counter: u32,
    },
    /// Too many counts are missing.
    #[error("counter went from {before} to {counter}")]
    CounterSkipped {
        /// Of the frame before.
        before: u32,
        /// Of this frame.
        counter: u32,
    },
    /// A value is not believable.
    #[error("{quantity:?}: {fault}")]
    Value {
        /// Which.
        quantity: Quantity,
        /// Why.
        fault: ValueFault,
    },
    /// A state is not listed.
    #[error("{quantity:?}: state {value} is not known")]
    State {
        /// Which.
        quantity: Quantity,
        /// The value.
        value: f64,
    },
}

impl MessageCodec {
    /// Returns the name in the database.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Returns the identifier.
    pub fn id(&self) -> FrameId {
        self.id
    }

    /// Returns the signal units in one unit of a quantity; none where the message does not carry it.
    pub fn per_unit(&self, quantity: Quantity) -> Option<f64> {
        let mut fields = self.fields.iter();
        let field = fields.find(|field| field.quantity == quantity)?;
        Some(field.per_unit)
    }

    /// Returns how fast a motor turns at 1 m/s, rad/s, where the signal counts turns; its sign is that of the scaling.
    pub fn rotation_rad_s(&self, quantity: Quantity) -> Option<f64> {
        let field = self
            .fields
            .iter()
            .find(|field| field.quantity == quantity)?;
        Some(field.per_unit * field.rotation_rad_s?)
    }

    /// Returns the number of different counters; 1 without a counter.
    pub fn counter_modulus(&self) -> u32 {
        self.counter.map_or(1, |codec| 1 << codec.bits)
    }

    /// Returns the fields.
    pub fn fields(&self) -> &[Field] {
        &self.fields
    }

    /// Returns a frame with the values that `value_of` gives for its fields.
    ///
    /// # Errors
    /// The first value that is not finite or does not fit its signal.
    pub fn encode(
        &self,
        counter: u32,
        value_of: impl Fn(Quantity) -> f64,
    ) -> Result<Frame, FrameFault> {
        let mut data = [0; 8];
        for field in &self.fields {
            let value = value_of(field.quantity) * field.per_unit;
            field
                .codec
                .encode(value, &mut data)
                .map_err(|fault| FrameFault::Value {
                    quantity: field.quantity,
                    fault,
                })?;
        }
        if let Some((switch, page)) = &self.page {
            switch.insert(*page, &mut data);
        }
        if let Some(codec) = &self.counter {
            codec.insert(u64::from(counter), &mut data);
        }
        if let Some(checksum) = &self.checksum {
            data[checksum.byte] = checksum.of(&data[..usize::from(self.length)]);
        }
        Ok(Frame {
            id: self.id,
            length: self.length,
            data,
        })
    }

    /// Returns the contents of a frame with this identifier, or `None` if it has another page of a
    /// multiplexed message.
    ///
    /// # Errors
    /// [`FrameFault`] for a wrong length, a wrong checksum or a value outside its range.
    pub fn decode(&self, frame: &Frame) -> Result<Option<Contents>, FrameFault> {
        if frame.length != self.length {
            return Err(FrameFault::Length {
                found: frame.length,
                expected: self.length,
            });
        }
        if let Some(checksum) = &self.checksum {
            let (found, computed) = (frame.data[checksum.byte], checksum.of(frame.bytes()));
            if found != computed {
                return Err(FrameFault::Checksum { found, computed });
            }
        }
        if let Some((switch, page)) = &self.page
            && switch.extract(&frame.data) != *page
        {
            return Ok(None);
        }
        let mut values = [None; Contents::FIELDS_MAX];
        for (slot, field) in values.iter_mut().zip(&self.fields) {
            let value = field
                .codec
                .decode(&frame.data)
                .map_err(|fault| FrameFault::Value {
                    quantity: field.quantity,
                    fault,
                })?;
            *slot = Some((field.quantity, value / field.per_unit));
        }
        Ok(Some(Contents {
            counter: self.counter.map(|codec| codec.extract(&frame.data) as u32),
            values,
        }))
    }
}

/// Follows a message's counter, and distinguishes new frames from repeated ones.
#[derive(Debug, Clone, Copy)]
pub struct CounterWatch {
    modulus: u32,
    skip_max: u32,
    last: Option<u32>,
}

impl CounterWatch {
    /// Returns a watch that accepts any first counter.
    pub fn new(message: &MessageCodec, skip_max: u32) -> Self {
        Self {
            modulus: message.counter_modulus(),
            skip_max,
            last: None,
        }
    }

    /// Takes the counter of a frame; messages without one always pass.
    ///
    /// # Errors
    /// A repeated counter, or one after more missing counts than allowed. Counting continues from the
    /// latter, so that its successor passes.
    pub fn check(&mut self, counter: Option<u32>) -> Result<(), FrameFault> {
        let Some(counter) = counter else {
            return Ok(());
        };
        let Some(before) = self.last.replace(counter) else {
            return Ok(());
        };
        match (counter + self.modulus - before) % self.modulus {
            0 => Err(FrameFault::CounterRepeated { counter }),
            step if step - 1 > self.skip_max => Err(FrameFault::CounterSkipped { before, counter }),
            _ => Ok(()),
        }
    }
}
