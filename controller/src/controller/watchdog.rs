//! Whether the vehicle moves as its commands and its reference should make it move.

use super::decision::{Stall, StopReason};
use crate::config::SupervisorConfig;
use crate::estimator::EstimatorSettings;
use crate::mpc::limits::InputLimits;
use crate::reference::Progress;
use crate::trajectory::Motion;
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::sample::Sample;
use sidehill_plant::speeds::{MotorSpeeds, TreadSpeeds};
use std::collections::VecDeque;

/// Share of its limit from which a motor speed counts as at its limit.
const AT_LIMIT: f64 = 0.95;
/// Way that must have been asked for before progress along the path is judged, and that is progress, m.
const PROGRESS_M: f64 = 0.3;
/// A vehicle that has turned this much does not stand, rad.
const TURNED_MIN_RAD: f64 = 0.1;

/// One cycle of a vehicle that drives.
#[derive(Debug, Clone, Copy)]
pub(super) struct Observation<'a> {
    pub(super) time_s: f64,
    pub(super) pose: PlanarPose,
    /// Command of the cycle before.
    pub(super) command: MotorSpeeds,
    pub(super) progress: &'a Progress,
    /// Largest speed that the drives allow at its place as known now, m/s.
    pub(super) allowed_m_s: f64,
}

/// Sums since the watch began, so that those of a window are differences.
#[derive(Debug, Clone, Copy, Default)]
struct Sums {
    time_s: f64,
    /// Time at the steer's limit, less that at its other limit, s; so too of traction.
    steer_at_limit_s: f64,
    traction_at_limit_s: f64,
    /// Turn and way that the commands should give without slip, and those of the estimate.
    commanded_turn_rad: f64,
    commanded_way_m: f64,
    turn_rad: f64,
    way_m: f64,
    /// Way along the path that the reference's speed asks for, as far as the drives allow it.
    asked_m: f64,
    /// Where it is, and how far it has come along the path, no sums.
    x_m: f64,
    y_m: f64,
    along_m: f64,
}

/// Time for which turning treads may leave the vehicle where it is, s: they dig in.
const DIG_S: f64 = 1.4;
/// Way of the treads from which on they dig, m, and in standard deviations of the poses: noise must be far less than
/// what a vehicle moves by that.
const DIG_WAY_M: f64 = 0.25;
const DIG_WAY_SIGMAS: f64 = 20.0;
/// Share of the way of the treads by which the vehicle has to move.
const DIG_SHARE: f64 = 0.1;
/// Standard deviations of poses that are no motion.
const DIG_SIGMAS: f64 = 4.0;
/// Time for which a pose stays the same to the bit from which on its source is taken to be frozen, s: noise changes the
/// poses of a vehicle that digs.
const FROZEN_S: f64 = 0.3;
/// Time after which that way counts no more, s: the treads hardly turn.
const DIG_MOST_S: f64 = 10.0;
/// Time between the poses that are kept, s, and their number at most.
const DIG_POSES_S: f64 = 0.1;
const DIG_POSES: usize = (DIG_MOST_S / DIG_POSES_S) as usize + 1;
/// Cycles whose ways are kept: a pose is as late as 4 s at 100 Hz.
const DIG_WAYS: usize = 400;

/// How far the treads have turned, left and right, m; what they turn back is subtracted.
#[derive(Debug, Clone, Copy, Default)]
struct TreadWays([f64; 2]);

impl TreadWays {
    /// Returns the mean way of both treads from others to these.
    fn since(&self, before: &Self) -> f64 {
        0.5 * ((self.0[0] - before.0[0]).abs() + (self.0[1] - before.0[1]).abs())
    }
}

/// A pose and how far the treads had turned then.
#[derive(Debug, Clone, Copy)]
struct PoseThen {
    time_s: f64,
    pose: PlanarPose,
    ways: TreadWays,
}

/// Compares the way of the treads with poses as they come, whatever the estimator makes of them: while it waits whether
/// poses contradict each other, it believes the treads.
#[derive(Debug, Clone)]
pub(super) struct DigWatch {
    places: VecDeque<PoseThen>,
    /// The first of the newest poses that are the same to the bit.
    same: Option<PoseThen>,
    /// Instants of the cycles, s, and how far the treads had turned then.
    ways: VecDeque<(f64, TreadWays)>,
    sigma_m: f64,
    sigma_rad: f64,
    /// Way of the treads from which on they dig, m.
    least_m: f64,
}

