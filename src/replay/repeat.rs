//! Feeds recorded samples to a controller.

use super::begin::Begin;
use super::rebuild::Rebuilt;
use anyhow::{Context, Result};
use sidehill_bridge::control_loop::runner::engage;
use sidehill_bridge::control_loop::tap::{PathRecord, StepRecord};
use sidehill_controller::controller::Controller;
use sidehill_recording::{ControllerCycle, Recording};

/// Returns the cycles, from `begin` on, of a controller with the recorded inputs in their order. The solver of a
/// `changed` controller is not cut short where the recorded one was.
///
/// # Errors
/// A path that is missing in the recording.
pub(super) fn repeat(
    recording: &Recording,
    rebuilt: &Rebuilt,
    begin: &Begin,
    changed: bool,
) -> Result<Vec<ControllerCycle>> {
    let mut controller = rebuilt.controller()?;
    let initial = begin.earlier_path.unwrap_or(0);
    if let Some(initial) = recording.paths.get(&initial) {
        let mut initial = initial.clone();
        if let (Some(path), Some(from_m)) = (&mut initial.path, begin.from_m) {
            path.from_m = Some(from_m);
        }
        apply(&mut controller, rebuilt, &initial);
    }
    let mut engaged = !rebuilt.held;
    if rebuilt.held {
        controller.request_stop();
    }
    let mut steps = Vec::with_capacity(recording.cycles.len());
    for (i, cycle) in recording.cycles.iter().enumerate() {
        if cycle.engaged != engaged {
            engaged = cycle.engaged;
            engage(&mut controller, engaged);
        }
        let given =
            cycle.path != 0 && (i >= begin.place || recording.paths.contains_key(&cycle.path));
        if given {
            let record = recording.paths.get(&cycle.path).with_context(|| {
                format!(
                    "path {} of cycle {} was not recorded",
                    cycle.path, cycle.index
                )
            })?;
            apply(&mut controller, rebuilt, record);
        }
        let cut_at = cycle.cut_at().filter(|_| !changed);
        let sample = cycle.sample();
        let decision = controller.repeat_step(&sample, cut_at);
        if i >= begin.place {
            steps.push(ControllerCycle::from(&StepRecord {
                index: cycle.index,
                sample,
                engaged,
                path: cycle.path,
                cut_at: controller.was_cut_at(),
                decision,
                drives: controller.drive_response(),
            }));
        }
    }
    Ok(steps)
}

fn apply(controller: &mut Controller, rebuilt: &Rebuilt, record: &PathRecord) {
    match &record.path {
        Some(path) => controller.follow(rebuilt.reference(path)),
        None => controller.forget_path(),
    }
}
