//! Real-time settings of the threads. Each is optional, and an error says what to do where the system
//! refuses one.

use crate::system::{self, ThreadId};
use serde::{Deserialize, Serialize};
use sidehill_plant::bounds::Bounds;
use sidehill_plant::vehicle::RangeError;
use std::io;

/// Real-time settings; none by default.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct RealtimeConfig {
    /// Priority of the control cycle under `SCHED_FIFO`. None: normal scheduling.
    pub fifo_priority: Option<u8>,
    /// Priority (here with `fifo_priority: 50`) of the controller's thread, of the CAN listener, and of the ROS 2
    /// threads that carry readings and commands, below `fifo_priority`; 0 for normal scheduling. None: 10 below
    /// `fifo_priority`.
    pub helper_fifo_priority: Option<u8>,
    /// CPU to pin the control cycle to. None: any.
    pub cpu: Option<usize>,
    /// Keep all memory from being paged out.
    pub lock_memory: bool,
}

/// A real-time setting that is out of range or that the system refused.
#[derive(Debug, thiserror::Error)]
pub enum RealtimeError {
    /// A setting is out of range.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// No real-time priority.
    #[error(
        "SCHED_FIFO priority {priority} is not permitted ({reason}): give the program CAP_SYS_NICE or a limit `rtprio`, or leave out {key}"
    )]
    Priority {
        /// The setting.
        key: &'static str,
        /// The requested value.
        priority: u8,
        /// The system's reason.
        reason: io::Error,
    },
    /// Not this CPU.
    #[error(
        "CPU {cpu} is not available ({reason}): choose another for realtime.cpu, or leave it out"
    )]
    Cpu {
        /// The requested value.
        cpu: usize,
        /// The system's reason.
        reason: io::Error,
    },
    /// No locked memory.
    #[error(
        "memory cannot be locked ({reason}): give the program CAP_IPC_LOCK or a limit `memlock`, or leave out realtime.lock_memory"
    )]
    Memory {
        /// The system's reason.
        reason: io::Error,
    },
}

const FIFO_PRIORITY: &str = "realtime.fifo_priority";
const HELPER_FIFO_PRIORITY: &str = "realtime.helper_fifo_priority";
/// Default distance between both priorities.
const HELPER_BELOW: u8 = 10;

impl RealtimeConfig {
    /// Checks the ranges.
    ///
    /// # Errors
    /// [`RangeError`] with the first key out of its range.
    pub fn validate(&self) -> Result<(), RangeError> {
        if let Some(cpu) = self.cpu {
            Bounds::new(0.0, 1023.0, "").check("realtime.cpu", cpu as f64)?;
        }
        if let Some(priority) = self.fifo_priority {
            Bounds::new(1.0, 99.0, "").check(FIFO_PRIORITY, f64::from(priority))?;
        }
        if let Some(priority) = self.helper_fifo_priority {
            let high = self.fifo_priority.unwrap_or(1) - 1;
            Bounds::new(0.0, f64::from(high), "")
                .with_note("below realtime.fifo_priority")
                .check(HELPER_FIFO_PRIORITY, f64::from(priority))?;
        }
        Ok(())
    }

    /// Applies the settings to the calling thread, which becomes the loop's, and the memory lock to the
    /// process.
    ///
    /// # Errors
    /// The first setting that is out of range or refused by the system, with what to do about it.
    pub fn apply_to_loop(&self) -> Result<(), RealtimeError> {
        self.validate()?;
        if self.lock_memory {
            system::lock_memory().map_err(|reason| RealtimeError::Memory { reason })?;
        }
        if let Some(cpu) = self.cpu {
            system::pin(cpu).map_err(|reason| RealtimeError::Cpu { cpu, reason })?;
        }
        match self.fifo_priority {
            Some(priority) => set_fifo(system::this_thread(), priority, FIFO_PRIORITY),
            None => Ok(()),
        }
    }

    /// Gives a helper thread its priority: below the loop's, so that a helper that hangs cannot keep the
    /// loop from stopping the vehicle.
    ///
    /// # Errors
    /// Where the system refuses it, with what to do about it.
    pub fn apply_to_helper(&self, thread: ThreadId) -> Result<(), RealtimeError> {
        match self.helper_priority() {
            0 => Ok(()),
            priority => set_fifo(thread, priority, HELPER_FIFO_PRIORITY),
        }
    }

    /// Runs `create` with the calling thread at the priority of helpers: the threads that it creates have
    /// that priority too, those of a library among them, which are out of reach otherwise.
    ///
    /// # Errors
    /// Where the system refuses it, with what to do about it.
    pub fn create_helpers<T>(&self, create: impl FnOnce() -> T) -> Result<T, RealtimeError> {
        if self.helper_priority() == 0 {
            return Ok(create());
        }
        self.validate()?;
        self.apply_to_helper(system::this_thread())?;
        let created = create();
        system::set_normal().map_err(|reason| RealtimeError::Priority {
            key: HELPER_FIFO_PRIORITY,
            priority: 0,
            reason,
        })?;
        Ok(created)
    }

    /// Returns the priority of helpers, 0 for none.
    fn helper_priority(&self) -> u8 {
        let below = self.fifo_priority.unwrap_or(0).saturating_sub(HELPER_BELOW);
        self.helper_fifo_priority.unwrap_or(below)
    }
}

fn set_fifo(thread: ThreadId, priority: u8, key: &'static str) -> Result<(), RealtimeError> {
    system::set_fifo(thread, priority).map_err(|reason| RealtimeError::Priority {
        key,
        priority,
        reason,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn helpers_are_always_below_the_loop() {
        let config = |fifo_priority, helper_fifo_priority| RealtimeConfig {
            fifo_priority,
            helper_fifo_priority,
            ..RealtimeConfig::default()
        };
        for (cycle, helper, expected) in [
            (None, None, 0),
            (Some(50), None, 40),
            (Some(10), None, 0),
            (Some(1), None, 0),
            (Some(50), Some(49), 49),
            (Some(50), Some(0), 0),
            (None, Some(0), 0),
        ] {
            let config = config(cycle, helper);
            assert_eq!(config.validate(), Ok(()));
            assert_eq!(config.helper_priority(), expected);
        }
        for (cycle, helper, key) in [
            (Some(0), None, FIFO_PRIORITY),
            (Some(100), None, FIFO_PRIORITY),
            (Some(50), Some(50), HELPER_FIFO_PRIORITY),
            (None, Some(1), HELPER_FIFO_PRIORITY),
        ] {
            let error = config(cycle, helper).validate().unwrap_err();
            assert_eq!(error.key, key);
        }
    }
}
