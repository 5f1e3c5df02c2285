//! The CAN database: messages and signals by name, from the text of a DBC file.

mod error;

pub use error::{DatabaseError, DatabaseFault};

use super::frame::{EXTENDED_ID_MAX, FrameId, STANDARD_ID_MAX};
use super::signal::{BitOrder, RawKind, SignalCodec};
use can_dbc::{
    ByteOrder, Dbc, MessageId, MultiplexIndicator, NumericValue, SignalExtendedValueType, ValueType,
};

/// A database and the name of its file, which every error carries.
#[derive(Debug, Clone)]
pub struct Database {
    file: String,
    dbc: Dbc,
}

/// A signal and, where it is multiplexed, the switch that must show its page.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Signal {
    /// Place and scaling.
    pub codec: SignalCodec,
    /// The multiplexor and the raw value it has when this signal is in the frame.
    pub page: Option<(SignalCodec, u64)>,
    /// How much its unit is, rad/s; none for a unit that is not of a rotation.
    pub rotation_rad_s: Option<f64>,
}

/// A message of the database.
#[derive(Debug, Clone, Copy)]
pub struct Message<'a> {
    database: &'a Database,
    message: &'a can_dbc::Message,
    /// Identifier.
    pub id: FrameId,
    /// Number of bytes.
    pub length: u8,
}

impl Database {
    /// Returns the database in `text`; `file` is only for messages.
    ///
    /// # Errors
    /// [`DatabaseError`] for text that is not a DBC file or defines a message twice.
    pub fn parse(file: &str, text: &str) -> Result<Self, DatabaseError> {
        let fail = |fault| DatabaseError {
            file: file.to_owned(),
            fault,
        };
        check_identifiers(text).map_err(fail)?;
        let dbc = Dbc::try_from(text).map_err(|error| {
            let mut reason = error.to_string();
            // The parser's name for the whole.
            if reason.ends_with("expected file") {
                reason += "; `cantools convert FILE OUT.dbc` makes one of KCD, SYM and ARXML";
            }
            fail(DatabaseFault::Syntax(reason))
        })?;
        if dbc.messages.is_empty() {
            let reason = "it defines no message; export it anew".to_owned();
            return Err(fail(DatabaseFault::Syntax(reason)));
        }
        for (i, message) in dbc.messages.iter().enumerate() {
            if dbc.messages[..i]
                .iter()
                .any(|other| other.name == message.name || other.id == message.id)
            {
                return Err(fail(DatabaseFault::DuplicateMessage {
                    message: message.name.clone(),
                }));
            }
        }
        Ok(Self {
            file: file.to_owned(),
            dbc,
        })
    }

    /// Returns the message of that name.
    ///
    /// # Errors
    /// [`DatabaseError`] if the message is missing, or is not a frame of classical CAN.
    pub fn message(&self, name: &str) -> Result<Message<'_>, DatabaseError> {
        let message = self
            .dbc
            .messages
            .iter()
            .find(|message| message.name == name)
            .ok_or_else(|| {
                self.fail(DatabaseFault::NoMessage {
                    message: name.to_owned(),
                    near: near(name, self.dbc.messages.iter().map(|one| &one.name)),
                })
            })?;
        let id = match message.id {
            MessageId::Standard(id) => FrameId::Standard(id),
            MessageId::Extended(id) => FrameId::Extended(id),
        };
        if !(1..=8).contains(&message.size) {
            return Err(self.fail(DatabaseFault::Length {
                message: name.to_owned(),
                bytes: message.size,
            }));
        }
        Ok(Message {
            database: self,
            message,
            id,
            length: message.size as u8,
        })
    }

    /// Returns the number of messages.
    #[cfg(test)]
    pub fn message_count(&self) -> usize {
        self.dbc.messages.len()
    }

    pub(super) fn fail(&self, fault: DatabaseFault) -> DatabaseError {
        DatabaseError {
            file: self.file.clone(),
            fault,
        }
    }
}

