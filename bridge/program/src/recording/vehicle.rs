use anyhow::Result;
use sidehill::config::Prepared;
use sidehill::recording::{DIAGNOSTICS_PERIOD_S, ground_around};
use sidehill_bridge::drives::Epoch;
use sidehill_plant::simulation::TrueState;
use sidehill_recording::{DriveMessages, GeneralState, RecordingStatus, Sinks};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, sync_channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// Capacity for states that wait for the disk: 10 s at 100 Hz.
const STATES: usize = 1024;
/// Longest wait for a state before the file is flushed.
const WAIT: Duration = Duration::from_millis(100);

/// Records or shows a virtual vehicle from its own thread, so that the vehicle never waits for the disk. Its
/// controller runs elsewhere.
pub(crate) struct VehicleRecording {
    states: SyncSender<TrueState>,
    lost: Arc<AtomicU64>,
    thread: JoinHandle<Option<RecordingStatus>>,
}

impl VehicleRecording {
    /// Starts the thread.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub(crate) fn start(mut sinks: Sinks, world: &Prepared, epoch: Epoch) -> Result<Self> {
        let messages = DriveMessages::new(&world.vehicle, epoch.unix_s(0.0));
        let ground = ground_around(&world.terrain, world.reference.path());
        messages.begin(0.0, &[ground], &mut sinks);
        let (states, arriving) = sync_channel(STATES);
        let lost = Arc::new(AtomicU64::new(0));
        let counted = Arc::clone(&lost);
        let thread = std::thread::Builder::new()
            .name("recording".to_owned())
            .spawn(move || write(&arriving, sinks, messages, &counted))?;
        Ok(Self {
            states,
            lost,
            thread,
        })
    }

    /// Takes the state after a report, or counts it as lost.
    pub(crate) fn take(&self, state: &TrueState) {
        if self.states.try_send(*state).is_err() {
            self.lost.fetch_add(1, Ordering::Relaxed);
        }
    }

    /// Writes the remaining states, closes the file, and returns the status of the recording; none without one.
    pub(crate) fn finish(self) -> Option<RecordingStatus> {
        drop(self.states);
        self.thread.join().ok()?
    }
}

/// Writes states until the sender is dropped.
fn write(
    states: &Receiver<TrueState>,
    mut sinks: Sinks,
    mut messages: DriveMessages,
    lost: &AtomicU64,
) -> Option<RecordingStatus> {
    let mut diagnostics_s = f64::NEG_INFINITY;
    loop {
        match states.recv_timeout(WAIT) {
            Ok(state) => {
                messages.vehicle(&state, &mut sinks);
                if state.time_s >= diagnostics_s + DIAGNOSTICS_PERIOD_S {
                    diagnostics_s = state.time_s;
                    let status = sinks.status().cloned();
                    let general = GeneralState {
                        recording: status.as_ref(),
                        lost: lost.load(Ordering::Relaxed),
                    };
                    messages.diagnostics(state.time_s, &general, &mut sinks);
                }
            }
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => return sinks.finish(),
        }
        sinks.flush_when_due();
    }
}
