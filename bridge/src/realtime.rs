//! What a thread asks of the system to be on time; each part optional, each refusal explained.

use serde::{Deserialize, Serialize};
use sidehill_plant::vehicle::RangeError;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// What is asked for; nothing by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RealtimeConfig {
    /// Priority under `SCHED_FIFO`, from 1 to 99.
    pub fifo_priority: Option<u8>,
    /// The only CPU to run on.
    pub cpu: Option<usize>,
    /// Whether all memory is kept from being paged out.
    pub lock_memory: bool,
}

/// What the system refused.
#[derive(Debug, thiserror::Error)]
pub enum RealtimeError {
    /// A setting is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// No real-time priority.
    #[error(
        "SCHED_FIFO priority {priority} is not permitted ({reason}): give the program CAP_SYS_NICE or a limit `rtprio`, or leave out realtime.fifo_priority"
    )]
    Priority {
        /// Asked for.
        priority: u8,
        /// The system's reason.
        reason: String,
    },
    /// Not this CPU.
    #[error("CPU {cpu} cannot be had ({reason}): choose another for realtime.cpu, or leave it out")]
    Cpu {
        /// Asked for.
        cpu: usize,
        /// The system's reason.
        reason: std::io::Error,
    },
    /// No locked memory.
    #[error(
        "memory cannot be locked ({reason}): give the program CAP_IPC_LOCK or a limit `memlock`, or leave out realtime.lock_memory"
    )]
    Memory {
        /// The system's reason.
        reason: std::io::Error,
    },
}

/// Applies the settings to the calling thread, and the memory lock to the whole program.
///
/// # Errors
/// The first setting that is out of range or refused by the system, with what to do about it.
pub fn apply(config: &RealtimeConfig) -> Result<(), RealtimeError> {
    if config.lock_memory {
        use rustix::mm::{MlockAllFlags, mlockall};
        mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE).map_err(|errno| {
            RealtimeError::Memory {
                reason: errno.into(),
            }
        })?;
    }
    if let Some(cpu) = config.cpu {
        use rustix::thread::{CpuSet, sched_setaffinity};
        RangeError::check("realtime.cpu", cpu as f64, 0.0, 1023.0, "from 0 to 1023")?;
        let mut only = CpuSet::new();
        only.set(cpu);
        sched_setaffinity(None, &only).map_err(|errno| RealtimeError::Cpu {
            cpu,
            reason: errno.into(),
        })?;
    }
    if let Some(priority) = config.fifo_priority {
        RangeError::check(
            "realtime.fifo_priority",
            f64::from(priority),
            1.0,
            99.0,
            "from 1 to 99",
        )?;
        let refused = |reason: String| RealtimeError::Priority { priority, reason };
        let value =
            ThreadPriorityValue::try_from(priority).map_err(|error| refused(error.to_owned()))?;
        set_thread_priority_and_policy(
            thread_native_id(),
            ThreadPriority::Crossplatform(value),
            ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo),
        )
        .map_err(|error| match error {
            thread_priority::Error::OS(errno) => {
                refused(std::io::Error::from_raw_os_error(errno).to_string())
            }
            other => refused(format!("{other:?}")),
        })?;
    }
    Ok(())
}
