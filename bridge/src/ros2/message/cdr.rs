//! Messages as bytes: CDR behind the four bytes that name its byte order, as DDS sends and bags keep them.

use byteorder::{BigEndian, LittleEndian};
use serde::Serialize;
use serde::de::DeserializeOwned;

/// Why bytes are not the message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum CdrError {
    /// There is not even the header.
    #[error("{bytes} bytes, a message has at least 4")]
    NoHeader {
        /// Bytes there are.
        bytes: usize,
    },
    /// The header names another encoding than plain CDR.
    #[error("the encoding 0x{identifier:04x} is not plain CDR (0x0000 or 0x0001)")]
    Encoding {
        /// Representation identifier of the header.
        identifier: u16,
    },
    /// The bytes do not hold the fields of the message.
    #[error("not a message of this type: {reason}")]
    Content {
        /// What the decoder found.
        reason: String,
    },
}

/// Returns the message that `bytes` are; what follows its last field is padding.
///
/// # Errors
/// [`CdrError`].
pub fn from_cdr<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, CdrError> {
    let no_header = CdrError::NoHeader { bytes: bytes.len() };
    let (header, body) = bytes.split_first_chunk::<4>().ok_or(no_header)?;
    let decoded = match u16::from_be_bytes([header[0], header[1]]) {
        0 => cdr_encoding::from_bytes::<T, BigEndian>(body),
        1 => cdr_encoding::from_bytes::<T, LittleEndian>(body),
        identifier => return Err(CdrError::Encoding { identifier }),
    };
    let content = |error: cdr_encoding::Error| CdrError::Content {
        reason: error.to_string(),
    };
    decoded.map(|(message, _)| message).map_err(content)
}

/// Returns the message as bytes, little endian.
///
/// # Errors
/// [`CdrError::Content`] where the encoder refuses it, which no message of [`super`] brings about.
pub fn to_cdr<T: Serialize>(message: &T) -> Result<Vec<u8>, CdrError> {
    let mut bytes = vec![0, 1, 0, 0];
    let content = |error: cdr_encoding::Error| CdrError::Content {
        reason: error.to_string(),
    };
    bytes.extend(cdr_encoding::to_vec::<T, LittleEndian>(message).map_err(content)?);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::message::{Header, JointState, Time};

    fn joint_state() -> JointState {
        JointState {
            header: Header {
                stamp: Time { sec: 7, nanosec: 8 },
                frame_id: "base".to_owned(),
            },
            name: vec!["left".to_owned(), "right".to_owned()],
            velocity: vec![1.0, -2.0],
            ..JointState::default()
        }
    }

    #[test]
    fn a_message_comes_back_and_has_the_header_of_little_endian() {
        let bytes = to_cdr(&joint_state()).unwrap();
        assert_eq!(bytes[..4], [0, 1, 0, 0]);
        assert_eq!(bytes[4..12], [7, 0, 0, 0, 8, 0, 0, 0]);
        assert_eq!(from_cdr::<JointState>(&bytes).unwrap(), joint_state());
    }

    #[test]
    fn bytes_that_are_no_message_are_refused_and_nothing_panics() {
        let bytes = to_cdr(&joint_state()).unwrap();
        for length in 0..bytes.len() - 8 {
            assert!(
                from_cdr::<JointState>(&bytes[..length]).is_err(),
                "{length}"
            );
        }
        let mut other = bytes.clone();
        other[1] = 3;
        let identifier = 3;
        assert_eq!(
            from_cdr::<JointState>(&other),
            Err(CdrError::Encoding { identifier })
        );
        // A length of 4 billion.
        let mut long = bytes;
        long[12..16].fill(0xff);
        assert!(from_cdr::<JointState>(&long).is_err());
    }
}
