//! Scheduling of Linux.

use rustix::io::Errno;
use rustix::mm::{MlockAllFlags, mlockall};
use rustix::thread::{ClockId as SleepClock, CpuSet, clock_nanosleep_absolute, sched_setaffinity};
use rustix::time::{ClockId, Timespec, clock_gettime};
use std::io;
use std::os::unix::thread::JoinHandleExt;
use std::thread::JoinHandle;
use std::time::Duration;
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

/// Sleeps for a time, until an instant of the monotonic clock: a program that was suspended beyond it goes on at once,
/// and does not sleep for what was left before.
pub(crate) fn sleep(time: Duration) {
    let Ok(time) = Timespec::try_from(time) else {
        return;
    };
    let until = clock_gettime(ClockId::Monotonic) + time;
    // A signal ends the sleep early.
    while clock_nanosleep_absolute(SleepClock::Monotonic, &until) == Err(Errno::INTR) {}
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
