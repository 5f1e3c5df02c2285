//! The active rows of a QP, and its solution.
//!
//! The dual active-set method of Goldfarb and Idnani ("A numerically stable dual method for solving strictly convex quadratic
//! programs", Math. Programming 27, 1983) on one Riccati recursion. With the active rows A x = e and the minimum x_0 of the
//! cost without rows,
//!
//! ```text
//! x = x_0 - H^-1 A' y,   (A H^-1 A') y = A x_0 - e
//! ```
//!
//! so each row that becomes active takes an answer of the recursion to its coefficients, and a line of a Cholesky factor.
//!
//! The method starts from the rows that were active before, less those with negative multipliers. A step takes in the worst
//! exceeded rows at once and drops those whose multipliers become negative; where that does not raise the dual cost, it
//! takes in the worst one alone, as the method has it. A bound on the steps ends a search that rounding keeps going.

use super::recursion::Recursion;
use super::solve_limits::SolveLimits;
use super::stage_qp::{MOTORS, Point, Rollout, STATES, StageQp, VARIABLES, dot};

/// How far a row may be exceeded, in its units, and how far below 0 a multiplier may be, relative to 1 plus the largest
/// linear cost.
const TOLERANCE: f64 = 1e-9;
/// Share of its own curvature that a row must keep beside the active ones to be independent of them.
const INDEPENDENT_SHARE: f64 = 1e-11;
/// Share of the largest excess from which an exceeded row is taken in with the worst one. Those that are exceeded by less
/// often are not any more once the others hold.
const EXCESS_SHARE: f64 = 0.5;
/// Largest number of times that rows are dropped after several were taken in at once.
const DROPS: u32 = 4;
/// Largest number of steps for each stage.
const STEPS_PER_STAGE: usize = 8;

/// Finds the active rows and the solution.
#[derive(Clone)]
pub struct ActiveSet {
    recursion: Recursion,
    /// Linear cost of the QP, and one with rows that press.
    linear: Vec<[f64; VARIABLES]>,
    forces: Vec<[f64; VARIABLES]>,
    /// Minimum without rows.
    free: Rollout,
    /// Answer to a row.
    answer: Rollout,
    /// Values of all rows at the present point.
    values: Vec<f64>,
    set: Set,
    /// The set before a step.
    kept: Set,
    /// Sides of the rows in the last solution.
    sides: Vec<i8>,
    /// Curvatures between a row and the active ones, and how multipliers change.
    column: Vec<f64>,
    change: Vec<f64>,
    least_multiplier: f64,
    points: u32,
}

/// An active row.
#[derive(Debug, Clone, Copy, Default)]
struct ActiveRow {
    row: usize,
    /// 1 where the high end is active, -1 where the low one is.
    side: f64,
    /// How far it is exceeded at the minimum without rows.
    excess: f64,
    /// Not negative where it presses the right way.
    multiplier: f64,
}

/// The active rows, with the matrix A H^-1 A' and its Cholesky factor, lower triangles packed by rows.
#[derive(Clone)]
struct Set {
    count: usize,
    rows: Vec<ActiveRow>,
    matrix: Vec<f64>,
    factor: Vec<f64>,
    /// Side of each row of the QP, 0 where it is not active.
    sides: Vec<i8>,
}

impl ActiveSet {
    /// Returns the workspace for QPs of the size of `qp`.
    pub fn new(qp: &StageQp) -> Self {
        let stages = qp.stages.len();
        let set = Set::new(MOTORS * stages, qp.rows().len());
        Self {
            recursion: Recursion::new(stages),
            linear: vec![[0.0; VARIABLES]; stages],
            forces: vec![[0.0; VARIABLES]; stages],
            free: Rollout::zeros(stages),
            answer: Rollout::zeros(stages),
            values: vec![0.0; qp.rows().len()],
            kept: set.clone(),
            set,
            sides: vec![0; qp.rows().len()],
            column: vec![0.0; MOTORS * stages],
            change: vec![0.0; MOTORS * stages],
            least_multiplier: 0.0,
            points: 0,
        }
    }

    /// Returns the number of sets of active rows whose optimum was found in the last search.
    pub fn points(&self) -> u32 {
        self.points
    }

    /// Returns whether a row is active in the last solution.
    pub fn binds(&self) -> bool {
        self.sides.iter().any(|side| *side != 0)
    }

