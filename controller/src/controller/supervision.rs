//! What stops a controller: its clock, its readings, where it is on its path, and no solution.

use super::drives::Drives;
use super::parts::Law;
use super::watchdog::Observation;
use super::{Controller, Phase, Status, StopReason};
use crate::config::AttitudePreview;
use crate::estimator::Estimate;
use crate::guard::GuardInputs;
use crate::mpc::{Model, QpFailure};
use crate::reference::Progress;
use sidehill_plant::frames::wrap_angle;
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::MotorSpeeds;

/// Poses in a row that are refused from which the estimate that they contradict is doubted, and the time for which it
/// is still driven on, s.
const REFUSED_POSES: u32 = 3;
const REFUSED_S: f64 = 0.5;

/// Largest time between two cycles that is not taken for a jump of the clock, s.
const CLOCK_STEP_MAX_S: f64 = 0.5;

/// Share of the speed with which a vehicle drives whose poses are refused.
const DOUBTED_SHARE: f64 = 0.5;
/// Time that refused poses agree before the vehicle is slowed down, s.
const DOUBTED_MIN_S: f64 = 0.25;

impl Controller {
    /// Stops the vehicle at its decelerations from the next cycle on.
    pub fn request_stop(&mut self) {
        if !matches!(self.phase, Phase::Stopped(_)) {
            self.phase = Phase::Stopped(StopReason::Requested);
        }
    }

    /// Lets a stopped controller drive again, with a new estimate and a new plan: readings
    /// may have been missing for so long that the filter would reject the poses that arrive now.
    pub fn rearm(&mut self) {
        self.estimator.restart();
        if let Some(guard) = &mut self.guard {
            guard.reset();
        }
        if let Some(memory) = &mut self.memory {
            memory.reset();
        }
        self.phase = Phase::Driving { fallback_cycles: 0 };
        self.last_time_s = None;
        self.drives = Drives::new(&self.config);
        self.predictions.reset();
        self.issued.restart();
        self.way_cost_per_m = 0.0;
        self.watchdog.reset();
        self.dig.reset();
        self.discard_plan();
        if let Law::Mpc(mpc) = &mut self.law
            && let Model::Contact(model) = mpc.model_mut()
        {
            model.forget_found();
        }
    }

