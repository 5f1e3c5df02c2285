use super::{DIAGNOSTICS_PERIOD_S, ground_around};
use crate::config::Prepared;
use sidehill_bridge::drives::Epoch;
use sidehill_bridge::recording::{DriveMessages, GeneralState, RecordingStatus, Sinks};
use sidehill_plant::simulation::TrueState;

/// Records or shows what a virtual vehicle does. Its controller runs elsewhere.
pub(crate) struct VehicleRecording {
    sinks: Sinks,
    messages: DriveMessages,
    diagnostics_s: f64,
}

impl VehicleRecording {
    pub(crate) fn new(mut sinks: Sinks, world: &Prepared, epoch: Epoch) -> Self {
        let messages = DriveMessages::new(&world.vehicle, epoch.unix_s(0.0));
        let ground = ground_around(&world.terrain, world.reference.path());
        messages.begin(0.0, &[ground], &mut sinks);
        Self {
            sinks,
            messages,
            diagnostics_s: f64::NEG_INFINITY,
        }
    }

    /// Takes the state after a report.
    pub(crate) fn take(&mut self, state: &TrueState) {
        self.messages.vehicle(state, &mut self.sinks);
        if state.time_s >= self.diagnostics_s + DIAGNOSTICS_PERIOD_S {
            self.diagnostics_s = state.time_s;
            let status = self.sinks.status().cloned();
            let general = GeneralState {
                recording: status.as_ref(),
                lost: 0,
            };
            self.messages
                .diagnostics(state.time_s, &general, &mut self.sinks);
        }
        self.sinks.flush_when_due();
    }

    /// Closes the file, and returns how the recording fared; none without one.
    pub(crate) fn finish(self) -> Option<RecordingStatus> {
        self.sinks.finish()
    }
}
