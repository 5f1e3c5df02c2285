//! What the threads of the ROS 2 side share: transforms, the emergency stop, and counts.

use super::emergency_stop::EmergencyStopMonitor;
use super::fixes::FixReading;
use super::graph_monitor::GraphMonitor;
use super::stamp_clock::SYSTEM_JUMP_S;
use sidehill_bridge::control_loop::channel::SharedCause;
use sidehill_bridge::ros2::transforms::Transforms;
use sidehill_recording::Obstacles;
use std::collections::VecDeque;
use std::fmt::Display;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Notes that are kept until they are taken, at most.
const NOTES_MAX: usize = 100;

/// Fixes that are kept until they are taken, at most: 10 s of a receiver at 20 Hz.
const FIXES_MAX: usize = 200;

/// An event for the screen and the log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct InputEvent {
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
    notes: Mutex<VecDeque<InputEvent>>,
    fixes: Mutex<VecDeque<FixReading>>,
    obstacles: Mutex<Option<(f64, Obstacles)>>,
    rejected: AtomicU64,
    graph: Mutex<GraphMonitor>,
    estop_publishers: Mutex<EmergencyStopMonitor>,
    /// Why the emergency stop halts the drives, if it does.
    pub(crate) emergency_stop: SharedCause,
    /// Local time, s, as bits, until which this computer's clock is behind what it was before.
    deaf_until_s: AtomicU64,
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
        notes.push_back(InputEvent { event, message });
    }

    /// Returns the notes since the last call.
    pub(crate) fn take_notes(&self) -> VecDeque<InputEvent> {
        std::mem::take(&mut *locked(&self.notes))
    }

    /// Keeps a fix for the recording.
    pub(crate) fn fix(&self, fix: FixReading) {
        let mut fixes = locked(&self.fixes);
        if fixes.len() == FIXES_MAX {
            fixes.pop_front();
        }
        fixes.push_back(fix);
    }

    /// Returns the fixes since the last call.
    pub(crate) fn take_fixes(&self) -> VecDeque<FixReading> {
        std::mem::take(&mut *locked(&self.fixes))
    }

    /// Keeps the obstacles at a time, s, for recording and live view: the newest.
    pub(crate) fn show_obstacles(&self, time_s: f64, obstacles: Obstacles) {
        *locked(&self.obstacles) = Some((time_s, obstacles));
    }

    /// Returns the obstacles and their time, s, unless the last call did.
    pub(crate) fn take_obstacles(&self) -> Option<(f64, Obstacles)> {
        locked(&self.obstacles).take()
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

    /// Takes that this computer's clock was set by `step_s` at the local time `now_s`. Without the patch 0006 of
    /// `bridge/patches` RustDDS delivers best-effort messages in the order of that clock: none until it has caught up.
    pub(crate) fn clock_was_set(&self, step_s: f64, now_s: f64) {
        let until_s = f64::from_bits(self.deaf_until_s.load(Ordering::Relaxed));
        let until_s = until_s.max(now_s) - step_s;
        self.deaf_until_s
            .store(until_s.to_bits(), Ordering::Relaxed);
    }

    /// Returns why a publisher of the emergency stop may not be heard at the local time `now_s`.
    pub(crate) fn unheard_stop(&self, now_s: f64) -> Option<String> {
        let until_s = f64::from_bits(self.deaf_until_s.load(Ordering::Relaxed));
        let left_s = until_s - now_s;
        self.graph().unheard_publisher().or_else(|| {
            (left_s > SYSTEM_JUMP_S).then(|| {
                format!(
                    "this computer's clock was set back, and best-effort messages are not heard for {left_s:.0} s \
                     more; start the program again"
                )
            })
        })
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_clock_that_was_set_back_is_waited_for() {
        let inputs = SharedInputs::default();
        let unheard = |now_s| inputs.unheard_stop(now_s).is_some();
        assert!(!unheard(10.0));
        for (step_s, at_s) in [(100.0, 10.0), (-0.4, 11.0)] {
            inputs.clock_was_set(step_s, at_s);
            assert!(!unheard(at_s));
        }
        inputs.clock_was_set(-50.0, 20.0);
        assert!(unheard(20.0) && unheard(69.0) && !unheard(70.0));
        // It is set right again.
        inputs.clock_was_set(20.0, 30.0);
        assert!(unheard(49.0) && !unheard(50.0));
        inputs.clock_was_set(40.0, 31.0);
        assert!(!unheard(31.0));
    }
}
