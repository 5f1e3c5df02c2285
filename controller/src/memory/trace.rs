//! How far the vehicle has moved over a second by its poses, and how far by its model.

use super::Evidence;
use nalgebra::{Rotation3, SVector, Vector3};
use sidehill_plant::frames::{PlanarPose, wrap_angle};
use sidehill_plant::slip_gains::{SlipGains, TERMS};
use std::collections::VecDeque;

/// Time over which motions are compared, s: shorter ones are mostly noise of the poses, longer ones blur places.
const WINDOW_S: f64 = 1.0;
/// Longest such time, where poses are missing, s.
const WINDOW_MAX_S: f64 = 1.5;
/// Cycles and poses that are kept at most: those of the longest time at 50 Hz, with poses that are late.
const MARKS: usize = 128;
const POSES: usize = 128;
/// Time without a cycle after which a new trace begins, s.
const BREAK_S: f64 = 0.3;

/// Sums up to a cycle.
#[derive(Debug, Clone, Copy, Default)]
struct Mark {
    time_s: f64,
    /// Motion by the model, (x, y, yaw) in the world.
    moved: Vector3<f64>,
    /// Terms of the learned gains, integrated over time.
    terms: SVector<f64, TERMS>,
    way_m: f64,
}

impl Mark {
    fn between(&self, other: &Self, ratio: f64) -> Self {
        Self {
            time_s: self.time_s + ratio * (other.time_s - self.time_s),
            moved: self.moved + ratio * (other.moved - self.moved),
            terms: self.terms + ratio * (other.terms - self.terms),
            way_m: self.way_m + ratio * (other.way_m - self.way_m),
        }
    }
}

/// What a cycle adds.
pub(crate) struct Step {
    pub(crate) time_s: f64,
    /// Motion by the model with its learned gains since the cycle before, (x, y, yaw) in the world.
    pub(crate) moved: Vector3<f64>,
    /// Terms of the learned gains.
    pub(crate) terms: SVector<f64, TERMS>,
    pub(crate) speed_m_s: f64,
}

/// Motion over a while, by poses less by the model.
pub(crate) struct Excess {
    /// (x, y, yaw) in the world.
    moved: Vector3<f64>,
    terms: SVector<f64, TERMS>,
    way_m: f64,
    time_s: f64,
    /// Share of it that no motion before had.
    share: f64,
    /// Where the vehicle was in the middle of it.
    pub(crate) middle: PlanarPose,
}

/// The last second; nothing is allocated after it is made.
#[derive(Debug, Clone)]
pub(crate) struct Trace {
    marks: VecDeque<Mark>,
    poses: VecDeque<(f64, PlanarPose)>,
}

impl Trace {
    pub(crate) fn new() -> Self {
        Self {
            marks: VecDeque::with_capacity(MARKS + 1),
            poses: VecDeque::with_capacity(POSES + 1),
        }
    }

    pub(crate) fn clear(&mut self) {
        self.marks.clear();
        self.poses.clear();
    }

    /// Adds a cycle.
    pub(crate) fn step(&mut self, step: &Step) {
        let last = self.marks.back().copied();
        let last = last.filter(|last| (0.0..BREAK_S).contains(&(step.time_s - last.time_s)));
        let Some(last) = last else {
            self.clear();
            self.marks.push_back(Mark {
                time_s: step.time_s,
                ..Mark::default()
            });
            return;
        };
        let time_s = step.time_s - last.time_s;
        self.marks.push_back(Mark {
            time_s: step.time_s,
            moved: last.moved + step.moved,
            terms: last.terms + time_s * step.terms,
            way_m: last.way_m + time_s * step.speed_m_s.abs(),
        });
        if self.marks.len() > MARKS {
            self.marks.pop_front();
        }
    }

    /// Adds a pose; returns the motion over the last second up to it, where the trace reaches back so far.
    pub(crate) fn pose(&mut self, time_s: f64, pose: PlanarPose) -> Option<Excess> {
        let since_s = match self.poses.back() {
            Some((last_s, _)) if *last_s >= time_s => return None,
            Some((last_s, _)) => time_s - last_s,
            None => WINDOW_S,
        };
        self.poses.push_back((time_s, pose));
        if self.poses.len() > POSES {
            self.poses.pop_front();
        }
        let back = |ago_s: f64| {
            self.poses
                .iter()
                .rev()
                .find(|(then_s, _)| time_s - then_s >= ago_s - 1e-6)
        };
        let (first_s, first) = *back(WINDOW_S)?;
        if time_s - first_s > WINDOW_MAX_S {
            return None;
        }
        let (_, middle) = *back(0.5 * WINDOW_S)?;
        let (begin, end) = (self.at(first_s)?, self.at(time_s)?);
        let seen = Vector3::new(
            pose.x_m - first.x_m,
            pose.y_m - first.y_m,
            wrap_angle(pose.yaw_rad - first.yaw_rad),
        );
        let mut moved = seen - (end.moved - begin.moved);
        moved.z = wrap_angle(moved.z);
        Some(Excess {
            moved,
            terms: end.terms - begin.terms,
            way_m: end.way_m - begin.way_m,
            time_s: time_s - first_s,
            share: (since_s / WINDOW_S).min(1.0),
            middle,
        })
    }

    fn at(&self, time_s: f64) -> Option<Mark> {
        let after = self.marks.iter().position(|mark| mark.time_s >= time_s)?;
        let end = &self.marks[after];
        let begin = self.marks.get(after.checked_sub(1)?)?;
        let ratio = (time_s - begin.time_s) / (end.time_s - begin.time_s);
        Some(begin.between(end, ratio))
    }
}

/// Smallest speed at which slip is learned, m/s.
const SPEED_MIN_M_S: f64 = 0.05;

impl Excess {
    /// Returns it as evidence of a place whose path has a heading, seen with `gains`; none of a vehicle that
    /// hardly moves.
    pub(crate) fn evidence(&self, heading_rad: f64, gains: &SlipGains) -> Option<Evidence> {
        if self.way_m < SPEED_MIN_M_S * self.time_s {
            return None;
        }
        let beyond = Rotation3::from_axis_angle(&Vector3::z_axis(), -heading_rad) * self.moved;
        let slip = beyond + gains * self.terms;
        let mut evidence = Evidence::default();
        let whole = Evidence {
            way_m: self.way_m,
            slip: slip.into(),
            terms_m: self.terms.into(),
            ..Evidence::default()
        };
        evidence.add(self.share, &whole);
        Some(evidence)
    }
}
