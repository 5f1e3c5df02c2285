//! Systems without real-time settings, on which Sidehill simulates and identifies.

use std::io;
use std::thread::JoinHandle;

/// A thread, which has no settings.
pub type ThreadId = ();

/// Returns the system's identifier of a thread.
pub fn thread_id<T>(_: &JoinHandle<T>) -> ThreadId {}

pub(crate) use std::thread::sleep;

pub(crate) fn this_thread() -> ThreadId {}

pub(crate) fn lock_memory() -> io::Result<()> {
    refused()
}

pub(crate) fn pin(_: usize) -> io::Result<()> {
    refused()
}

pub(crate) fn set_fifo((): ThreadId, _: u8) -> io::Result<()> {
    refused()
}

pub(crate) fn set_normal() -> io::Result<()> {
    refused()
}

fn refused() -> io::Result<()> {
    Err(io::Error::new(
        io::ErrorKind::Unsupported,
        "only Linux has real-time settings",
    ))
}