    /// Starts the next search from the rows that press at a point.
    pub fn begin_with(&mut self, qp: &StageQp, point: &Point) {
        let rows = qp.rows().iter().zip(&point.multipliers);
        for (row, (side, (own, multiplier))) in self.sides.iter_mut().zip(rows).enumerate() {
            let pressed = if *multiplier > 0.0 { 1 } else { -1 };
            let slack = -own.excess_on(f64::from(pressed), qp.value(row, &point.rollout));
            let presses = multiplier.abs() > slack.max(0.0);
            *side = if presses { pressed } else { 0 };
        }
    }

    /// Finds the feedback of a QP's cost, rows left out, as a search does; returns whether there is one.
    pub fn find_feedback(&mut self, qp: &StageQp) -> bool {
        self.recursion.factorise(&qp.stages)
    }

    /// Returns by how much the state at the stages' ends changes where that at the first one's begin changes by `start`.
    pub fn answer(
        &self,
        qp: &StageQp,
        start: [f64; STATES],
    ) -> impl Iterator<Item = [f64; STATES]> {
        self.recursion.answer(&qp.stages, start)
    }

    /// Sets `point` to the solution. Returns whether it was found: not where the QP is infeasible or badly conditioned, or
    /// takes too many steps; the next search then starts without active rows.
    ///
    /// # Errors
    /// The deadline has passed; `point` has the last set's optimum where there is one.
    pub fn find(
        &mut self,
        qp: &StageQp,
        point: &mut Point,
        limits: &SolveLimits,
    ) -> Result<bool, ()> {
        self.points = 0;
        let found = self.climb(qp, point, limits)?;
        if found {
            self.sides.copy_from_slice(&self.set.sides);
        } else {
            self.sides.fill(0);
        }
        Ok(found)
    }

    /// Raises the dual cost to its maximum; returns whether it was reached.
    fn climb(&mut self, qp: &StageQp, point: &mut Point, limits: &SolveLimits) -> Result<bool, ()> {
        if limits.passed() {
            return Err(());
        }
        if !self.begin(qp) {
            return Ok(false);
        }
        self.put_optimum(qp, point);
        // Steps with one row until the next with several: twice as many after each that failed.
        let (mut single, mut after_failure) = (0, 1);
        for _ in 0..STEPS_PER_STAGE * qp.stages.len() {
            let Some((row, side, excess)) = self.worst(qp) else {
                point.multipliers.fill(0.0);
                for active in self.set.active() {
                    point.multipliers[active.row] = active.side * active.multiplier.max(0.0);
                }
                return Ok(true);
            };
            if limits.passed() {
                return Err(());
            }
            if single == 0 && self.take_in_worst(qp, EXCESS_SHARE * excess) {
                after_failure = 1;
            } else {
                if single == 0 {
                    after_failure *= 2;
                    single = after_failure;
                }
                single -= 1;
                if !self.take_in(qp, row, side, excess) {
                    return Ok(false);
                }
            }
            self.put_optimum(qp, point);
        }
        Ok(false)
    }

    /// Begins a search with the rows that were active before; returns whether the cost has a minimum.
    fn begin(&mut self, qp: &StageQp) -> bool {
        self.set.clear();
        if !self.recursion.factorise(&qp.stages) {
            return false;
        }
        qp.linear(&mut self.linear);
        let forces = self.linear.as_flattened().iter();
        let largest = forces.fold(0.0_f64, |m, force| m.max(force.abs()));
        self.least_multiplier = -TOLERANCE * (1.0 + largest);
        let last = qp.stages.len() - 1;
        self.recursion
            .respond(&qp.stages, &self.linear, last, last, &mut self.free);
        for row in 0..self.sides.len() {
            if self.sides[row] != 0 {
                self.add(qp, row, f64::from(self.sides[row]));
            }
        }
        self.balance();
        while self.set.drop_below(self.least_multiplier) {
            self.balance();
        }
        true
    }

    /// Sets `point` to the optimum for the active rows, and `values` to those of all rows there.
    fn put_optimum(&mut self, qp: &StageQp, point: &mut Point) {
        self.points += 1;
        if self.set.count == 0 {
            point.rollout.copy_from(&self.free);
        } else {
            self.forces.copy_from_slice(&self.linear);
            for active in self.set.active() {
                let multiplier = active.side * active.multiplier;
                qp.press(active.row, multiplier, &mut self.forces);
            }
            let last = qp.stages.len() - 1;
            self.recursion
                .respond(&qp.stages, &self.forces, last, last, &mut point.rollout);
        }
        for (row, value) in self.values.iter_mut().enumerate() {
            *value = qp.value(row, &point.rollout);
        }
    }

