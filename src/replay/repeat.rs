//! Recorded samples through a controller.

use super::rebuild::Rebuilt;
use anyhow::{Context, Result};
use sidehill_bridge::control_loop::runner::engage;
use sidehill_bridge::recording::{PathRecord, Recording};
use sidehill_controller::controller::{Controller, Decision};
use sidehill_plant::frames::{Attitude, PlanarPose};
use sidehill_plant::speeds::MotorSpeeds;

/// What a replayed cycle decided.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) time_s: f64,
    pub(super) command: MotorSpeeds,
    pub(super) status: String,
    pub(super) estimate: Option<(PlanarPose, Attitude)>,
    pub(super) cross_track_m: f64,
    pub(super) solve_us: f64,
}

impl Step {
    pub(super) fn of(decision: &Decision) -> Self {
        Self {
            time_s: decision.time_s,
            command: decision.command_effective,
            status: decision.status.to_string(),
            estimate: decision
                .estimate
                .map(|estimate| (estimate.pose, estimate.attitude)),
            cross_track_m: decision
                .progress
                .map_or(f64::NAN, |progress| progress.cross_track_m),
            solve_us: decision
                .solve
                .map_or(f64::NAN, |solve| 1e6 * solve.solve_time_s),
        }
    }
}

/// Returns the decisions of a controller that gets what the recorded one got, in the same order. One
/// that was `changed` is not cut short where the recorded one was.
///
/// # Errors
/// A path that the recording has lost.
pub(super) fn repeat(recording: &Recording, rebuilt: &Rebuilt, changed: bool) -> Result<Vec<Step>> {
    let mut controller = rebuilt.controller()?;
    if let Some(initial) = recording.paths.get(&0) {
        apply(&mut controller, rebuilt, initial);
    }
    let mut engaged = !rebuilt.held;
    if rebuilt.held {
        controller.request_stop();
    }
    let mut steps = Vec::with_capacity(recording.cycles.len());
    for cycle in &recording.cycles {
        if cycle.engaged != engaged {
            engaged = cycle.engaged;
            engage(&mut controller, engaged);
        }
        if cycle.path != 0 {
            let record = recording.paths.get(&cycle.path).with_context(|| {
                format!(
                    "path {} of cycle {} was not recorded",
                    cycle.path, cycle.index
                )
            })?;
            apply(&mut controller, rebuilt, record);
        }
        let cut_at = cycle.cut_at().filter(|_| !changed);
        let decision = controller.repeat_step(&cycle.sample(), cut_at);
        steps.push(Step::of(&decision));
    }
    Ok(steps)
}

fn apply(controller: &mut Controller, rebuilt: &Rebuilt, record: &PathRecord) {
    match &record.path {
        Some(path) => controller.follow(rebuilt.reference(path)),
        None => controller.forget_path(),
    }
}
