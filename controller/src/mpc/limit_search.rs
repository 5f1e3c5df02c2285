//! The active limits of a QP whose inequalities are bounds and changes of the inputs alone.
//!
//! The dual active-set method of Goldfarb and Idnani (Math. Programming 27, 1983) on the Riccati recursion
//! of the stages. It starts from a guess, less the limits with negative multipliers. A step takes in the worst
//! exceeded limits at once and drops those whose multipliers become negative; where that does not raise
//! the dual cost, it takes in the worst one alone, as the method has it. A bound on the steps ends
//! a search that rounding keeps going.
//!
//! [`WorkingSet`](super::working_set::WorkingSet) checks what it finds by the residuals of the whole QP.

use super::active_limits::{ActiveLimits, Limit, LimitKind, PerLimit};
use super::clarabel_qp::SolveLimits;
use super::problem::{Point, QpData};
use super::recursion::Recursion;
use super::rows::Rows;
use super::structure::ROWS_PER_STAGE;

/// How far a limit may be exceeded, m/s, and how far below 0 a multiplier may be, relative to 1 plus the
/// largest linear cost.
const TOLERANCE: f64 = 1e-9;
/// Share of the largest excess from which an exceeded limit is taken in with the worst one. Those that are
/// exceeded by less often are not any more once the others hold.
const EXCESS_SHARE: f64 = 0.5;
/// Largest number of times that limits are dropped after several were taken in at once.
const DROPS: u32 = 4;
/// Largest number of recursions and of steps per stage: as many as it has limits.
const MOST_PER_STAGE: usize = ROWS_PER_STAGE;

/// Workspace of the search.
#[derive(Clone)]
pub struct LimitSearch {
    active: ActiveLimits,
    recursion: Recursion,
    multipliers: PerLimit<f64>,
    change: PerLimit<f64>,
    /// Multipliers on the way to the next set.
    before: PerLimit<f64>,
    /// The set before a step.
    kept: PerLimit<i8>,
    least_multiplier: f64,
    /// Of the optimum for the active limits.
    cost: f64,
    /// Recursions of the present QP.
    systems: u32,
}

impl LimitSearch {
    /// Returns the search for problems with the pattern of `data`; none where it does not apply.
    pub fn new(data: &QpData) -> Option<Self> {
        let stages = data.stages.len();
        let applies = stages > 0 && data.b.len() - data.equalities == ROWS_PER_STAGE * stages;
        applies.then(|| Self {
            active: ActiveLimits::new(stages),
            recursion: Recursion::new(stages),
            multipliers: PerLimit::new(stages, 0.0),
            change: PerLimit::new(stages, 0.0),
            before: PerLimit::new(stages, 0.0),
            kept: PerLimit::new(stages, 0),
            least_multiplier: 0.0,
            cost: 0.0,
            systems: 0,
        })
    }

    /// Returns the number of recursions of the last search.
    pub fn systems(&self) -> u32 {
        self.systems
    }

    /// Puts the optimum of the last recursion and its multipliers into a point.
    pub fn put_optimum(&self, data: &QpData, rows: &Rows, point: &mut Point) {
        let optimum = &self.recursion.optimum;
        let mut multipliers = point.dual.iter_mut();
        let mut end = 0;
        for (stage, inputs) in optimum.inputs.iter().enumerate() {
            let first = rows.columns(ROWS_PER_STAGE * stage)[0];
            // A block begins with its state, which the first equalities left tie to the block before.
            let state = &mut point.primal[end..first];
            if !state.is_empty() {
                state.copy_from_slice(&optimum.states[stage - 1]);
                for (costate, multiplier) in optimum.costates[stage].iter().zip(&mut multipliers) {
                    *multiplier = -costate;
                }
            }
            end = first + inputs.len();
            point.primal[first..end].copy_from_slice(inputs);
        }
        data.slacken(point);
        point.dual[data.equalities..].fill(0.0);
        for limit in self.active.limits() {
            if let Some((row, scale)) = self.active.row(limit, data, rows) {
                point.dual[row] = self.multipliers.get(limit) / scale;
                point.slack[row] = 0.0;
            }
        }
    }

    /// Finds the active limits, starting from `members`, and puts them there. Returns whether they were
    /// found: not where the QP is infeasible or badly conditioned, or takes too many steps.
    ///
    /// # Errors
    /// The deadline has passed.
    pub fn find(
        &mut self,
        data: &QpData,
        rows: &Rows,
        members: &mut [bool],
        limits: &SolveLimits,
    ) -> Result<bool, ()> {
        self.systems = 0;
        let largest = data.q.iter().fold(0.0_f64, |m, q| m.max(q.abs()));
        self.least_multiplier = -TOLERANCE * (1.0 + largest);
        self.active.load(data, rows, members);
        let found = self.climb(data, limits)?;
        if found {
            self.active.store(members);
        }
        Ok(found)
    }

    /// Solves for the active limits; returns whether that went well.
    fn solve(&mut self, data: &QpData, limits: &SolveLimits) -> Result<bool, ()> {
        let changed = self.active.update_rules();
        let last = match self.systems {
            0 => Some(data.stages.len() - 1),
            _ => changed,
        };
        if let Some(last) = last {
            if limits.passed() {
                return Err(());
            }
            if self.systems as usize == MOST_PER_STAGE * data.stages.len() {
                return Ok(false);
            }
            self.systems += 1;
            let (stages, rules) = (&data.stages, &self.active.rules);
            let Some(cost) = self.recursion.solve(stages, rules, last) else {
                return Ok(false);
            };
            self.cost = cost;
        }
        let slopes = &self.recursion.optimum.slopes;
        self.active
            .balance(|stage, motor| slopes[stage][motor], &mut self.multipliers);
        Ok(true)
    }

