//! Records of the control loop and the controller as the messages that a replay reads.

use super::messages::{ControllerCycle, GuardState, LoopCycle, PathCommand};
use sidehill_bridge::control_loop::record::CycleRow;
use sidehill_bridge::control_loop::tap::{PathRecord, StepRecord};
use sidehill_bridge::ros2::message::cdr::to_cdr;
use sidehill_controller::guard::GuardView;
use sidehill_plant::frames::PlanarPose;

/// Distance between the points of a path that is shown, m.
const PATH_STEP_M: f64 = 0.1;
/// Points of a path that is shown, at most.
const PATH_POINTS: f64 = 5000.0;

/// Returns a cycle of the control loop.
pub(super) fn loop_cycle(row: &CycleRow) -> LoopCycle {
    LoopCycle {
        time_s: row.time_s,
        lateness_s: row.lateness_s,
        slack_s: row.slack_s,
        state: format!("{:?}", row.state).to_lowercase(),
        enable: row.enable,
        traction_m_s: row.traction_m_s,
        steer_m_s: row.steer_m_s,
        sent: row.sent,
        feedback_traction_m_s: row.feedback_traction_m_s,
        feedback_steer_m_s: row.feedback_steer_m_s,
        feedback_age_s: row.feedback_age_s,
        link: format!("{:?}", row.bus).to_lowercase(),
        refused: row.refused,
        skipped: row.skipped,
    }
}

/// Returns what the steepness guard finds.
pub(super) fn guard_state(time_s: f64, view: &GuardView) -> GuardState {
    GuardState {
        time_s,
        rollover_margin: view.rollover_margin,
        friction_use: view.friction_use,
        friction: view.friction,
        speed_share: view.speed_share,
        place_ahead: view.ahead.is_some(),
        place_in_s: view.ahead.map_or(f64::NAN, |place| place.in_s),
    }
}

/// Returns a path as the controller received it.
pub(super) fn path_command(record: &PathRecord) -> PathCommand {
    let mut message = PathCommand {
        serial: record.serial,
        ..PathCommand::default()
    };
    if let Some(path) = &record.path {
        message.present = true;
        message.number = path.number;
        message.laps = path.laps;
        message.joined = path.from_m.is_some();
        message.from_m = path.from_m.unwrap_or(0.0);
        message.trajectory = to_cdr(&path.trajectory).unwrap_or_default();
    }
    message
}

/// Returns evenly spaced poses along a path, to be displayed; none without a path.
pub(super) fn path_poses(record: &PathRecord) -> Vec<PlanarPose> {
    let path = record.path.as_ref().and_then(|path| path.trajectory.path());
    path.map_or_else(Vec::new, |path| {
        let count = (path.length_m() / PATH_STEP_M)
            .ceil()
            .clamp(1.0, PATH_POINTS);
        (0..=count as usize)
            .map(|i| path.at(path.length_m() * i as f64 / count).pose())
            .collect()
    })
}

impl From<&StepRecord> for ControllerCycle {
    /// Returns a step of the controller; what it did not have is NaN.
    fn from(step: &StepRecord) -> Self {
        let (sample, decision) = (&step.sample, &step.decision);
        let (speeds, attitude, pose) = (&sample.tread_speeds, &sample.attitude, &sample.pose);
        let estimate = decision.estimate.as_ref();
        let progress = decision.progress.as_ref();
        let solve = decision.solve.as_ref();
        let nan = f64::NAN;
        Self {
            index: step.index,
            time_s: sample.time_s,
            engaged: step.engaged,
            path: step.path,
            cut: step.cut_at.is_some(),
            cut_at: step.cut_at.unwrap_or(0),
            has_tread_speeds: speeds.is_some(),
            tread_speeds_time_s: speeds.map_or(nan, |speeds| speeds.time_s),
            left_m_s: speeds.map_or(nan, |speeds| speeds.value.left_m_s),
            right_m_s: speeds.map_or(nan, |speeds| speeds.value.right_m_s),
            has_attitude: attitude.is_some(),
            attitude_time_s: attitude.map_or(nan, |attitude| attitude.time_s),
            roll_rad: attitude.map_or(nan, |attitude| attitude.value.roll_rad),
            pitch_rad: attitude.map_or(nan, |attitude| attitude.value.pitch_rad),
            has_pose: pose.is_some(),
            pose_time_s: pose.map_or(nan, |pose| pose.time_s),
            x_m: pose.map_or(nan, |pose| pose.value.x_m),
            y_m: pose.map_or(nan, |pose| pose.value.y_m),
            z_m: pose.map_or(nan, |pose| pose.value.z_m),
            yaw_rad: pose.map_or(nan, |pose| pose.value.yaw_rad),
            traction_m_s: decision.command_effective.traction_m_s,
            steer_m_s: decision.command_effective.steer_m_s,
            status: decision.status.to_string(),
            reference: decision.reference,
            estimated_x_m: estimate.map_or(nan, |estimate| estimate.pose.x_m),
            estimated_y_m: estimate.map_or(nan, |estimate| estimate.pose.y_m),
            estimated_yaw_rad: estimate.map_or(nan, |estimate| estimate.pose.yaw_rad),
            estimated_roll_rad: estimate.map_or(nan, |estimate| estimate.attitude.roll_rad),
            estimated_pitch_rad: estimate.map_or(nan, |estimate| estimate.attitude.pitch_rad),
            model_error_m_s: estimate.map_or(nan, |estimate| estimate.model_error_m_s),
            pose_age_s: estimate.map_or(nan, |estimate| estimate.pose_age_s),
            cross_track_m: progress.map_or(nan, |progress| progress.cross_track_m),
            arc_length_m: progress.map_or(nan, |progress| progress.arc_length_m),
            solver_iterations: solve.map_or(0, |solve| solve.iterations),
            solver_path: solve.map_or_else(String::new, |solve| format!("{:?}", solve.path)),
            solve_us: solve.map_or(nan, |solve| 1e6 * solve.solve_time_s),
            has_yaw_rate: sample.yaw_rate.is_some(),
            yaw_rate_time_s: sample.yaw_rate.map_or(nan, |yaw_rate| yaw_rate.time_s),
            yaw_rate_rad_s: sample.yaw_rate.map_or(nan, |yaw_rate| yaw_rate.value),
        }
    }
}