impl DigWatch {
    pub(super) fn new(estimator: &EstimatorSettings, half_track_m: f64) -> Self {
        // Treads that turn against each other turn the vehicle and leave it where it is.
        let sigma_m = estimator
            .pose_sigma_m
            .max(half_track_m * estimator.pose_sigma_rad);
        Self {
            places: VecDeque::with_capacity(DIG_POSES),
            same: None,
            ways: VecDeque::with_capacity(DIG_WAYS),
            sigma_m: estimator.pose_sigma_m,
            sigma_rad: estimator.pose_sigma_rad,
            least_m: DIG_WAY_M.max(DIG_WAY_SIGMAS * sigma_m),
        }
    }

    /// Starts over.
    pub(super) fn reset(&mut self) {
        self.places.clear();
        self.same = None;
    }

    /// Takes the readings of a cycle; returns why the vehicle stops where the treads have turned and poses stay: they dig,
    /// or the source of the poses is frozen, and where the vehicle is is not known.
    pub(super) fn observe(
        &mut self,
        sample: &Sample,
        treads: &TreadSpeeds,
        elapsed_s: f64,
    ) -> Option<StopReason> {
        let TreadWays([left_m, right_m]) = self
            .ways
            .back()
            .map_or(TreadWays::default(), |(_, ways)| *ways);
        let now = TreadWays([
            left_m + treads.left_m_s * elapsed_s,
            right_m + treads.right_m_s * elapsed_s,
        ]);
        if self.ways.len() == DIG_WAYS {
            self.ways.pop_front();
        }
        self.ways.push_back((sample.time_s, now));
        let pose = sample.pose?;
        // A pose comes late: the treads have turned on since.
        let later = self
            .ways
            .partition_point(|(time_s, _)| *time_s <= pose.time_s);
        let (_, ways) = later.checked_sub(1).and_then(|at| self.ways.get(at))?;
        let newest = PoseThen {
            time_s: pose.time_s,
            pose: pose.value.planar(),
            ways: *ways,
        };
        let is_far = |place: &PoseThen| {
            newest.time_s - place.time_s >= DIG_S && newest.ways.since(&place.ways) >= self.least_m
        };
        let is_past = |place: &PoseThen| newest.time_s - place.time_s > DIG_MOST_S;
        while self.places.get(1).is_some_and(is_far) || self.places.front().is_some_and(is_past) {
            self.places.pop_front();
        }
        let last_s = self.places.back().map(|place| place.time_s);
        if last_s.is_none_or(|last_s| newest.time_s - last_s >= DIG_POSES_S) {
            self.places.push_back(newest);
        }
        // At the end of its grip a vehicle turns slowly, one tread spinning.
        let turned_rad = DIG_SIGMAS * self.sigma_rad;
        let keeps_heading = |place: &PoseThen| {
            wrap_angle(place.pose.yaw_rad - newest.pose.yaw_rad).abs() < turned_rad
        };
        let place_bits = |place: &PoseThen| [place.pose.x_m, place.pose.y_m].map(f64::to_bits);
        let is_same =
            |first: &PoseThen| place_bits(first) == place_bits(&newest) && keeps_heading(first);
        let same = self.same.filter(is_same).unwrap_or(newest);
        self.same = Some(same);
        let (same_s, same_m) = (newest.time_s - same.time_s, newest.ways.since(&same.ways));
        let frozen = StopReason::PoseFrozen { time_s: same_s };
        if same_s >= DIG_S && same_m >= DIG_WAY_M {
            return Some(frozen);
        }
        let oldest = self.places.front().filter(|place| is_far(place))?;
        let way_m = newest.ways.since(&oldest.ways);
        let moved_m = (DIG_SHARE * way_m).hypot(DIG_SIGMAS * self.sigma_m);
        let stays = |place: &PoseThen| {
            (place.pose.x_m - newest.pose.x_m).hypot(place.pose.y_m - newest.pose.y_m) < moved_m
                && keeps_heading(place)
        };
        let dug = StopReason::Stalled {
            stall: Stall::Treads,
            time_s: newest.time_s - oldest.time_s,
        };
        self.places
            .iter()
            .all(stays)
            .then_some(if same_s >= FROZEN_S { frozen } else { dug })
    }
}

/// The cycles of the last `stall_time_s`; nothing is allocated after [`Watchdog::new`].
#[derive(Debug, Clone)]
pub(super) struct Watchdog {
    window_s: f64,
    share: f64,
    limits: InputLimits,
    half_track_m: f64,
    /// Most cycles in the history.
    cycles: usize,
    history: VecDeque<Sums>,
    before: Option<PlanarPose>,
}

