//! Scheduling of Linux.

use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{CpuSet, sched_setaffinity};
use std::io;
use std::os::unix::thread::JoinHandleExt;
use std::thread::JoinHandle;
pub use thread_priority::ThreadId;
pub(crate) use thread_priority::thread_native_id as this_thread;
use thread_priority::{
    Error, NormalThreadSchedulePolicy, RealtimeThreadSchedulePolicy, ThreadPriority,
    ThreadPriorityValue, ThreadSchedulePolicy, set_thread_priority_and_policy,
};

/// Returns the system's identifier of a thread.
pub fn thread_id<T>(thread: &JoinHandle<T>) -> ThreadId {
    thread.as_pthread_t()
}

/// Keeps all memory of the process from being paged out.
pub(crate) fn lock_memory() -> io::Result<()> {
    Ok(mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE)?)
}

/// Pins the calling thread to a CPU.
pub(crate) fn pin(cpu: usize) -> io::Result<()> {
    let mut only = CpuSet::new();
    only.set(cpu);
    Ok(sched_setaffinity(None, &only)?)
}

/// Gives a thread a priority under `SCHED_FIFO`.
pub(crate) fn set_fifo(thread: ThreadId, priority: u8) -> io::Result<()> {
    let priority = ThreadPriorityValue::try_from(priority).map_err(io::Error::other)?;
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let set =
        set_thread_priority_and_policy(thread, ThreadPriority::Crossplatform(priority), policy);
    set.map_err(reason)
}

/// Gives the calling thread normal scheduling.
pub(crate) fn set_normal() -> io::Result<()> {
    let policy = ThreadSchedulePolicy::Normal(NormalThreadSchedulePolicy::Other);
    set_thread_priority_and_policy(this_thread(), ThreadPriority::Min, policy).map_err(reason)
}

fn reason(error: Error) -> io::Error {
    match error {
        Error::OS(errno) => io::Error::from_raw_os_error(errno),
        other => io::Error::other(format!("{other:?}")),
    }
}
