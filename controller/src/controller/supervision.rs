//! What stops a controller: its clock, its readings, and where it is on its path.

use super::{Controller, Phase, StopReason};
use crate::estimator::Estimate;
use crate::reference::Progress;
use crate::trajectory::Ending;
use sidehill_plant::frames::wrap_angle;

impl Controller {
    /// Returns the time since the cycle before; a clock that stands, jumps or is no number stops.
    pub(super) fn elapsed(&mut self, now_s: f64) -> f64 {
        let Some(before_s) = self.last_time_s else {
            if now_s.is_finite() {
                self.last_time_s = Some(now_s);
            }
            return 0.0;
        };
        let elapsed_s = now_s - before_s;
        if elapsed_s > 0.0 && elapsed_s <= self.config.supervisor.pose_timeout_s {
            self.last_time_s = Some(now_s);
            return elapsed_s;
        }
        self.stop(StopReason::ClockJump { before_s, now_s });
        if now_s.is_finite() {
            self.last_time_s = Some(now_s);
        }
        0.0
    }

    pub(super) fn stop(&mut self, reason: StopReason) {
        if matches!(self.phase, Phase::Driving { .. }) {
            self.phase = Phase::Stopped(reason);
        }
    }

    /// Stops on stale readings.
    pub(super) fn supervise_readings(&mut self, estimate: &Estimate) {
        let limits = self.config.supervisor;
        if !within(estimate.pose_age_s, limits.pose_timeout_s) {
            self.stop(StopReason::PoseStale {
                age_s: estimate.pose_age_s,
                gated: estimate.poses_gated,
            });
        } else if !within(estimate.attitude_age_s, limits.attitude_timeout_s) {
            self.stop(StopReason::AttitudeStale {
                age_s: estimate.attitude_age_s,
            });
        } else if !within(estimate.speeds_age_s, limits.speeds_timeout_s) {
            self.stop(StopReason::SpeedsStale {
                age_s: estimate.speeds_age_s,
            });
        }
    }

    /// Stops without a path, on leaving it, and at its end.
    pub(super) fn supervise_path(&mut self, estimate: &Estimate, progress: Option<&Progress>) {
        let (Some(reference), Some(progress)) = (&self.reference, progress) else {
            self.stop(StopReason::NoPath);
            return;
        };
        let limits = self.config.supervisor;
        let late = reference.time_s() > reference.end_s() + limits.settle_time_s;
        let periodic = reference.trajectory().ending() == Ending::Periodic;
        let heading_error = wrap_angle(estimate.pose.yaw_rad - progress.point.heading_rad);
        if !within(progress.cross_track_m.abs(), limits.cross_track_max_m) {
            self.stop(StopReason::OffPath {
                cross_track_m: progress.cross_track_m,
            });
        } else if !within(heading_error.abs(), limits.heading_error_max_rad) {
            self.stop(StopReason::HeadingOff {
                error_rad: heading_error,
            });
        }
        if progress.ended && matches!(self.phase, Phase::Driving { .. }) {
            let last = self.last_command();
            let standing = last.traction_m_s.abs() < 0.01 && last.steer_m_s.abs() < 0.01;
            if periodic || standing || late {
                self.phase = Phase::Finished;
            }
        }
    }
}

/// Returns whether a value is within its limit; a NaN is not.
fn within(value: f64, limit: f64) -> bool {
    value <= limit
}
