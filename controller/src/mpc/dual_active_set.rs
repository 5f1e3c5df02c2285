//! The dual active-set method of Goldfarb and Idnani (Math. Programming 27, 1983).
//!
//! Starts at the optimum for a subset of the rows. Each step adds the most violated row and drops the
//! rows whose multiplier would become negative. The dual cost grows with each step, so no active set
//! occurs twice. With K^-1 the solution operator of the equality-constrained QP, w_i = K^-1 a_i and
//! S = A_W K^-1 A_W' = L L', adding row p changes the point by
//!
//! ```text
//! dx = -t (w_p - sum_j r_j w_j),   dy_W = -t r,   dy_p = t,   S r = A_W w_p
//! ```
//!
//! A row costs one back substitution; S has the size of the active set.

use super::clarabel_qp::{LinearSystem, SolveLimits};
use super::problem::{Point, QpData};
use super::rows::Rows;

/// How far a row may be violated, relative to the largest right-hand side.
const VIOLATION: f64 = 1e-9;
/// Share of a row's curvature below which it counts as dependent on the others.
const DEPENDENT: f64 = 1e-9;

/// Workspace of the method.
#[derive(Clone)]
pub struct DualActiveSet {
    /// The active rows in the order they were added, their multipliers, and the slots of their w.
    active: Vec<usize>,
    multipliers: Vec<f64>,
    slots: Vec<usize>,
    free_slots: Vec<usize>,
    /// w of one row per slot.
    columns: Vec<f64>,
    size: usize,
    /// L by rows of the length `capacity`.
    factor: Vec<f64>,
    capacity: usize,
    /// L^-1 A_W w of the candidate row, and r.
    half: Vec<f64>,
    ratios: Vec<f64>,
    q: Vec<f64>,
    zeros: Vec<f64>,
}

impl DualActiveSet {
    /// Returns the workspace for problems with the pattern of `data`.
    pub fn new(data: &QpData) -> Self {
        let size = data.q.len();
        let freedoms = size.saturating_sub(data.equalities);
        let capacity = freedoms.min(data.b.len() - data.equalities) + 1;
        Self {
            active: Vec::with_capacity(capacity),
            multipliers: Vec::with_capacity(capacity),
            slots: Vec::with_capacity(capacity),
            free_slots: Vec::with_capacity(capacity + 1),
            columns: vec![0.0; (capacity + 1) * size],
            size,
            factor: vec![0.0; capacity * (capacity + 1)],
            capacity,
            half: vec![0.0; capacity],
            ratios: vec![0.0; capacity],
            q: vec![0.0; size],
            zeros: vec![0.0; data.equalities],
        }
    }

    /// Returns the active rows of the last solution.
    pub fn active(&self) -> &[usize] {
        &self.active
    }

    /// Finds the active rows, starting from `guess`; `system` holds the factors of the QP without its
    /// inequalities. Returns whether they were found; `point` then has the primal solution to within the
    /// system's accuracy.
    ///
    /// # Errors
    /// The deadline has passed.
    pub fn solve(
        &mut self,
        system: &mut LinearSystem,
        data: &QpData,
        rows: &Rows,
        guess: &[bool],
        point: &mut Point,
        limits: &SolveLimits,
    ) -> Result<bool, ()> {
        self.active.clear();
        self.multipliers.clear();
        self.slots.clear();
        self.free_slots.clear();
        self.free_slots.extend(0..=self.capacity);
        let first = data.equalities;
        if !system.solve(&data.q, &data.b[..first]) {
            return Ok(false);
        }
        point.primal.copy_from_slice(system.primal());
        data.slacken(point);
        for row in (0..guess.len()).filter(|row| guess[*row]) {
            if limits.passed() {
                return Err(());
            }
            let Some(slot) = self.column(system, data, rows, row) else {
                return Ok(false);
            };
            let own = self.project(data, rows, row, slot);
            if own.left > DEPENDENT * own.whole && self.active.len() + 1 < self.capacity {
                self.take_in(row, slot, own.left, 0.0);
            } else {
                self.free_slots.push(slot);
            }
        }
        self.let_go_of_negative(&point.slack[first..]);
        for (slot, y) in self.slots.iter().zip(&self.multipliers) {
            step(&mut point.primal, self.column_of(*slot), -y);
        }
        let largest = data.b.iter().fold(0.0_f64, |m, b| m.max(b.abs()));
        let least = -VIOLATION * (1.0 + largest);
        // Each step adds or drops a row; no active set occurs twice.
        for _ in 0..8 * self.capacity {
            data.slacken(point);
            let violated = self.most_violated(&point.slack[first..], least);
            let Some((row, slack)) = violated else {
                return Ok(true);
            };
            if limits.passed() {
                return Err(());
            }
            if !self.satisfy(system, data, rows, point, row, slack) {
                return Ok(false);
            }
        }
        Ok(false)
    }

