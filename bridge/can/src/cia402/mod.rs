//! What drives say that speak CANopen with the profile CiA 402, in a velocity mode; [`crate::canopen`] has both ends.
//!
//! No crate is used: those there are cover CiA 301 with object dictionaries, block transfers and
//! runtimes of their own, are young, and leave CiA 402 to the user; what is needed of CiA 301 here
//! is four kinds of frames.

mod event;
pub(crate) mod node;
mod node_id;
pub(crate) mod objects;
mod power;
mod sdo;
mod settings;
mod words;

pub use event::DriveEvent;
pub(crate) use node::SYNC;
pub use node::{Emergency, Latest, NmtCommand, NmtState, NodeReading};
pub use node_id::NodeId;
pub use power::{Controlword, PowerState};
pub use sdo::{SdoAnswer, SdoRequest, SetupFault};
pub use settings::Cia402;
pub(crate) use words::PROFILE_402;
pub use words::{device_words, error_words, mode_words, register_words, statusword_notes};
