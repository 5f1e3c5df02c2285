//! A QP's data, a point of it, and how far that point is from optimal.
//!
//! ```text
//! minimise 1/2 z' P z + q' z   subject to   A z + s = b,  s = 0 (equalities), s >= 0 (the rest)
//! ```

pub use super::clarabel_qp::CscMatrix;
use super::stage_terms::StageTerms;
use serde::{Deserialize, Serialize};

/// Optimality of a point, computed from the data and not from the solver's own account.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Residuals {
    /// Largest entry of |A z + s - b|, and how far s or the multipliers leave their cone.
    pub primal: f64,
    /// Largest entry of |P z + q + A' y|.
    pub dual: f64,
    /// |z' P z + q' z + b' y|.
    pub gap: f64,
}

impl Residuals {
    /// Returns whether all are at most `limit`; one that is not a number is not.
    pub fn within(&self, limit: f64) -> bool {
        self.primal <= limit && self.dual <= limit && self.gap <= limit
    }
}

/// A QP's data with the pattern it was made with; values may be overwritten between solves.
#[derive(Debug, Clone)]
pub struct QpData {
    /// Upper triangle of P.
    pub p: CscMatrix<f64>,
    /// Linear cost.
    pub q: Vec<f64>,
    /// Constraint matrix, equalities first.
    pub a: CscMatrix<f64>,
    /// Right-hand side.
    pub b: Vec<f64>,
    /// Number of equality rows.
    pub equalities: usize,
    /// The same dynamics and cost stage by stage, where the inequalities are bounds and changes of the
    /// inputs alone; else empty.
    pub stages: Vec<StageTerms>,
}

/// A primal and dual point of a QP.
#[derive(Debug, Clone)]
pub struct Point {
    /// Variables z.
    pub primal: Vec<f64>,
    /// Multipliers y of the rows, those of inequalities not negative.
    pub dual: Vec<f64>,
    /// Slacks s of the rows, those of inequalities not negative.
    pub slack: Vec<f64>,
}

impl Point {
    /// Returns the origin of a problem's space.
    pub fn zeros(data: &QpData) -> Self {
        Self {
            primal: vec![0.0; data.q.len()],
            dual: vec![0.0; data.b.len()],
            slack: vec![0.0; data.b.len()],
        }
    }
}

impl QpData {
    /// Returns whether all values are finite.
    pub fn is_finite(&self) -> bool {
        [&self.p.nzval, &self.q, &self.a.nzval, &self.b]
            .into_iter()
            .all(|values| values.iter().all(|value| value.is_finite()))
    }

    /// Returns the cost of a primal point.
    pub fn cost(&self, primal: &[f64]) -> f64 {
        let mut quadratic = 0.0;
        for (column, x) in primal.iter().enumerate() {
            for (row, value) in entries(&self.p, column) {
                // Half of what stands on the diagonal, all of what stands for two entries.
                let share = if row == column { 0.5 } else { 1.0 };
                quadratic += share * value * primal[row] * x;
            }
        }
        quadratic + dot(&self.q, primal)
    }

