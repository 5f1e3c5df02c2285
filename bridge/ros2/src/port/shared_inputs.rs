//! What the threads of the ROS 2 side share: transforms, the emergency stop, and counts.

use super::emergency_stop::EmergencyStopMonitor;
use super::graph_monitor::GraphMonitor;
use sidehill_bridge::control_loop::channel::SharedCause;
use sidehill_bridge::ros2::transforms::Transforms;
use std::collections::VecDeque;
use std::fmt::Display;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Notes that are kept until they are taken, at most.
const NOTES_MAX: usize = 100;

/// An event for the screen and the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Kind of event, such as `goal`.
    pub event: &'static str,
    /// What has happened.
    pub message: String,
}

/// Inputs that more than one thread reads. No lock is held for longer than one message takes.
#[derive(Default)]
pub(crate) struct SharedInputs {
    transforms: Mutex<Transforms>,
    last_rejection: Mutex<String>,
    notes: Mutex<VecDeque<Note>>,
    rejected: AtomicU64,
    graph: Mutex<GraphMonitor>,
    estop_publishers: Mutex<EmergencyStopMonitor>,
    /// Why the emergency stop halts the drives, if it does.
    pub(crate) emergency_stop: SharedCause,
    /// Jumps of the clock, that of `/clock` or the system's.
    pub(crate) clock_jumps: AtomicU64,
    /// Bits of the speed, m/s, and the yaw rate, rad/s, below which odometry counts as 0.
    velocity_thresholds: [AtomicU64; 2],
}

impl SharedInputs {
    /// Returns the known transforms.
    pub(crate) fn transforms(&self) -> MutexGuard<'_, Transforms> {
        locked(&self.transforms)
    }

    /// Returns the publishers of the emergency stop.
    pub(crate) fn estop_publishers(&self) -> MutexGuard<'_, EmergencyStopMonitor> {
        locked(&self.estop_publishers)
    }

    /// Counts a message that was rejected, and keeps the reason.
    pub(crate) fn reject(&self, topic: &str, reason: &dyn Display) {
        self.rejected.fetch_add(1, Ordering::Relaxed);
        let reason = reason.to_string();
        self.graph().rejected(topic, &reason);
        *locked(&self.last_rejection) = format!("{topic}: {reason}");
    }

    /// Notes an event for the screen and the log.
    pub(crate) fn note(&self, event: &'static str, message: String) {
        let mut notes = locked(&self.notes);
        if notes.len() == NOTES_MAX {
            notes.pop_front();
        }
        notes.push_back(Note { event, message });
    }

    /// Returns the notes since the last call.
    pub(crate) fn take_notes(&self) -> VecDeque<Note> {
        std::mem::take(&mut *locked(&self.notes))
    }

    /// Returns the topics that are waited for and their publishers.
    pub(crate) fn graph(&self) -> MutexGuard<'_, GraphMonitor> {
        locked(&self.graph)
    }

    /// Returns how many messages were rejected.
    pub(crate) fn rejected(&self) -> u64 {
        self.rejected.load(Ordering::Relaxed)
    }

    /// Returns topic and reason of the last rejection; empty before the first.
    pub(crate) fn last_rejection(&self) -> String {
        locked(&self.last_rejection).clone()
    }

    /// Sets the speed, m/s, and the yaw rate, rad/s, below which odometry counts as 0.
    pub(crate) fn set_velocity_thresholds(&self, thresholds: [f64; 2]) {
        for (slot, value) in self.velocity_thresholds.iter().zip(thresholds) {
            slot.store(value.to_bits(), Ordering::Relaxed);
        }
    }

    /// Returns them.
    pub(crate) fn velocity_thresholds(&self) -> [f64; 2] {
        let [speed, yaw_rate] = &self.velocity_thresholds;
        [speed, yaw_rate].map(|slot| f64::from_bits(slot.load(Ordering::Relaxed)))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
