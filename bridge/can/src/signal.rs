//! One signal of a frame: from bits to a physical value and back.

/// How the raw bits of a signal are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RawKind {
    /// Unsigned integer.
    Unsigned,
    /// Integer in two's complement.
    Signed,
    /// IEEE 754 single precision, 32 bits.
    Float32,
    /// IEEE 754 double precision, 64 bits.
    Float64,
}

/// Order of a signal's bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BitOrder {
    /// Little endian: the start bit is the least significant.
    Intel,
    /// Big endian: the start bit is the most significant, and the bits descend within a byte.
    Motorola,
}

/// A signal's place in the frame and its scaling.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SignalCodec {
    /// Start bit as a DBC file counts it: 8 times the byte plus the bit's weight in it.
    pub start_bit: usize,
    /// Number of bits, from 1 to 64.
    pub bits: usize,
    /// Byte order.
    pub order: BitOrder,
    /// Meaning of the raw bits.
    pub kind: RawKind,
    /// Physical value of one raw unit; not 0.
    pub scale: f64,
    /// Physical value of raw 0.
    pub offset: f64,
    /// Allowed physical values, where the database limits them.
    pub range: Option<[f64; 2]>,
}

/// Why a value cannot be encoded, or fails its check when it is decoded.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum ValueFault {
    /// Infinite or not a number.
    #[error("{value} is not finite")]
    NotFinite {
        /// The value.
        value: f64,
    },
    /// Outside the signal's range or what its bits can hold.
    #[error("{value} is outside {low} to {high}")]
    OutOfRange {
        /// The value.
        value: f64,
        /// Least value.
        low: f64,
        /// Greatest value.
        high: f64,
    },
}

impl SignalCodec {
    /// Returns the physical value in `data`.
    ///
    /// # Errors
    /// [`ValueFault`] for a value outside the database's range (by more than half a raw unit) or
    /// a float that is not finite.
    pub fn decode(&self, data: &[u8; 8]) -> Result<f64, ValueFault> {
        let raw = self.extract(data);
        let number = match self.kind {
            RawKind::Unsigned => raw as f64,
            RawKind::Signed => sign_extended(raw, self.bits) as f64,
            RawKind::Float32 => f64::from(f32::from_bits(raw as u32)),
            RawKind::Float64 => f64::from_bits(raw),
        };
        let value = self.offset + self.scale * number;
        if !value.is_finite() {
            return Err(ValueFault::NotFinite { value });
        }
        // A value at the limit may have been rounded beyond it by the sender.
        let slack = match self.kind {
            RawKind::Unsigned | RawKind::Signed => 0.5 * self.scale.abs() * (1.0 + 1e-9),
            RawKind::Float32 | RawKind::Float64 => 0.0,
        };
        match self.range {
            Some([low, high]) if !(low - slack..=high + slack).contains(&value) => {
                Err(ValueFault::OutOfRange { value, low, high })
            }
            _ => Ok(value),
        }
    }

    /// Writes a physical value into `data`, rounded to the nearest raw unit.
    ///
    /// # Errors
    /// [`ValueFault`] for a value that is not finite, outside the database's range, or too large
    /// for the bits; `data` is then as before.
    pub fn encode(&self, value: f64, data: &mut [u8; 8]) -> Result<(), ValueFault> {
        if !value.is_finite() {
            return Err(ValueFault::NotFinite { value });
        }
        if let Some([low, high]) = self.range
            && !(low..=high).contains(&value)
        {
            return Err(ValueFault::OutOfRange { value, low, high });
        }
        let number = (value - self.offset) / self.scale;
        let raw = match self.kind {
            RawKind::Float32 => {
                let single = number as f32;
                if !single.is_finite() {
                    return Err(self.too_large(value));
                }
                u64::from(single.to_bits())
            }
            RawKind::Float64 => {
                if !number.is_finite() {
                    return Err(self.too_large(value));
                }
                number.to_bits()
            }
            RawKind::Unsigned | RawKind::Signed => {
                let [low, high] = self.raw_limits();
                let rounded = number.round();
                if !(low..=high).contains(&rounded) {
                    return Err(self.too_large(value));
                }
                if self.kind == RawKind::Signed {
                    rounded as i64 as u64
                } else {
                    rounded as u64
                }
            }
        };
        self.insert(raw, data);
        Ok(())
    }

    /// Returns the raw bits, right-aligned.
    pub fn extract(&self, data: &[u8; 8]) -> u64 {
        (0..self.bits).fold(0, |raw, i| {
            let (byte, bit) = self.place(i);
            raw | (u64::from(data[byte] >> bit & 1) << i)
        })
    }

    /// Writes the lowest bits of `raw`; the others are left out.
    pub fn insert(&self, raw: u64, data: &mut [u8; 8]) {
        for i in 0..self.bits {
            let (byte, bit) = self.place(i);
            let mask = 1 << bit;
            if raw >> i & 1 == 1 {
                data[byte] |= mask;
            } else {
                data[byte] &= !mask;
            }
        }
    }

