use super::{DIAGNOSTICS_PERIOD_S, ground_around};
use crate::config::Prepared;
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::recording::{DriveMessages, GeneralState, McapRecording, RecordingStatus};
use sidehill_plant::simulation::TrueState;

/// Records what a virtual vehicle does. Its controller runs elsewhere.
pub(crate) struct VehicleRecording {
    file: McapRecording,
    messages: DriveMessages,
    diagnostics_s: f64,
}

impl VehicleRecording {
    pub(crate) fn new(mut file: McapRecording, world: &Prepared, epoch: Epoch) -> Self {
        let messages = DriveMessages::new(&world.vehicle, epoch.unix_s(0.0));
        let ground = ground_around(&world.terrain, world.reference.path());
        messages.begin(0.0, &[ground], &mut file);
        Self {
            file,
            messages,
            diagnostics_s: f64::NEG_INFINITY,
        }
    }

    /// Takes the state after a report.
    pub(crate) fn take(&mut self, state: &TrueState) {
        self.messages.vehicle(state, &mut self.file);
        if state.time_s >= self.diagnostics_s + DIAGNOSTICS_PERIOD_S {
            self.diagnostics_s = state.time_s;
            let status = self.file.status().clone();
            let general = GeneralState {
                recording: Some(&status),
                lost: 0,
            };
            self.messages
                .diagnostics(state.time_s, &general, &mut self.file);
        }
        self.file.flush_when_due();
    }

    /// Closes the file, and returns how the recording fared.
    pub(crate) fn finish(self) -> RecordingStatus {
        self.file.finish()
    }
}
