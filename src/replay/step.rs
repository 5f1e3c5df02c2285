use sidehill_controller::controller::Decision;
use sidehill_plant::frames::{Attitude, PlanarPose};
use sidehill_plant::speeds::MotorSpeeds;

/// Decision of a replayed cycle.
#[derive(Debug, Clone)]
pub(super) struct Step {
    pub(super) time_s: f64,
    pub(super) command: MotorSpeeds,
    pub(super) status: String,
    pub(super) estimate: Option<(PlanarPose, Attitude)>,
    pub(super) cross_track_m: f64,
    /// Way along the path, m.
    pub(super) arc_length_m: f64,
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
            arc_length_m: decision
                .progress
                .map_or(f64::NAN, |progress| progress.arc_length_m),
            solve_us: decision
                .solve
                .map_or(f64::NAN, |solve| 1e6 * solve.solve_time_s),
        }
    }
}