    /// Raises the dual cost to its maximum; returns whether it was reached.
    fn climb(&mut self, data: &QpData, limits: &SolveLimits) -> Result<bool, ()> {
        if !self.solve(data, limits)? {
            return Ok(false);
        }
        while self.drop_negative() {
            if !self.solve(data, limits)? {
                return Ok(false);
            }
        }
        // Steps with one limit until the next with several: twice as many after each that failed.
        let (mut single, mut after_failure) = (0, 1);
        for _ in 0..MOST_PER_STAGE * data.stages.len() {
            let Some((limit, excess, side)) = self.worst() else {
                return Ok(true);
            };
            if single == 0 {
                if self.take_in_worst(data, limits, EXCESS_SHARE * excess)? {
                    after_failure = 1;
                    continue;
                }
                if !self.solve(data, limits)? {
                    return Ok(false);
                }
                after_failure *= 2;
                single = after_failure;
            }
            single -= 1;
            if !self.take_in(data, limits, limit, side, excess)? {
                return Ok(false);
            }
        }
        Ok(false)
    }

    /// Takes in the limits that are exceeded by more than `least_m_s` and drops those whose multipliers become
    /// negative; returns whether that raised the dual cost. Leaves the set as it was where it did not.
    fn take_in_worst(
        &mut self,
        data: &QpData,
        limits: &SolveLimits,
        least_m_s: f64,
    ) -> Result<bool, ()> {
        let cost = self.cost;
        self.kept.copy_from(&self.active.sides);
        let inputs = &self.recursion.optimum.inputs;
        let mut added = 0;
        for limit in self.active.limits() {
            let (excess, side) = self.active.excess(limit, inputs);
            if self.active.sides.get(limit) == 0 && excess > least_m_s {
                added += usize::from(self.active.add(limit, side));
            }
        }
        if added > 1 {
            for _ in 0..DROPS {
                if !self.solve(data, limits)? {
                    break;
                }
                if !self.drop_negative() {
                    if self.cost > cost {
                        return Ok(true);
                    }
                    break;
                }
            }
        }
        self.active.sides.copy_from(&self.kept);
        Ok(false)
    }

    /// Drops the limits with negative multipliers; returns whether there was one.
    fn drop_negative(&mut self) -> bool {
        let mut dropped = false;
        for limit in self.active.limits() {
            if self.active.sides.get(limit) != 0
                && self.multipliers.get(limit) < self.least_multiplier
            {
                self.active.sides.set(limit, 0);
                dropped = true;
            }
        }
        dropped
    }

    fn worst(&self) -> Option<(Limit, f64, i8)> {
        let inputs = &self.recursion.optimum.inputs;
        let mut worst = None;
        let mut largest = TOLERANCE;
        for limit in self.active.limits() {
            if self.active.sides.get(limit) == 0 {
                let (excess, side) = self.active.excess(limit, inputs);
                if excess > largest {
                    largest = excess;
                    worst = Some((limit, excess, side));
                }
            }
        }
        worst
    }

    /// Takes in an exceeded limit and drops the limits that block it; returns whether that was possible.
    fn take_in(
        &mut self,
        data: &QpData,
        limits: &SolveLimits,
        limit: Limit,
        side: i8,
        mut excess: f64,
    ) -> Result<bool, ()> {
        let Limit { stage, motor, kind } = limit;
        let force = f64::from(side);
        let force_before = if kind == LimitKind::Change {
            -force
        } else {
            0.0
        };
        self.before.copy_from(&self.multipliers);
        // Each pass drops a limit.
        for _ in 0..=2 * self.active.rules.len() {
            let stages = &data.stages;
            self.recursion
                .push(stages, motor, stage, force, force_before);
            let direction = &self.recursion.direction;
            let slopes = |k: usize, m: usize| {
                let pushed = match () {
                    () if m != motor => 0.0,
                    () if k == stage => force,
                    () if k + 1 == stage => force_before,
                    () => 0.0,
                };
                direction.slopes[k][m] + pushed
            };
            self.active.balance(slopes, &mut self.change);
            // How fast the limit comes nearer.
            let speed = -force * limit.of(&direction.inputs);
            let mut t = if self.active.depends(limit) {
                f64::INFINITY
            } else {
                excess / speed
            };
            let mut blocking = None;
            for other in self.active.limits() {
                if self.active.sides.get(other) != 0 {
                    let (y, by) = (self.before.get(other).max(0.0), self.change.get(other));
                    if by < 0.0 && y < -t * by {
                        (t, blocking) = (-y / by, Some(other));
                    }
                }
            }
            if !t.is_finite() || t < 0.0 {
                return Ok(false);
            }
            let Some(blocking) = blocking else {
                self.active.sides.set(limit, side);
                return self.solve(data, limits);
            };
            excess -= t * speed;
            for other in self.active.limits() {
                let y = self.before.get(other) + t * self.change.get(other);
                self.before.set(other, y.max(0.0));
            }
            self.active.sides.set(blocking, 0);
            if !self.solve(data, limits)? {
                return Ok(false);
            }
        }
        Ok(false)
    }
}