    /// Returns the row that is exceeded most, on which side and by how much.
    fn worst(&self, qp: &StageQp) -> Option<(usize, f64, f64)> {
        let mut worst = None;
        let mut largest = TOLERANCE;
        for (row, (own, value)) in qp.rows().iter().zip(&self.values).enumerate() {
            let (side, excess) = own.excess(*value);
            if excess > largest && self.set.sides[row] == 0 {
                largest = excess;
                worst = Some((row, side, excess));
            }
        }
        worst
    }

    /// Finds the answer to a row that presses, and its curvatures with the active rows and with itself; returns the latter.
    fn press(&mut self, qp: &StageQp, row: usize, side: f64) -> f64 {
        let stage = qp.stage_of(row);
        self.forces[..=stage].fill([0.0; VARIABLES]);
        qp.press(row, side, &mut self.forces);
        let active = self.set.active().iter();
        let end = active.fold(stage, |end, active| end.max(qp.stage_of(active.row)));
        self.recursion
            .respond(&qp.stages, &self.forces, stage, end, &mut self.answer);
        for (entry, active) in self.column.iter_mut().zip(self.set.active()) {
            *entry = -active.side * qp.value(active.row, &self.answer);
        }
        -side * qp.value(row, &self.answer)
    }

    /// Makes a row active unless it depends on those that are.
    fn add(&mut self, qp: &StageQp, row: usize, side: f64) {
        let own = self.press(qp, row, side);
        let excess = qp.rows()[row].excess_on(side, qp.value(row, &self.free));
        self.set.push(row, side, excess, &self.column, own);
    }

    /// Sets the multipliers that hold all active rows at their ends.
    fn balance(&mut self) {
        let multipliers = &mut self.change[..self.set.count];
        for (value, active) in multipliers.iter_mut().zip(self.set.active()) {
            *value = active.excess;
        }
        self.set.solve(multipliers);
        for (active, value) in self.set.rows.iter_mut().zip(multipliers) {
            active.multiplier = *value;
        }
    }

    /// Takes in the rows that are exceeded by more than `least` and drops those whose multipliers become negative; returns
    /// whether that raised the dual cost. Leaves the set as it was where it did not.
    fn take_in_worst(&mut self, qp: &StageQp, least: f64) -> bool {
        let cost = self.set.cost();
        self.kept.copy_from(&self.set);
        for row in 0..self.values.len() {
            let (side, excess) = qp.rows()[row].excess(self.values[row]);
            if excess > least && self.set.sides[row] == 0 {
                self.add(qp, row, side);
            }
        }
        if self.set.count > self.kept.count + 1 {
            for _ in 0..DROPS {
                self.balance();
                if !self.set.drop_below(self.least_multiplier) {
                    if self.set.cost() > cost {
                        return true;
                    }
                    break;
                }
            }
        }
        self.set.copy_from(&self.kept);
        false
    }

    /// Takes in an exceeded row and drops those that block it; returns whether that was possible.
    fn take_in(&mut self, qp: &StageQp, row: usize, side: f64, mut excess: f64) -> bool {
        let own = self.press(qp, row, side);
        // Each pass drops a row.
        for _ in 0..=self.set.rows.len() {
            let count = self.set.count;
            let (column, change) = (&self.column[..count], &mut self.change[..count]);
            change.copy_from_slice(column);
            self.set.solve(change);
            let left = own - dot(column, change);
            let mut t = if left > INDEPENDENT_SHARE * own {
                excess / left
            } else {
                f64::INFINITY
            };
            let mut blocking = None;
            for (i, (active, by)) in self.set.active().iter().zip(&*change).enumerate() {
                let y = active.multiplier.max(0.0);
                if *by > 0.0 && y < t * by {
                    (t, blocking) = (y / by, Some(i));
                }
            }
            if !t.is_finite() {
                return false;
            }
            let Some(blocking) = blocking else {
                let excess = qp.rows()[row].excess_on(side, qp.value(row, &self.free));
                let added = self.set.push(row, side, excess, &self.column, own);
                self.balance();
                return added;
            };
            excess -= t * left;
            let active = self.set.rows[..count].iter_mut();
            for (active, by) in active.zip(&*change) {
                active.multiplier = (active.multiplier - t * by).max(0.0);
            }
            self.set.remove(blocking);
            self.column[blocking..count].rotate_left(1);
        }
        false
    }
}