/// Returns the names most like one that is not there, the likest first.
fn near<'a>(wanted: &str, names: impl Iterator<Item = &'a String>) -> Vec<String> {
    /// Likeness by Jaro and Winkler, from 0 to 1: a letter wrong, other capitals, or only the beginning of a name.
    const LIKE: f64 = 0.8;
    const NAMES: usize = 3;
    let wanted = wanted.to_lowercase();
    let mut found: Vec<(f64, &String)> = names
        .map(|name| (strsim::jaro_winkler(&wanted, &name.to_lowercase()), name))
        .filter(|(likeness, _)| *likeness >= LIKE)
        .collect();
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    let names = found.into_iter().take(NAMES);
    names.map(|(_, name)| name.clone()).collect()
}

/// Returns how much a unit of rotation is, rad/s; none for another.
fn rotation_rad_s(unit: &str) -> Option<f64> {
    match unit.trim().to_ascii_lowercase().as_str() {
        "rpm" | "1/min" | "min-1" | "min^-1" | "r/min" | "rev/min" | "u/min" => {
            Some(std::f64::consts::TAU / 60.0)
        }
        "rps" | "r/s" | "rev/s" => Some(std::f64::consts::TAU),
        "rad/s" => Some(1.0),
        "deg/s" | "\u{b0}/s" => Some(1_f64.to_radians()),
        _ => None,
    }
}

/// The parser silently truncates standard identifiers to 16 bits; this checks them before it.
fn check_identifiers(text: &str) -> Result<(), DatabaseFault> {
    const EXTENDED: u64 = 1 << 31;
    for line in without_texts(text).lines() {
        let mut words = line.split_ascii_whitespace();
        if words.next() != Some("BO_") {
            continue;
        }
        // The parser rejects what is not a number here.
        let Some(id) = words.next().and_then(|word| word.parse::<u64>().ok()) else {
            continue;
        };
        let max = if id & EXTENDED == 0 {
            u64::from(STANDARD_ID_MAX)
        } else {
            EXTENDED | u64::from(EXTENDED_ID_MAX)
        };
        // The name of a pseudo message that DBC editors add for signals without a frame.
        let name = words.next().unwrap_or_default().trim_end_matches(':');
        if id > max && name != "VECTOR__INDEPENDENT_SIG_MSG" {
            return Err(DatabaseFault::Identifier {
                message: name.to_owned(),
                id,
            });
        }
    }
    Ok(())
}

/// Returns a database without the content of its quoted texts, such as comments, which may look like messages.
fn without_texts(text: &str) -> String {
    let (mut out, mut quoted, mut escaped) = (String::with_capacity(text.len()), false, false);
    for letter in text.chars() {
        match letter {
            '"' if !escaped => quoted = !quoted,
            _ if quoted => {}
            _ => out.push(letter),
        }
        escaped = quoted && letter == '\\' && !escaped;
    }
    out
}

