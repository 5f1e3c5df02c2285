use crate::database::DatabaseError;
use sidehill_plant::vehicle::RangeError;

/// Why a layout cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum LayoutError {
    /// A name is not in the database, or what it names there cannot be used.
    #[error(transparent)]
    Database(#[from] DatabaseError),
    /// A number of `can.yaml` is out of range.
    #[error("message {message}: {error}")]
    Range {
        /// Message it belongs to.
        message: String,
        /// Key, value and range.
        error: RangeError,
    },
    /// The message needs a counter.
    #[error("message {message} needs a counter, which identifies its pair")]
    NoCounter {
        /// Message.
        message: String,
    },
    /// Traction, steer or enable is missing or given more than once.
    #[error("command: {what} is given {times} times, must be {expected}")]
    Command {
        /// Which.
        what: &'static str,
        /// How often.
        times: usize,
        /// How often it must be.
        expected: &'static str,
    },
    /// A list of states is empty, or a value is in two of them.
    #[error("message {message}, signal {signal}: states: {what}")]
    States {
        /// Message.
        message: String,
        /// Signal.
        signal: String,
        /// What is wrong.
        what: String,
    },
    /// Two messages have the same identifier.
    #[error("messages {message} and {other} are one and the same")]
    SharedMessage {
        /// One.
        message: String,
        /// The other.
        other: String,
    },
    /// Neither profile, or both.
    #[error("give either `command` and `feedback`, or `cia402`")]
    Profile,
    /// The two drives do not form a pair.
    #[error(
        "cia402.drives: the roles must be traction and steer, or left and right, in this order"
    )]
    Roles,
    /// A node has the number of another, or one that CANopen does not have.
    #[error("cia402: node_id {node} is out of range (from 1 to 127) or given twice")]
    Node {
        /// The number.
        node: u8,
    },
    /// A value does not fit its object.
    #[error("cia402: object {object:#06X}:{sub:02X}: {value} does not fit")]
    Object {
        /// Index.
        object: u16,
        /// Subindex.
        sub: u8,
        /// Value.
        value: i64,
    },
    /// A number of `cia402` is out of range.
    #[error("cia402.{0}")]
    Cia402(RangeError),
}