impl Watchdog {
    pub(super) fn new(
        config: &SupervisorConfig,
        limits: InputLimits,
        half_track_m: f64,
        period_s: f64,
    ) -> Self {
        // Twice the cycles of the window leave room for ones that come early.
        let cycles = (2.0 * config.stall_time_s / period_s).ceil() as usize + 2;
        Self {
            window_s: config.stall_time_s,
            share: config.stall_share,
            limits,
            half_track_m,
            cycles,
            history: VecDeque::with_capacity(cycles),
            before: None,
        }
    }

    /// Starts over, as with another path or after a stop.
    pub(super) fn reset(&mut self) {
        self.history.clear();
        self.before = None;
    }

    /// Takes a cycle in; returns what has stalled for the whole window.
    pub(super) fn observe(&mut self, now: &Observation) -> Option<Stall> {
        let sums = self.next(now);
        while self
            .history
            .get(1)
            .is_some_and(|second| sums.time_s - second.time_s >= self.window_s)
            || self.history.len() == self.cycles
        {
            self.history.pop_front();
        }
        self.history.push_back(sums);
        let start = self.history.front()?;
        (sums.time_s - start.time_s >= self.window_s)
            .then(|| self.judge(start, &sums))
            .flatten()
    }

    fn next(&mut self, now: &Observation) -> Sums {
        let mut sums = self.history.back().copied().unwrap_or_default();
        let point = &now.progress.point;
        let elapsed_s = now.time_s - sums.time_s;
        if let Some(before) = self.before.replace(now.pose) {
            let MotorSpeeds {
                traction_m_s,
                steer_m_s,
            } = now.command;
            let at_limit = |speed: f64, limit: f64| {
                if speed.abs() >= AT_LIMIT * limit {
                    speed.signum()
                } else {
                    0.0
                }
            };
            sums.steer_at_limit_s += elapsed_s * at_limit(steer_m_s, self.limits.steer.speed_m_s);
            sums.traction_at_limit_s +=
                elapsed_s * at_limit(traction_m_s, self.limits.traction.speed_m_s);
            sums.commanded_turn_rad += elapsed_s * steer_m_s / self.half_track_m;
            sums.commanded_way_m += elapsed_s * traction_m_s;
            sums.turn_rad += wrap_angle(now.pose.yaw_rad - before.yaw_rad);
            let (sin, cos) = now.pose.yaw_rad.sin_cos();
            sums.way_m += -sin * (now.pose.x_m - before.x_m) + cos * (now.pose.y_m - before.y_m);
            if point.motion == Motion::Drive && !now.progress.ended {
                sums.asked_m += elapsed_s * point.speed_m_s.abs().min(now.allowed_m_s);
            }
        }
        sums.time_s = now.time_s;
        (sums.x_m, sums.y_m) = (now.pose.x_m, now.pose.y_m);
        sums.along_m = now.progress.arc_length_m;
        sums
    }

    fn judge(&self, start: &Sums, end: &Sums) -> Option<Stall> {
        let window_s = end.time_s - start.time_s;
        let turned_rad = end.turn_rad - start.turn_rad;
        let commanded_turn_rad = end.commanded_turn_rad - start.commanded_turn_rad;
        // At the limit of grip a vehicle turns slowly with one tread spinning: as long as it turns in the
        // commanded direction, it recovers.
        if commanded_turn_rad.signum() * turned_rad >= TURNED_MIN_RAD {
            return None;
        }
        // Whether a motor stood at one limit without its share of the motion that it should give.
        let stalls = |at_limit_s: f64, moved: f64, commanded: f64| {
            let sense = at_limit_s.signum();
            at_limit_s.abs() >= AT_LIMIT * window_s
                && sense * moved < self.share * sense * commanded
        };
        if stalls(
            end.steer_at_limit_s - start.steer_at_limit_s,
            turned_rad,
            commanded_turn_rad,
        ) {
            return Some(Stall::Steer);
        }
        if stalls(
            end.traction_at_limit_s - start.traction_at_limit_s,
            end.way_m - start.way_m,
            end.commanded_way_m - start.commanded_way_m,
        ) {
            return Some(Stall::Traction);
        }
        // Back from a cusp a vehicle is where it was, and on its way to the path it comes no farther along it.
        let asked_m = end.asked_m - start.asked_m;
        let least_m = (self.share * asked_m).min(PROGRESS_M);
        let near = |place: &Sums| (place.x_m - start.x_m).hypot(place.y_m - start.y_m) < least_m;
        let stands = turned_rad.abs() < TURNED_MIN_RAD
            && end.along_m - start.along_m < least_m
            && self.history.iter().all(near);
        (asked_m >= PROGRESS_M && stands).then_some(Stall::Path)
    }
}

#[cfg(test)]
mod tests;
