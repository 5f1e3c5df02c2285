use super::{DIAGNOSTICS_PERIOD_S, ground_around};
use crate::closed_loop::Observer;
use anyhow::Result;
use sidehill_bridge::control_loop::tap::{PathRecord, PlanView, StepRecord};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::controller::Controller;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;
use sidehill_recording::{DriveMessages, GeneralState, RecordingStatus, Sinks};
use std::time::{Duration, Instant};

/// Records or shows a simulation, whose time starts at 0.
pub struct SimulationRecording {
    sinks: Sinks,
    messages: DriveMessages,
    terrain: Terrain,
    steps: u64,
    plan: PlanView,
    diagnostics_s: f64,
    /// When a simulation that keeps to real time began.
    begin: Option<Instant>,
}

impl SimulationRecording {
    pub(crate) fn new(sinks: Sinks, vehicle: &Vehicle, terrain: &Terrain, realtime: bool) -> Self {
        Self {
            sinks,
            messages: DriveMessages::new(vehicle, 0.0),
            terrain: terrain.clone(),
            steps: 0,
            plan: PlanView::default(),
            diagnostics_s: f64::NEG_INFINITY,
            begin: realtime.then(Instant::now),
        }
    }

    /// Closes the file and returns the status of the recording; none without one.
    pub fn finish(self) -> Option<RecordingStatus> {
        self.sinks.finish()
    }
}

impl Observer for SimulationRecording {
    fn begin(&mut self, controller: &Controller) -> Result<()> {
        let path = PathRecord::initial(controller);
        let curve = controller
            .reference()
            .and_then(|reference| reference.path());
        let ground = ground_around(&self.terrain, curve);
        self.messages.begin(0.0, &[ground], &mut self.sinks);
        if let Some(path) = path {
            self.messages.path(0.0, &path, &mut self.sinks);
        }
        Ok(())
    }

    fn cycle(&mut self, cycle: &Cycle, controller: &Controller) -> Result<()> {
        let time_s = cycle.state.time_s;
        if let Some(begin) = self.begin {
            let due = begin + Duration::from_secs_f64(time_s);
            std::thread::sleep(due.saturating_duration_since(Instant::now()));
        }
        let step = StepRecord {
            index: self.steps,
            sample: cycle.sample,
            engaged: true,
            path: 0,
            cut_at: controller.was_cut_at(),
            decision: cycle.decision,
            drives: controller.drive_response(),
        };
        self.steps += 1;
        self.messages.truth(&cycle.state, &mut self.sinks);
        self.messages.step(&step, &mut self.sinks);
        self.plan
            .set(time_s, controller, controller.config().stages);
        self.messages.plan(&self.plan, &mut self.sinks);
        if time_s >= self.diagnostics_s + DIAGNOSTICS_PERIOD_S {
            self.diagnostics_s = time_s;
            let status = self.sinks.status().cloned();
            let general = GeneralState {
                recording: status.as_ref(),
                lost: 0,
            };
            self.messages.diagnostics(time_s, &general, &mut self.sinks);
        }
        self.sinks.flush_when_due();
        if let Some(reason) = self.sinks.status().and_then(|status| status.ended.as_ref()) {
            anyhow::bail!("--record: {reason}");
        }
        Ok(())
    }
}
