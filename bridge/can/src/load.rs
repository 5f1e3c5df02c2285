//! How much of a bus is used.

use crate::frame::{Frame, FrameId};

/// Generator polynomial of the checksum of classical CAN, 15 bits.
const CRC_POLYNOMIAL: u16 = 0x4599;
/// Bits after the checksum, which are not stuffed: its delimiter, acknowledgement, end of frame, space to the next.
const TAIL_BITS: u32 = 1 + 2 + 7 + 3;

/// Returns how many bits a data frame takes on the bus, stuff bits and the space behind it included.
pub fn bits_on_bus(frame: &Frame) -> u32 {
    let mut stuffed = Stuffed::default();
    stuffed.push(0, 1);
    match frame.id {
        // Remote request and identifier extension are dominant, as is the reserved bit.
        FrameId::Standard(id) => {
            stuffed.push(u32::from(id), 11);
            stuffed.push(0, 3);
        }
        // Substitute for the remote request, and identifier extension; at the end the request and two reserved bits.
        FrameId::Extended(id) => {
            stuffed.push(id >> 18, 11);
            stuffed.push(0b11, 2);
            stuffed.push(id, 18);
            stuffed.push(0, 3);
        }
    }
    stuffed.push(u32::from(frame.length), 4);
    for byte in frame.bytes() {
        stuffed.push(u32::from(*byte), 8);
    }
    let checksum = stuffed.checksum;
    stuffed.push(u32::from(checksum), 15);
    stuffed.bits + TAIL_BITS
}

/// Counts bits with those that are inserted after five equal ones.
#[derive(Default)]
struct Stuffed {
    bits: u32,
    checksum: u16,
    last: u32,
    equal: u32,
}

impl Stuffed {
    /// Adds the lowest `count` bits of `value`, the highest of them first.
    fn push(&mut self, value: u32, count: u32) {
        for place in (0..count).rev() {
            let bit = value >> place & 1;
            let carry = self.checksum >> 14 & 1 != bit as u16;
            self.checksum = self.checksum << 1 & 0x7FFF;
            if carry {
                self.checksum ^= CRC_POLYNOMIAL;
            }
            self.bits += 1;
            self.equal = if bit == self.last { self.equal + 1 } else { 1 };
            self.last = bit;
            if self.equal == 5 {
                // The inserted bit is the other one, and counts for those that follow.
                self.bits += 1;
                self.last = 1 - bit;
                self.equal = 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn frames_without_and_with_stuff_bits_have_their_lengths() {
        // Of 500 kbit/s, a standard frame of 8 bytes takes 111 to 135 bits with the space behind it.
        let frame = |data: &[u8]| Frame::new(FrameId::Standard(0x555), data).unwrap();
        let alternating = bits_on_bus(&frame(&[0x55; 8]));
        assert!((111..118).contains(&alternating), "{alternating}");
        // A stuff bit for each five of 64 zeros, and some in head and checksum.
        let zeros = bits_on_bus(&frame(&[0; 8]));
        assert!((111 + 12..=135).contains(&zeros), "{zeros}");
    }

    #[test]
    fn the_checksum_is_that_of_can() {
        // CRC-15/CAN of the catalogue: 0x059E for "123456789".
        let mut stuffed = Stuffed::default();
        for byte in b"123456789" {
            stuffed.push(u32::from(*byte), 8);
        }
        assert_eq!(stuffed.checksum, 0x059E);
    }

    proptest! {
        #[test]
        fn no_frame_is_shorter_or_longer_than_can_allows(
            id in 0..0x2000_0000u32,
            extended: bool,
            data in prop::collection::vec(any::<u8>(), 0..=8),
        ) {
            let id = if extended { FrameId::Extended(id) } else { FrameId::Standard((id & 0x7FF) as u16) };
            let frame = Frame::new(id, &data).unwrap();
            let stuffable = if extended { 54 } else { 34 } + 8 * data.len() as u32;
            let least = stuffable + TAIL_BITS;
            let bits = bits_on_bus(&frame);
            prop_assert!((least..=least + (stuffable - 1) / 4).contains(&bits), "{bits}");
        }
    }
}
