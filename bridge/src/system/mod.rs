//! What the operating system does for a thread.

#[cfg_attr(target_os = "linux", path = "linux.rs")]
#[cfg_attr(not(target_os = "linux"), path = "elsewhere.rs")]
mod threads;

pub use threads::{ThreadId, thread_id};
pub(crate) use threads::{lock_memory, pin, set_fifo, set_normal, sleep, this_thread};