    /// Returns A's values in the rows of the equalities, in the order they are stored.
    pub fn equality_values(&self) -> impl Iterator<Item = f64> + '_ {
        let rows = self.a.rowval.iter().zip(&self.a.nzval);
        rows.filter(|(row, _)| **row < self.equalities)
            .map(|(_, value)| *value)
    }

    /// Returns the problem with its equalities alone.
    pub fn without_inequalities(&self) -> Self {
        let mut entries = Vec::new();
        for column in 0..self.a.n {
            let rows = &self.a.rowval[self.a.colptr[column]..self.a.colptr[column + 1]];
            let kept = rows.iter().filter(|row| **row < self.equalities);
            entries.extend(kept.map(|row| (*row, column)));
        }
        let (mut a, _) = pattern(self.equalities, self.a.n, &entries);
        a.nzval = self.equality_values().collect();
        Self {
            p: self.p.clone(),
            q: self.q.clone(),
            a,
            b: self.b[..self.equalities].to_vec(),
            equalities: self.equalities,
            stages: Vec::new(),
        }
    }

    /// Sets a point's slacks to b - A z, and those of the equalities to 0.
    pub fn slacken(&self, point: &mut Point) {
        point.slack.copy_from_slice(&self.b);
        for (column, z) in point.primal.iter().enumerate() {
            for (row, value) in entries(&self.a, column) {
                point.slack[row] -= value * z;
            }
        }
        point.slack[..self.equalities].fill(0.0);
    }

    /// Returns the KKT residuals of a point, relative to the largest term of each; `work` has the
    /// lengths of the point's.
    pub fn residuals(&self, point: &Point, work: &mut Point) -> Residuals {
        let (z, y, s) = (&point.primal, &point.dual, &point.slack);
        let (gradient, rows) = (&mut work.primal, &mut work.slack);
        gradient.fill(0.0);
        for (column, &x) in z.iter().enumerate() {
            // The upper triangle stands for both: each entry but the diagonal's counts twice.
            let mut across = 0.0;
            for (row, value) in entries(&self.p, column) {
                if row == column {
                    across += value * x;
                } else {
                    gradient[row] += value * x;
                    across += value * z[row];
                }
            }
            gradient[column] += across;
        }
        let quadratic = dot(gradient, z);
        for (total, q) in gradient.iter_mut().zip(&self.q) {
            *total += q;
        }
        for ((residual, s), b) in rows.iter_mut().zip(s).zip(&self.b) {
            *residual = s - b;
        }
        for (column, (&x, total)) in z.iter().zip(&mut *gradient).enumerate() {
            let mut force = 0.0;
            for (row, value) in entries(&self.a, column) {
                rows[row] += value * x;
                force += value * y[row];
            }
            *total += force;
        }
        let largest = |values: &[f64]| values.iter().fold(0.0_f64, |m, v| nan_max(m, v.abs()));
        let outside = s[self.equalities..]
            .iter()
            .chain(&y[self.equalities..])
            .fold(0.0_f64, |m, v| nan_max(m, -v));
        let linear = dot(&self.q, z);
        let gap = quadratic + linear + dot(&self.b, y);
        Residuals {
            primal: nan_max(largest(rows), outside) / (1.0 + largest(&self.b).max(largest(z))),
            dual: largest(gradient) / (1.0 + largest(&self.q)),
            gap: gap.abs() / (1.0 + (0.5 * quadratic + linear).abs()),
        }
    }
}

/// Returns the entries of a matrix's column, each with its row.
fn entries(matrix: &CscMatrix<f64>, column: usize) -> impl Iterator<Item = (usize, f64)> + '_ {
    let stored = matrix.colptr[column]..matrix.colptr[column + 1];
    let values = &matrix.nzval[stored.clone()];
    let rows = matrix.rowval[stored].iter().copied();
    rows.zip(values.iter().copied())
}

/// Returns the larger of two values, or NaN where one is: a NaN must not hide behind a maximum.
fn nan_max(a: f64, b: f64) -> f64 {
    // No comparison with a NaN is true.
    if a >= b || a.is_nan() { a } else { b }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns a matrix in compressed columns with the given entries, all 1, and where each entry's value
/// stands in it.
///
/// Entries must be distinct; their order is free.
pub fn pattern(
    rows: usize,
    columns: usize,
    entries: &[(usize, usize)],
) -> (CscMatrix<f64>, Vec<usize>) {
    let mut order: Vec<usize> = (0..entries.len()).collect();
    order.sort_by_key(|&i| (entries[i].1, entries[i].0));
    let mut column_starts = vec![0; columns + 1];
    for &(_, column) in entries {
        column_starts[column + 1] += 1;
    }
    for column in 0..columns {
        column_starts[column + 1] += column_starts[column];
    }
    let mut positions = vec![0; entries.len()];
    for (position, &entry) in order.iter().enumerate() {
        positions[entry] = position;
    }
    let row_indices = order.iter().map(|&i| entries[i].0).collect();
    let values = vec![1.0; entries.len()];
    (
        CscMatrix::new(rows, columns, column_starts, row_indices, values),
        positions,
    )
}
