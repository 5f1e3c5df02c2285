use super::{DIAGNOSTICS_PERIOD_S, ground_around};
use crate::closed_loop::Observer;
use anyhow::Result;
use sidehill_bridge::recording::{
    DriveMessages, GeneralState, McapRecording, PathRecord, PlanView, RecordingStatus, StepRecord,
};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::controller::Controller;
use sidehill_plant::terrain::Terrain;
use sidehill_plant::vehicle::Vehicle;

/// Records a simulation, whose time counts from 0.
pub struct SimulationRecording {
    file: McapRecording,
    messages: DriveMessages,
    terrain: Terrain,
    steps: u64,
    plan: PlanView,
    diagnostics_s: f64,
}

impl SimulationRecording {
    pub(crate) fn new(file: McapRecording, vehicle: &Vehicle, terrain: &Terrain) -> Self {
        Self {
            file,
            messages: DriveMessages::new(vehicle, 0.0),
            terrain: terrain.clone(),
            steps: 0,
            plan: PlanView::default(),
            diagnostics_s: f64::NEG_INFINITY,
        }
    }

    /// Closes the file, and returns how the recording fared.
    pub fn finish(self) -> RecordingStatus {
        self.file.finish()
    }
}

impl Observer for SimulationRecording {
    fn begin(&mut self, controller: &Controller) -> Result<()> {
        let path = PathRecord::initial(controller);
        let curve = controller
            .reference()
            .and_then(|reference| reference.path());
        let ground = ground_around(&self.terrain, curve);
        self.messages.begin(0.0, &[ground], &mut self.file);
        if let Some(path) = path {
            self.messages.path(0.0, &path, &mut self.file);
        }
        Ok(())
    }

    fn cycle(&mut self, cycle: &Cycle, controller: &Controller) -> Result<()> {
        let step = StepRecord {
            index: self.steps,
            sample: cycle.sample,
            engaged: true,
            path: 0,
            cut_at: controller.was_cut_at(),
            decision: cycle.decision,
        };
        self.steps += 1;
        self.messages.truth(&cycle.state, &mut self.file);
        self.messages.step(&step, &mut self.file);
        let time_s = cycle.state.time_s;
        self.plan
            .set(time_s, controller, controller.config().stages);
        self.messages.plan(&self.plan, &mut self.file);
        if time_s >= self.diagnostics_s + DIAGNOSTICS_PERIOD_S {
            self.diagnostics_s = time_s;
            let status = self.file.status().clone();
            let general = GeneralState {
                recording: Some(&status),
                lost: 0,
            };
            self.messages.diagnostics(time_s, &general, &mut self.file);
        }
        if let Some(reason) = &self.file.status().ended {
            anyhow::bail!("--record: {reason}");
        }
        Ok(())
    }
}