    /// Adds a violated row and drops the rows that block it; returns whether that was possible.
    fn satisfy(
        &mut self,
        system: &mut LinearSystem,
        data: &QpData,
        rows: &Rows,
        point: &mut Point,
        row: usize,
        mut slack: f64,
    ) -> bool {
        let Some(slot) = self.column(system, data, rows, row) else {
            return false;
        };
        let mut multiplier = 0.0;
        // Each pass drops a row.
        for _ in 0..=self.active.len() {
            let own = self.project(data, rows, row, slot);
            self.solve_ratios();
            let full = if own.left > DEPENDENT * own.whole {
                -slack / own.left
            } else {
                f64::INFINITY
            };
            let (mut t, mut blocking) = (full, None);
            for (j, (r, y)) in self.ratios.iter().zip(&self.multipliers).enumerate() {
                if *r > 0.0 && *y < t * r {
                    (t, blocking) = (y / r, Some(j));
                }
            }
            if !t.is_finite() || self.active.len() + 1 >= self.capacity && blocking.is_none() {
                return false;
            }
            step(&mut point.primal, self.column_of(slot), -t);
            for j in 0..self.active.len() {
                let by = t * self.ratios[j];
                step(&mut point.primal, self.column_of(self.slots[j]), by);
                self.multipliers[j] = (self.multipliers[j] - by).max(0.0);
            }
            multiplier += t;
            slack += t * own.left;
            match blocking {
                Some(j) => self.let_go(j),
                None => {
                    self.take_in(row, slot, own.left, multiplier);
                    return true;
                }
            }
        }
        false
    }

    fn most_violated(&self, slacks: &[f64], least: f64) -> Option<(usize, f64)> {
        let mut worst = None;
        let mut lowest = least;
        for (row, slack) in slacks.iter().enumerate() {
            if *slack < lowest && !self.active.contains(&row) {
                lowest = *slack;
                worst = Some((row, *slack));
            }
        }
        worst
    }

    /// Solves for w of a row and returns the slot where it is put.
    fn column(
        &mut self,
        system: &mut LinearSystem,
        data: &QpData,
        rows: &Rows,
        row: usize,
    ) -> Option<usize> {
        self.q.fill(0.0);
        for (column, value) in rows.entries(data, row) {
            self.q[column] = -value;
        }
        if !system.solve(&self.q, &self.zeros) {
            return None;
        }
        let slot = self.free_slots.pop()?;
        let range = slot * self.size..(slot + 1) * self.size;
        self.columns[range].copy_from_slice(system.primal());
        Some(slot)
    }

    fn column_of(&self, slot: usize) -> &[f64] {
        &self.columns[slot * self.size..(slot + 1) * self.size]
    }

    /// Sets `half` to L^-1 A_W w of a row and returns its curvature.
    fn project(&mut self, data: &QpData, rows: &Rows, row: usize, slot: usize) -> Curvature {
        let whole = rows.product(data, row, self.column_of(slot));
        let mut left = whole;
        for j in 0..self.active.len() {
            let v = rows.product(data, self.active[j], self.column_of(slot));
            let half = self.forward(j, v);
            left -= half * half;
        }
        Curvature { whole, left }
    }

    /// Sets and returns entry j of L^-1 v from those before it.
    fn forward(&mut self, j: usize, v: f64) -> f64 {
        let line = &self.factor[j * self.capacity..=j * self.capacity + j];
        let known: f64 = line[..j].iter().zip(&self.half).map(|(l, h)| l * h).sum();
        self.half[j] = (v - known) / line[j];
        self.half[j]
    }

    /// Sets `ratios` to L'^-1 `half`.
    fn solve_ratios(&mut self) {
        let count = self.active.len();
        self.ratios.clear();
        self.ratios.extend_from_slice(&self.half[..count]);
        for j in (0..count).rev() {
            let line = &self.factor[j * self.capacity..=j * self.capacity + j];
            let r = self.ratios[j] / line[j];
            self.ratios[j] = r;
            for (other, l) in self.ratios[..j].iter_mut().zip(line) {
                *other -= l * r;
            }
        }
    }

    /// Computes the multipliers of the rows added so far from their slacks without them, and drops rows
    /// with negative ones.
    fn let_go_of_negative(&mut self, slacks: &[f64]) {
        loop {
            for j in 0..self.active.len() {
                self.forward(j, -slacks[self.active[j]]);
            }
            self.solve_ratios();
            self.multipliers.copy_from_slice(&self.ratios);
            let count = self.active.len();
            for j in (0..count).rev() {
                if self.multipliers[j] < 0.0 {
                    self.let_go(j);
                }
            }
            if self.active.len() == count {
                return;
            }
        }
    }

    /// Appends a row for which `half` was computed.
    fn take_in(&mut self, row: usize, slot: usize, left: f64, multiplier: f64) {
        let j = self.active.len();
        let line = &mut self.factor[j * self.capacity..=j * self.capacity + j];
        line[..j].copy_from_slice(&self.half[..j]);
        line[j] = left.sqrt();
        self.active.push(row);
        self.slots.push(slot);
        self.multipliers.push(multiplier);
    }

    /// Removes a row, and its line from L.
    fn let_go(&mut self, j: usize) {
        self.active.remove(j);
        self.multipliers.remove(j);
        self.free_slots.push(self.slots.remove(j));
        let (count, width) = (self.active.len(), self.capacity);
        for i in j..count {
            let below = (i + 1) * width;
            self.factor.copy_within(below..below + i + 2, i * width);
        }
        // Each line from j on now ends right of the diagonal: rotations bring it back.
        for i in j..count {
            let (a, b) = (self.factor[i * width + i], self.factor[i * width + i + 1]);
            let size = a.hypot(b);
            let (cos, sin) = (a / size, b / size);
            for line in i..count {
                let left = line * width + i;
                let (x, y) = (self.factor[left], self.factor[left + 1]);
                self.factor[left] = cos * x + sin * y;
                self.factor[left + 1] = cos * y - sin * x;
            }
        }
    }
}

/// a' w of a row, and what of it the rows in force leave.
struct Curvature {
    whole: f64,
    left: f64,
}

/// Adds `by` times `direction` to a vector.
fn step(vector: &mut [f64], direction: &[f64], by: f64) {
    for (x, d) in vector.iter_mut().zip(direction) {
        *x += by * d;
    }
}