impl Message<'_> {
    /// Returns the signal of that name.
    ///
    /// # Errors
    /// [`DatabaseError`] where there is none or two, its bits are not in the frame, its scaling is
    /// unusable, or its multiplexing is not supported.
    pub fn signal(&self, name: &str) -> Result<Signal, DatabaseError> {
        let message = self.message.name.clone();
        let mut named = self.message.signals.iter().filter(|s| s.name == name);
        let Some(signal) = named.next() else {
            return Err(self.database.fail(DatabaseFault::NoSignal {
                message,
                signal: name.to_owned(),
                near: near(name, self.message.signals.iter().map(|one| &one.name)),
            }));
        };
        if named.next().is_some() {
            return Err(self.database.fail(DatabaseFault::DuplicateSignal {
                message,
                signal: name.to_owned(),
            }));
        }
        let codec = self.codec(signal)?;
        let page = match signal.multiplexer_indicator {
            MultiplexIndicator::Plain | MultiplexIndicator::Multiplexor => None,
            MultiplexIndicator::MultiplexedSignal(page) => Some((self.switch(signal, page)?, page)),
            MultiplexIndicator::MultiplexorAndMultiplexedSignal(_) => {
                return Err(self.multiplexing(signal));
            }
        };
        Ok(Signal {
            codec,
            page,
            rotation_rad_s: rotation_rad_s(&signal.unit),
        })
    }

    /// The message's multiplexor, which must be able to show `page`.
    fn switch(&self, signal: &can_dbc::Signal, page: u64) -> Result<SignalCodec, DatabaseError> {
        let extended = self
            .database
            .dbc
            .extended_multiplex
            .iter()
            .any(|mapping| mapping.message_id == self.message.id);
        let mut switches = self
            .message
            .signals
            .iter()
            .filter(|s| s.multiplexer_indicator == MultiplexIndicator::Multiplexor);
        match (switches.next(), switches.next()) {
            (Some(switch), None) if !extended => {
                let codec = self.codec(switch)?;
                let plain = codec.kind == RawKind::Unsigned && page as f64 <= codec.raw_limits()[1];
                plain
                    .then_some(codec)
                    .ok_or_else(|| self.multiplexing(signal))
            }
            _ => Err(self.multiplexing(signal)),
        }
    }

    fn multiplexing(&self, signal: &can_dbc::Signal) -> DatabaseError {
        self.database.fail(DatabaseFault::Multiplexing {
            message: self.message.name.clone(),
            signal: signal.name.clone(),
        })
    }

    fn codec(&self, signal: &can_dbc::Signal) -> Result<SignalCodec, DatabaseError> {
        let extended = self
            .database
            .dbc
            .extended_value_type_for_signal(self.message.id, &signal.name);
        let kind = match (extended, signal.value_type) {
            (Some(SignalExtendedValueType::IEEEfloat32Bit), _) => RawKind::Float32,
            (Some(SignalExtendedValueType::IEEEdouble64bit), _) => RawKind::Float64,
            (_, ValueType::Signed) => RawKind::Signed,
            (_, ValueType::Unsigned) => RawKind::Unsigned,
        };
        let [low, high] = [&signal.min, &signal.max].map(|value| match *value {
            NumericValue::Uint(value) => value as f64,
            NumericValue::Int(value) => value as f64,
            NumericValue::Double(value) => value,
        });
        for (what, value, usable) in [
            ("scale", signal.factor, signal.factor != 0.0),
            ("offset", signal.offset, true),
            ("minimum", low, low <= high),
            ("maximum", high, low <= high),
        ] {
            if !value.is_finite() || !usable {
                return Err(self.database.fail(DatabaseFault::Number {
                    message: self.message.name.clone(),
                    signal: signal.name.clone(),
                    what,
                    value,
                }));
            }
        }
        let codec = SignalCodec {
            // What does not fit here does not fit the frame either.
            start_bit: usize::try_from(signal.start_bit).unwrap_or(usize::MAX),
            bits: usize::try_from(signal.size).unwrap_or(usize::MAX),
            order: match signal.byte_order {
                ByteOrder::LittleEndian => BitOrder::Intel,
                ByteOrder::BigEndian => BitOrder::Motorola,
            },
            kind,
            scale: signal.factor,
            offset: signal.offset,
            // [0|0] in a DBC file means no limit.
            range: (low < high).then_some([low, high]),
        };
        let sized = match kind {
            RawKind::Float32 => codec.bits == 32,
            RawKind::Float64 => codec.bits == 64,
            RawKind::Unsigned | RawKind::Signed => true,
        };
        if !sized || !codec.fits(usize::from(self.length)) {
            return Err(self.database.fail(DatabaseFault::Bits {
                message: self.message.name.clone(),
                signal: signal.name.clone(),
                start_bit: signal.start_bit,
                bits: signal.size,
            }));
        }
        Ok(codec)
    }
}