    /// Returns the time since the cycle before; stops if the clock stands still, jumps or is not a number.
    pub(super) fn elapsed(&mut self, now_s: f64) -> f64 {
        let Some(before_s) = self.last_time_s else {
            if now_s.is_finite() {
                self.last_time_s = Some(now_s);
            }
            return 0.0;
        };
        if now_s < before_s {
            // What was read before the clock was put back is not older than what comes now.
            self.estimator.restart();
        }
        let elapsed_s = now_s - before_s;
        if elapsed_s > 0.0 && elapsed_s <= CLOCK_STEP_MAX_S {
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

    /// Stops on stale readings, on leaving the path, and where the vehicle does not move as it should.
    pub(super) fn supervise(&mut self, estimate: Option<&Estimate>, progress: Option<&Progress>) {
        let Some(estimate) = estimate else {
            return;
        };
        self.supervise_readings(estimate);
        self.supervise_path(estimate, progress);
        self.supervise_motion(estimate, progress);
    }

    /// Counts a cycle without a solution: returns the command of the previous plan, or the next step
    /// of a stop where there is none, and stops after too many.
    pub(super) fn fall_back(&mut self, reason: QpFailure) -> (Status, MotorSpeeds) {
        let before = match self.phase {
            Phase::Driving { fallback_cycles } => fallback_cycles,
            Phase::Stopped(_) | Phase::Finished => 0,
        };
        let cycles = before + 1;
        let longest = self.config.supervisor.fallback_s / self.config.period_s;
        if f64::from(cycles) > longest + 1e-9 {
            self.stop(StopReason::NoSolution { cycles, reason });
        } else {
            self.phase = Phase::Driving {
                fallback_cycles: cycles,
            };
        }
        let command = match self.plan() {
            Some(plan) => self.drives.command(plan.inputs[0]),
            None => {
                let limits = &self.config.limits;
                limits.stop_step(self.issued.last(), self.config.period_s)
            }
        };
        (Status::Fallback { reason, cycles }, command)
    }

    /// Stops on stale readings.
    fn supervise_readings(&mut self, estimate: &Estimate) {
        let limits = self.config.supervisor;
        // Poses that agree with each other will be accepted, or the next contradicts them.
        let pose_age_s = estimate
            .poses_doubted_s
            .filter(|(doubted_s, _)| *doubted_s > 0.0)
            .map_or(estimate.pose_age_s, |(_, newest_s)| newest_s);
        let refused = estimate.poses_gated >= REFUSED_POSES;
        let oldest_s = if refused {
            REFUSED_S.min(limits.pose_timeout_s)
        } else {
            limits.pose_timeout_s
        };
        if !within(pose_age_s, oldest_s) {
            self.stop(StopReason::PoseStale {
                age_s: estimate.pose_age_s,
                gated: estimate.poses_gated,
                late: estimate.poses_late,
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
    fn supervise_path(&mut self, estimate: &Estimate, progress: Option<&Progress>) {
        let (Some(reference), Some(progress)) = (&self.reference, progress) else {
            self.stop(StopReason::NoPath);
            return;
        };
        let limits = self.config.supervisor;
        let stays = reference.stays();
        let heading_error = wrap_angle(estimate.pose.yaw_rad - progress.point.heading_rad);
        let bound_m = estimate.bound_across_m(progress.point.heading_rad);
        if !within(bound_m, limits.cross_track_uncertainty_max_m) {
            self.stop(StopReason::PoseUncertain {
                bound_m,
                age_s: estimate.pose_age_s,
                late: estimate.poses_late,
            });
        } else if !within(progress.cross_track_m.abs(), limits.cross_track_max_m) {
            self.stop(StopReason::OffPath {
                cross_track_m: progress.cross_track_m,
            });
        } else if !within(heading_error.abs(), limits.heading_error_max_rad) {
            self.stop(StopReason::HeadingOff {
                error_rad: heading_error,
            });
        }
        if progress.ended && matches!(self.phase, Phase::Driving { .. }) {
            let last = self.issued.last();
            let standing = last.traction_m_s.abs() < 0.01 && last.steer_m_s.abs() < 0.01;
            if standing || stays {
                self.phase = Phase::Finished;
            }
        }
    }

    /// Lets the guard look at the ground here and ahead.
    pub(super) fn watch_slope(&mut self, estimate: Option<&Estimate>, elapsed_s: f64) {
        let half_track_m = self.horizon.half_track_m;
        let command = self.issued.last();
        let (Some(guard), Some(estimate), Some(reference)) =
            (&mut self.guard, estimate, &self.reference)
        else {
            return;
        };
        let map = self
            .terrain
            .as_ref()
            .filter(|_| self.config.attitude_preview == AttitudePreview::Terrain);
        let stop = guard.look(&GuardInputs {
            estimate,
            reference,
            map,
            half_track_m,
            elapsed_s,
            command,
        });
        if let Some(reason) = stop {
            self.stop(reason.into());
        }
    }

    /// Returns the share of the wanted speeds that is driven with. An MPC follows a reference that the
    /// guard slows down; pure pursuit, which knows no time, is slowed down here.
    pub(super) fn slowed_share(&self, estimate: Option<&Estimate>) -> f64 {
        let doubted = estimate.and_then(|estimate| estimate.poses_doubted_s);
        let share = match doubted {
            Some((doubted_s, _)) if doubted_s >= DOUBTED_MIN_S => DOUBTED_SHARE,
            _ => 1.0,
        };
        match (&self.law, &self.guard) {
            (Law::PurePursuit, Some(guard)) => share * guard.share(),
            _ => share,
        }
    }
}

impl Controller {
    /// Stops a vehicle that does not move as it should.
    fn supervise_motion(&mut self, estimate: &Estimate, progress: Option<&Progress>) {
        let (Phase::Driving { .. }, Some(progress)) = (self.phase, progress) else {
            self.watchdog.reset();
            return;
        };
        let observation = Observation {
            time_s: estimate.time_s,
            pose: estimate.pose,
            command: self.issued.last(),
            progress,
            allowed_m_s: self.allowed_m_s(progress),
        };
        if let Some(stall) = self.watchdog.observe(&observation) {
            let time_s = self.config.supervisor.stall_time_s;
            self.stop(StopReason::Stalled { stall, time_s });
        }
    }
}

impl Controller {
    /// Returns the largest speed that drives, bend and the stops around it allow where the vehicle is, m/s.
    fn allowed_m_s(&self, progress: &Progress) -> f64 {
        let point = &progress.point;
        let curvature_per_m = match point.speed_m_s.abs() {
            0.0 => 0.0,
            speed_m_s => point.yaw_rate_rad_s / speed_m_s,
        };
        let limits = self.speed_limits();
        let allowed_m_s = limits.at(curvature_per_m).min(self.drives.passed_on_m_s());
        match &self.reference {
            Some(reference) if reference.approaches_end() => 0.0,
            Some(reference) => {
                let at_m = progress.arc_length_m;
                let (from_m, to_m) = (reference.drive_from_m(), reference.stop_at_m());
                allowed_m_s.min(limits.between_stops(at_m - from_m, to_m - at_m))
            }
            None => allowed_m_s,
        }
    }

    /// Stops treads that turn while poses stay where they are.
    pub(super) fn watch_treads(
        &mut self,
        estimate: Option<&Estimate>,
        sample: &Sample,
        elapsed_s: f64,
    ) {
        let (Phase::Driving { .. }, Some(estimate)) = (self.phase, estimate) else {
            self.dig.reset();
            return;
        };
        if let Some(reason) = self.dig.observe(sample, &estimate.treads, elapsed_s) {
            self.dig.reset();
            self.stop(reason);
        }
    }
}

/// Returns whether a value is within its limit; a NaN is not.
fn within(value: f64, limit: f64) -> bool {
    value <= limit
}

#[cfg(test)]
mod tests;
