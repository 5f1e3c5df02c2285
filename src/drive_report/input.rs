//! What a report needs of a recording.

use super::datum::datum;
use anyhow::Result;
use serde::de::DeserializeOwned;
use sidehill_bridge::ros2::message::DiagnosticArray;
use sidehill_bridge::ros2::message::cdr::from_cdr;
use sidehill_controller::path::GeodeticOrigin;
use sidehill_recording::live::WholeDrive;
use sidehill_recording::{
    ControllerCycle, FixState, GuardState, Header, LogLine, LoopCycle, Recording, Topic, scan,
};
use std::collections::BTreeMap;

/// A message with its time, s: since 1970, or of the simulation.
pub(super) type Timed<T> = (f64, T);

/// A recording, decoded as far as a report needs it.
pub(super) struct Input {
    pub(super) name: String,
    pub(super) header: Header,
    /// Place on earth of x = 0, y = 0.
    pub(super) datum: Option<GeodeticOrigin>,
    /// Times of the first and the last message, s.
    pub(super) range_s: [f64; 2],
    /// Steps of the controller.
    pub(super) steps: Vec<Timed<ControllerCycle>>,
    /// Cycles of the control loop; none of a simulation.
    pub(super) cycles: Vec<Timed<LoopCycle>>,
    pub(super) guard: Vec<GuardState>,
    /// Fixes of a satellite receiver, where poses came from one, at the times at which they came.
    pub(super) fixes: Vec<Timed<FixState>>,
    pub(super) events: Vec<Timed<LogLine>>,
    /// Newest values of the controller's diagnostics.
    pub(super) diagnostics: BTreeMap<String, String>,
    /// Why reading ended early.
    pub(super) damaged: Option<String>,
    /// The drive as the page shows it.
    pub(super) drive: WholeDrive,
}

impl Input {
    /// Reads a recording from any of its files.
    ///
    /// # Errors
    /// One that cannot be read.
    pub(super) fn read(path: &std::path::Path) -> Result<Self> {
        let recording = Recording::read(path)?;
        let mut ends_ns = [u64::MAX, 0];
        for file in &recording.files {
            scan(file, &mut |_, time_ns, _| {
                ends_ns = [ends_ns[0].min(time_ns), ends_ns[1].max(time_ns)];
                Ok(())
            })?;
        }
        let [first_ns, last_ns] = ends_ns;
        let mut input = Self {
            name: path.display().to_string(),
            datum: datum(&recording.header),
            header: recording.header,
            range_s: [first_ns.min(last_ns), last_ns].map(|ns| ns as f64 / 1e9),
            steps: Vec::with_capacity(recording.cycles.len()),
            cycles: Vec::new(),
            guard: Vec::new(),
            fixes: Vec::new(),
            events: Vec::new(),
            diagnostics: BTreeMap::new(),
            damaged: recording.damaged,
            drive: WholeDrive::new(last_ns.saturating_sub(first_ns)),
        };
        for file in &recording.files {
            scan(file, &mut |topic, time_ns, message| {
                input.take(topic, time_ns, message);
                Ok(())
            })?;
        }
        Ok(input)
    }

    fn take(&mut self, topic: Topic, time_ns: u64, message: &[u8]) {
        let time_s = time_ns as f64 / 1e9;
        self.drive.take(topic, time_ns, message);
        match topic {
            Topic::ControllerCycle => push(&mut self.steps, message, |step| (time_s, step)),
            Topic::LoopCycle => push(&mut self.cycles, message, |cycle| (time_s, cycle)),
            Topic::Guard => push(&mut self.guard, message, |guard| guard),
            Topic::Fix => push(&mut self.fixes, message, |fix| (time_s, fix)),
            Topic::Events => push(&mut self.events, message, |event| (time_s, event)),
            Topic::Diagnostics => {
                let array: Result<DiagnosticArray, _> = from_cdr(message);
                let status = array.into_iter().flat_map(|array| array.status);
                let own = status.filter(|status| status.name == "sidehill: controller");
                let values = own.flat_map(|status| status.values);
                self.diagnostics
                    .extend(values.map(|entry| (entry.key, entry.value)));
            }
            _ => {}
        }
    }

    /// Returns where the vehicle was, by its estimate: the step of a time, s.
    pub(super) fn step_at(&self, time_s: f64) -> Option<&ControllerCycle> {
        let after = self.steps.partition_point(|(at_s, _)| *at_s < time_s);
        let index = after.min(self.steps.len().checked_sub(1)?);
        Some(&self.steps[index].1)
    }
}

/// Adds a message that can be decoded. [`Recording::read`] refuses damaged steps; what is left out here is of a
/// recording that was cut off within a message.
fn push<M: DeserializeOwned, T>(list: &mut Vec<T>, message: &[u8], with: impl FnOnce(M) -> T) {
    list.extend(from_cdr(message).ok().map(with));
}
