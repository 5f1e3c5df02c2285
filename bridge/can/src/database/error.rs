use crate::frame::FrameId;

/// Why a database cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[error("{file}: {fault}")]
pub struct DatabaseError {
    /// File the database came from.
    pub file: String,
    /// What is wrong with it.
    pub fault: DatabaseFault,
}

/// What is wrong with a database.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum DatabaseFault {
    /// The text is not a DBC file.
    #[error("not a DBC file: {0}")]
    Syntax(String),
    /// A message of this name or identifier is there more than once.
    #[error("message {message} is defined more than once, or shares its identifier")]
    DuplicateMessage {
        /// Name.
        message: String,
    },
    /// No message has this name.
    #[error("message {message} is not defined{}", suggested(.near))]
    NoMessage {
        /// Name.
        message: String,
        /// Names of messages that are like it.
        near: Vec<String>,
    },
    /// An identifier has too many bits.
    #[error("message {message}: identifier {id} has more bits than CAN allows")]
    Identifier {
        /// Message.
        message: String,
        /// Identifier.
        id: u64,
    },
    /// A message is longer than a classical CAN frame.
    #[error("message {message}: {bytes} bytes, a classical CAN frame has 1 to 8")]
    Length {
        /// Message.
        message: String,
        /// Its length.
        bytes: u64,
    },
    /// The message has no such signal.
    #[error("message {message} has no signal {signal}{}", suggested(.near))]
    NoSignal {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
        /// Names of its signals that are like it.
        near: Vec<String>,
    },
    /// The message has the signal twice.
    #[error("message {message} has signal {signal} more than once")]
    DuplicateSignal {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
    },
    /// The signal's bits do not lie in the frame, or its type has another size.
    #[error("message {message}, signal {signal}: {bits} bits from bit {start_bit} do not fit")]
    Bits {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
        /// First bit.
        start_bit: u64,
        /// Number of bits.
        bits: u64,
    },
    /// Scale, offset or limits are not usable numbers.
    #[error("message {message}, signal {signal}: {what} {value} is not usable")]
    Number {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
    },
    /// The signal is multiplexed in a way that is not known here.
    #[error(
        "message {message}, signal {signal}: only one multiplexor that all multiplexed signals share is supported"
    )]
    Multiplexing {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
    },
    /// Two signals that are used take the same bits.
    #[error("message {message}: signals {signal} and {other} overlap")]
    Overlap {
        /// Message.
        message: String,
        /// One signal.
        signal: String,
        /// The other.
        other: String,
    },
    /// A counter is not an unsigned integer of 1 to 16 bits.
    #[error(
        "message {message}: counter {signal} must be unsigned with 1 to 16 bits, it has {bits}"
    )]
    Counter {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
        /// Its bits.
        bits: usize,
    },
    /// A checksum does not fill one byte.
    #[error("message {message}: checksum {signal} must fill one byte")]
    Checksum {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
    },
    /// Signals of one message are on different pages of a multiplexor.
    #[error("message {message}: the signals used are not on one page")]
    Pages {
        /// Message.
        message: String,
    },
    /// A controlword or statusword is not as CiA 402 has it.
    #[error("message {message}: {signal} must be unsigned with 16 bits, scale 1 and offset 0")]
    Word {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
    },
    /// A signal has no raw value for a state.
    #[error("message {message}, signal {signal}: cannot hold {value}")]
    State {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
        /// Value of the state.
        value: f64,
    },
    /// A message has an identifier that CANopen uses otherwise.
    #[error("message {message}: identifier {id} belongs to a service of CANopen")]
    ServiceId {
        /// Message.
        message: String,
        /// Its identifier.
        id: FrameId,
    },
}

fn suggested(names: &[String]) -> String {
    match names {
        [] => String::new(),
        names => format!("; near to it: {}", names.join(", ")),
    }
}
