//! What a report needs of a recording.

use crate::recording::datum;
use anyhow::{Context, Result};
use serde::de::DeserializeOwned;
use sidehill_bridge::ros2::message::cdr::from_cdr;
use sidehill_bridge::ros2::message::{DiagnosticArray, Path};
use sidehill_controller::path::{GeodeticOrigin, Point2};
use sidehill_recording::live::WholeDrive;
use sidehill_recording::{
    ControllerCycle, FixState, GuardState, Header, LogLine, LoopCycle, Recording, Topic, scan,
};
use std::collections::BTreeMap;

/// A message with its time, s: since 1970, or of the simulation.
pub(super) type TimedMessage<T> = (f64, T);

/// A recording, decoded as far as a report needs it.
pub(super) struct DecodedRecording {
    pub(super) name: String,
    pub(super) header: Header,
    /// Place on earth of x = 0, y = 0.
    pub(super) datum: Option<GeodeticOrigin>,
    /// Lowest and highest x and y of paths and estimated poses, m; none where there is neither.
    pub(super) extent: Option<[Point2; 2]>,
    /// Times of the first and the last message, s.
    pub(super) range_s: [f64; 2],
    /// Steps of the controller.
    pub(super) steps: Vec<TimedMessage<ControllerCycle>>,
    /// Cycles of the control loop; none of a simulation.
    pub(super) cycles: Vec<TimedMessage<LoopCycle>>,
    pub(super) guard: Vec<GuardState>,
    /// Fixes of a satellite receiver, where poses came from one, at the times at which they came.
    pub(super) fixes: Vec<TimedMessage<FixState>>,
    pub(super) events: Vec<TimedMessage<LogLine>>,
    /// Newest values of the controller's diagnostics.
    pub(super) diagnostics: BTreeMap<String, String>,
    /// Why reading ended early.
    pub(super) damaged: Option<String>,
    /// The drive as the page shows it.
    pub(super) drive: WholeDrive,
}

impl DecodedRecording {
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
            extent: None,
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
            Topic::ControllerCycle => {
                push(&mut self.steps, message, |step| (time_s, step));
                if let Some((_, step)) = self.steps.last() {
                    self.extend(step.estimated_x_m, step.estimated_y_m);
                }
            }
            Topic::Path => {
                let path: Result<Path, _> = from_cdr(message);
                for pose in path.into_iter().flat_map(|path| path.poses) {
                    self.extend(pose.pose.position.x, pose.pose.position.y);
                }
            }
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

    fn extend(&mut self, x_m: f64, y_m: f64) {
        if x_m.is_finite() && y_m.is_finite() {
            let [low, high] = self.extent.get_or_insert([Point2 { x_m, y_m }; 2]);
            (low.x_m, low.y_m) = (low.x_m.min(x_m), low.y_m.min(y_m));
            (high.x_m, high.y_m) = (high.x_m.max(x_m), high.y_m.max(y_m));
        }
    }

    /// Returns the place on earth of x = 0, y = 0.
    ///
    /// # Errors
    /// A recording without one.
    pub(super) fn place_on_earth(&self) -> Result<&GeodeticOrigin> {
        let datum = self.datum.as_ref();
        let missing = || {
            format!(
                "{}: it has no place on earth: its configuration has neither `datum` nor a GPX route. Add `datum: \
                 {{latitude_deg: ..., longitude_deg: ...}}`, the place of x = 0, y = 0, before the drive is recorded",
                self.name
            )
        };
        datum.with_context(missing)
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
