use super::error::LayoutError;
use crate::config::{Checksum, ChecksumAlgorithm, Protection, ScaledSignal};
use crate::database::{Database, DatabaseFault, Message, Signal};
use crate::message::{ChecksumCodec, Field, MessageCodec, Quantity};
use crate::signal::{RawKind, SignalCodec};
use crc::{Algorithm, Crc, Table};
use sidehill_plant::bounds::Bounds;

/// Collects the signals of one message and checks that they go together.
pub(crate) struct Builder<'a> {
    database: &'a Database,
    message: Message<'a>,
    name: String,
    fields: Vec<Field>,
    used: Vec<(String, Signal)>,
}

impl<'a> Builder<'a> {
    pub(crate) fn new(database: &'a Database, name: &str) -> Result<Self, LayoutError> {
        Ok(Self {
            database,
            message: database.message(name)?,
            name: name.to_owned(),
            fields: Vec::new(),
            used: Vec::new(),
        })
    }

    fn unusable(&self, fault: DatabaseFault) -> LayoutError {
        self.database.fail(fault).into()
    }

    fn find(&mut self, name: &str) -> Result<Signal, LayoutError> {
        let signal = self.message.signal(name)?;
        let bits = signal.codec.footprint();
        if let Some((other, _)) = self
            .used
            .iter()
            .find(|(_, used)| used.codec.footprint() & bits != 0)
        {
            return Err(self.unusable(DatabaseFault::Overlap {
                message: self.name.clone(),
                signal: name.to_owned(),
                other: other.clone(),
            }));
        }
        self.used.push((name.to_owned(), signal));
        Ok(signal)
    }

    pub(crate) fn scaled(
        mut self,
        quantity: Quantity,
        signal: &ScaledSignal,
    ) -> Result<Self, LayoutError> {
        let found = self.find(&signal.signal)?;
        let bounds = Bounds::new(1e-6, 1e9, "").with_note("or its negative");
        let size = bounds
            .check("per_unit", signal.per_unit.abs())
            .map_err(|error| LayoutError::Range {
                message: self.name.clone(),
                error,
            })?;
        self.fields.push(Field {
            quantity,
            codec: found.codec,
            per_unit: size.copysign(signal.per_unit),
            rotation_rad_s: found.rotation_rad_s,
        });
        Ok(self)
    }

    pub(crate) fn value(mut self, quantity: Quantity, signal: &str) -> Result<Self, LayoutError> {
        let codec = self.find(signal)?.codec;
        self.fields.push(Field {
            quantity,
            codec,
            per_unit: 1.0,
            rotation_rad_s: None,
        });
        Ok(self)
    }

    /// Adds a controlword or statusword.
    pub(crate) fn word(mut self, quantity: Quantity, signal: &str) -> Result<Self, LayoutError> {
        let codec = self.find(signal)?.codec;
        let plain = codec.kind == RawKind::Unsigned && codec.scale == 1.0 && codec.offset == 0.0;
        if codec.bits != 16 || !plain {
            return Err(self.unusable(DatabaseFault::Word {
                message: self.name.clone(),
                signal: signal.to_owned(),
            }));
        }
        self.fields.push(Field {
            quantity,
            codec,
            per_unit: 1.0,
            rotation_rad_s: None,
        });
        Ok(self)
    }

    /// Checks that a signal shows each of `values` exactly.
    pub(super) fn check_holds(&self, signal: &str, values: &[f64]) -> Result<(), LayoutError> {
        let codec = self.message.signal(signal)?.codec;
        for value in values {
            let mut data = [0; 8];
            let held = codec.encode(*value, &mut data).is_ok()
                && codec
                    .decode(&data)
                    .is_ok_and(|back| (back - value).abs() < 1e-9);
            if !held {
                return Err(self.unusable(DatabaseFault::State {
                    message: self.name.clone(),
                    signal: signal.to_owned(),
                    value: *value,
                }));
            }
        }
        Ok(())
    }

    pub(crate) fn finish(mut self, protection: &Protection) -> Result<MessageCodec, LayoutError> {
        let counter = match &protection.counter {
            None => None,
            Some(name) => {
                let codec = self.find(name)?.codec;
                if codec.kind != RawKind::Unsigned || codec.bits > 16 {
                    return Err(self.unusable(DatabaseFault::Counter {
                        message: self.name.clone(),
                        signal: name.clone(),
                        bits: codec.bits,
                    }));
                }
                Some(codec)
            }
        };
        let checksum = match &protection.checksum {
            None => None,
            Some(checksum) => Some(self.checksum(checksum)?),
        };
        Ok(MessageCodec {
            page: self.page()?,
            id: self.message.id,
            length: self.message.length,
            name: self.name,
            fields: self.fields,
            counter,
            checksum,
        })
    }

    fn checksum(&mut self, checksum: &Checksum) -> Result<ChecksumCodec, LayoutError> {
        let codec = self.find(&checksum.signal)?.codec;
        let footprint = codec.footprint();
        let byte = footprint.trailing_zeros() as usize / 8;
        if footprint != 0xFF << (8 * byte) || codec.kind != RawKind::Unsigned {
            return Err(self.unusable(DatabaseFault::Checksum {
                message: self.name.clone(),
                signal: checksum.signal.clone(),
            }));
        }
        Ok(ChecksumCodec {
            byte,
            crc: Crc::<u8, Table<1>>::new(algorithm(checksum.algorithm)),
            data_id: checksum.data_id.clone(),
        })
    }

    /// The one page on which all multiplexed signals used are.
    fn page(&self) -> Result<Option<(SignalCodec, u64)>, LayoutError> {
        let mut pages = self.used.iter().filter_map(|(_, signal)| signal.page);
        let Some(page) = pages.next() else {
            return Ok(None);
        };
        let overlaps =
            |(_, used): &(String, Signal)| used.codec.footprint() & page.0.footprint() != 0;
        if pages.any(|other| other != page) || self.used.iter().any(overlaps) {
            return Err(self.unusable(DatabaseFault::Pages {
                message: self.name.clone(),
            }));
        }
        Ok(Some(page))
    }
}

fn algorithm(algorithm: ChecksumAlgorithm) -> &'static Algorithm<u8> {
    match algorithm {
        ChecksumAlgorithm::SaeJ1850 => &crc::CRC_8_SAE_J1850,
        ChecksumAlgorithm::Autosar => &crc::CRC_8_AUTOSAR,
        ChecksumAlgorithm::Smbus => &crc::CRC_8_SMBUS,
        ChecksumAlgorithm::MaximDow => &crc::CRC_8_MAXIM_DOW,
    }
}