    /// Returns whether all bits lie within a frame of `length` bytes, at most 8.
    pub fn fits(&self, length: usize) -> bool {
        let bits = 8 * length.min(8);
        if self.bits == 0 || self.bits > 64 || self.start_bit >= bits {
            return false;
        }
        let first = match self.order {
            BitOrder::Intel => self.start_bit,
            BitOrder::Motorola => self.sawtooth_start(),
        };
        first + self.bits <= bits
    }

    /// Returns a mask of the frame's bits that the signal takes, bit 0 of byte 0 lowest.
    pub fn footprint(&self) -> u64 {
        (0..self.bits).fold(0, |mask, i| {
            let (byte, bit) = self.place(i);
            mask | 1 << (8 * byte + bit)
        })
    }

    /// Returns the least and the greatest raw number of an integer signal.
    pub fn raw_limits(&self) -> [f64; 2] {
        let bits = self.bits as i32;
        match self.kind {
            // 2^64 itself is not reachable, but 2^64 - 1 is not a double; `as` saturates.
            RawKind::Unsigned => [0.0, 2f64.powi(bits) - 1.0],
            RawKind::Signed => [-2f64.powi(bits - 1), 2f64.powi(bits - 1) - 1.0],
            RawKind::Float32 => [f64::from(f32::MIN), f64::from(f32::MAX)],
            RawKind::Float64 => [f64::MIN, f64::MAX],
        }
    }

    fn too_large(&self, value: f64) -> ValueFault {
        let [a, b] = self.raw_limits().map(|raw| self.offset + self.scale * raw);
        ValueFault::OutOfRange {
            value,
            low: a.min(b),
            high: a.max(b),
        }
    }

    /// Byte and bit of the i-th bit, counted from the least significant.
    fn place(&self, i: usize) -> (usize, usize) {
        match self.order {
            BitOrder::Intel => {
                let position = self.start_bit + i;
                (position / 8, position % 8)
            }
            BitOrder::Motorola => {
                let position = self.sawtooth_start() + self.bits - 1 - i;
                (position / 8, 7 - position % 8)
            }
        }
    }

    /// Start bit counted from the most significant bit of byte 0.
    fn sawtooth_start(&self) -> usize {
        self.start_bit / 8 * 8 + (7 - self.start_bit % 8)
    }
}

fn sign_extended(raw: u64, bits: usize) -> i64 {
    let unused = 64 - bits as u32;
    (raw << unused) as i64 >> unused
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn any_codec() -> impl Strategy<Value = SignalCodec> {
        (
            0..64usize,
            1..=64usize,
            any::<bool>(),
            any::<bool>(),
            -100.0..100.0f64,
            0.001..10.0f64,
        )
            .prop_map(
                |(start_bit, bits, intel, signed, offset, scale)| SignalCodec {
                    start_bit,
                    bits,
                    order: if intel {
                        BitOrder::Intel
                    } else {
                        BitOrder::Motorola
                    },
                    kind: if signed {
                        RawKind::Signed
                    } else {
                        RawKind::Unsigned
                    },
                    scale,
                    offset,
                    range: None,
                },
            )
            .prop_filter("within the frame", |codec| codec.fits(8))
    }

    proptest! {
        #[test]
        fn raw_bits_return_and_leave_the_others_alone(codec in any_codec(), raw: u64, data: [u8; 8]) {
            let mut written = data;
            codec.insert(raw, &mut written);
            let mask = if codec.bits == 64 { u64::MAX } else { (1 << codec.bits) - 1 };
            prop_assert_eq!(codec.extract(&written), raw & mask);
            let others = !codec.footprint();
            prop_assert_eq!(u64::from_le_bytes(written) & others, u64::from_le_bytes(data) & others);
            prop_assert_eq!(codec.footprint().count_ones() as usize, codec.bits);
        }

        #[test]
        fn values_return_within_half_a_unit_or_are_refused(codec in any_codec(), value in -1e4..1e4f64) {
            let mut data = [0xA5; 8];
            match codec.encode(value, &mut data) {
                Ok(()) => {
                    let back = codec.decode(&data).unwrap();
                    prop_assert!((back - value).abs() <= 0.5 * codec.scale * (1.0 + 1e-6) + 1e-9, "{} {}", value, back);
                }
                Err(ValueFault::OutOfRange { low, high, .. }) => {
                    prop_assert!(value < low || value > high);
                    prop_assert_eq!(data, [0xA5; 8]);
                }
                Err(other) => prop_assert!(false, "{other}"),
            }
        }
    }

    #[test]
    fn not_finite_and_out_of_range_never_enter_a_frame() {
        let codec = SignalCodec {
            start_bit: 0,
            bits: 16,
            order: BitOrder::Intel,
            kind: RawKind::Signed,
            scale: 0.1,
            offset: 0.0,
            range: Some([-100.0, 100.0]),
        };
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 100.05, -1e300] {
            let mut data = [7; 8];
            assert!(codec.encode(value, &mut data).is_err());
            assert_eq!(data, [7; 8]);
        }
    }
}