impl Set {
    fn new(size: usize, rows: usize) -> Self {
        let packed = size * (size + 1) / 2;
        Self {
            count: 0,
            rows: vec![ActiveRow::default(); size],
            matrix: vec![0.0; packed],
            factor: vec![0.0; packed],
            sides: vec![0; rows],
        }
    }

    fn active(&self) -> &[ActiveRow] {
        &self.rows[..self.count]
    }

    fn clear(&mut self) {
        self.count = 0;
        self.sides.fill(0);
    }

    fn copy_from(&mut self, other: &Self) {
        let (count, packed) = (other.count, line(other.count));
        self.count = count;
        self.rows[..count].copy_from_slice(&other.rows[..count]);
        self.matrix[..packed].copy_from_slice(&other.matrix[..packed]);
        self.factor[..packed].copy_from_slice(&other.factor[..packed]);
        self.sides.copy_from_slice(&other.sides);
    }

    /// Returns by how much the active rows raise the cost.
    fn cost(&self) -> f64 {
        let work = self.active().iter().map(|row| row.excess * row.multiplier);
        0.5 * work.sum::<f64>()
    }

    /// Adds a row with its curvatures unless it depends on the others; returns whether it did.
    fn push(&mut self, row: usize, side: f64, excess: f64, column: &[f64], own: f64) -> bool {
        let count = self.count;
        if count == self.rows.len() {
            return false;
        }
        let place = line(count);
        self.matrix[place..place + count].copy_from_slice(&column[..count]);
        self.matrix[place + count] = own;
        let added = self.factorise(count);
        if added {
            self.rows[count] = ActiveRow {
                row,
                side,
                excess,
                multiplier: 0.0,
            };
            self.sides[row] = if side > 0.0 { 1 } else { -1 };
            self.count += 1;
        }
        added
    }

    /// Sets a line of the factor; returns whether its row is independent of those before.
    fn factorise(&mut self, i: usize) -> bool {
        let own = line(i);
        let (done, now) = self.factor.split_at_mut(own);
        for j in 0..i {
            let before = &done[line(j)..];
            let known = dot(&now[..j], &before[..j]);
            now[j] = (self.matrix[own + j] - known) / before[j];
        }
        let curvature = self.matrix[own + i];
        let left = curvature - dot(&now[..i], &now[..i]);
        now[i] = left.max(0.0).sqrt();
        left > INDEPENDENT_SHARE * curvature
    }

    /// Removes the active row at a place.
    fn remove(&mut self, place: usize) {
        self.sides[self.rows[place].row] = 0;
        self.rows[place..self.count].rotate_left(1);
        let (mut from, mut to) = (line(place), line(place));
        for i in place..self.count {
            for j in 0..=i {
                if i != place && j != place {
                    self.matrix[to] = self.matrix[from];
                    to += 1;
                }
                from += 1;
            }
        }
        self.count -= 1;
        for i in place..self.count {
            // A row of fewer is as independent.
            self.factorise(i);
        }
    }

    /// Drops the rows with multipliers below `least`; returns whether there was one.
    fn drop_below(&mut self, least: f64) -> bool {
        let before = self.count;
        for place in (0..before).rev() {
            if self.rows[place].multiplier < least {
                self.remove(place);
            }
        }
        self.count < before
    }

    /// Solves A H^-1 A' for a right-hand side in place.
    fn solve(&self, values: &mut [f64]) {
        for i in 0..self.count {
            let own = &self.factor[line(i)..];
            values[i] = (values[i] - dot(&own[..i], &values[..i])) / own[i];
        }
        for i in (0..self.count).rev() {
            values[i] /= self.factor[line(i) + i];
            let value = values[i];
            for (j, entry) in values[..i].iter_mut().enumerate() {
                *entry -= self.factor[line(i) + j] * value;
            }
        }
    }
}

/// Returns where a line of a packed lower triangle begins.
fn line(i: usize) -> usize {
    i * (i + 1) / 2
}
