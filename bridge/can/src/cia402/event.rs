use super::node::Emergency;
use super::sdo::SetupFault;
use super::words::error_words;
use std::fmt;

/// News of a drive.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DriveEvent {
    /// The node has started.
    Started,
    /// Its objects are written, and its node is operational.
    Ready,
    /// Its objects could not be written. The setup is retried.
    SetupFailed(SetupFault),
    /// It has sent an emergency.
    Emergency(Emergency),
    /// Its setup has no deadline for commands, or no reaction to one that passes.
    NoDeadline,
    /// Its mode of operation could not be read.
    ModeUnread,
    /// It is on in this mode of operation, which is not that of its setup.
    OtherMode(i8),
    /// Another node has switched it on, and its node has been stopped.
    SwitchedOnByAnother,
    /// It was on and left operational, and its node has been stopped.
    LeftOperational,
    /// It was not off in time, and its node has been stopped.
    NodeStopped,
}

impl fmt::Display for DriveEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Started => write!(f, "it has started"),
            Self::Ready => write!(f, "set up and operational"),
            Self::SetupFailed(fault) => write!(f, "not set up: {fault}"),
            Self::Emergency(Emergency { code: 0, .. }) => write!(f, "its error has gone"),
            Self::Emergency(Emergency { code, register }) => {
                let words = error_words(*code);
                write!(
                    f,
                    "emergency {code:#06X}, error register {register:#04X}: {words}"
                )
            }
            Self::NoDeadline => write!(
                f,
                "no deadline for commands in its setup (objects 0x1400:05 and 0x6007): without this program it stops only \
                 if nobody else sends this program's heartbeat"
            ),
            Self::ModeUnread => write!(f, "its mode of operation cannot be read (object 0x6061)"),
            Self::OtherMode(mode) => {
                write!(
                    f,
                    "on in mode of operation {mode} (object 0x6061), not that of its setup"
                )
            }
            Self::SwitchedOnByAnother => {
                write!(f, "switched on by another node, stopped as a node")
            }
            Self::LeftOperational => {
                write!(f, "no longer operational while on, stopped as a node")
            }
            Self::NodeStopped => write!(f, "not off in time, stopped as a node"),
        }
    }
}
