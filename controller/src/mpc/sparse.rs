//! The QP of a horizon in compressed columns, for solvers that know nothing of stages.
//!
//! ```text
//! minimise 1/2 z' P z + q' z   subject to   A z + s = b,  s = 0 (equalities), s >= 0 (the rest)
//! ```
//!
//! z has the v of the stages in turn: the deviation of the state at a stage's end, then those of its inputs. The
//! equalities are the dynamics. Each row of a [`StageQp`] is two here: its high end, then its low one; an end that is
//! none is a row of zeros.

pub use clarabel::algebra::CscMatrix;

use super::stage_qp::{MOTORS, Point, STATES, StageQp, StageRow, VARIABLES};

/// A QP's data; values may be overwritten between solves.
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
}

/// A QP with the point that its solver ended with.
#[derive(Debug, Clone)]
pub struct SolvedQp {
    /// The QP.
    pub data: QpData,
    /// Variables z.
    pub primal: Vec<f64>,
    /// Multipliers y of A's rows, those of inequalities not negative.
    pub dual: Vec<f64>,
}

/// The data of QPs of one pattern.
#[derive(Clone)]
pub struct Sparse {
    pub data: QpData,
    linear: Vec<[f64; VARIABLES]>,
    /// Where each entry, in the order of `hessian` and `constraints`, stands among the values of P and A.
    p_places: Vec<usize>,
    a_places: Vec<usize>,
}

impl Sparse {
    /// Returns the data of a QP.
    pub fn new(qp: &StageQp) -> Self {
        let (mut of_p, mut of_a) = (Vec::new(), Vec::new());
        qp.hessian(|row, column, _| of_p.push((row, column)));
        qp.constraints(|row, column, _| of_a.push((row, column)));
        let stages = qp.stages.len();
        let (variables, equalities) = (VARIABLES * stages, STATES * stages);
        let rows = equalities + 2 * qp.rows().len();
        let (p, p_places) = pattern(variables, variables, &of_p);
        let (a, a_places) = pattern(rows, variables, &of_a);
        let data = QpData {
            p,
            q: vec![0.0; variables],
            a,
            b: vec![0.0; rows],
            equalities,
        };
        let linear = vec![[0.0; VARIABLES]; stages];
        let mut sparse = Self {
            data,
            linear,
            p_places,
            a_places,
        };
        sparse.write(qp);
        sparse
    }

    /// Puts the values of a QP of the same stages and rows in place of those before.
    pub fn write(&mut self, qp: &StageQp) {
        let data = &mut self.data;
        let mut places = self.p_places.iter();
        qp.hessian(|_, _, value| {
            if let Some(place) = places.next() {
                data.p.nzval[*place] = value;
            }
        });
        let mut places = self.a_places.iter();
        qp.constraints(|_, _, value| {
            if let Some(place) = places.next() {
                data.a.nzval[*place] = value;
            }
        });
        qp.linear(&mut self.linear);
        data.q.copy_from_slice(self.linear.as_flattened());
        let ends = data.b[data.equalities..].chunks_exact_mut(2);
        for (row, ends) in qp.rows().iter().zip(ends) {
            for (end, (sign, value)) in ends.iter_mut().zip(row.ends()) {
                *end = if value.is_finite() { sign * value } else { 1.0 };
            }
        }
    }
}

impl StageRow {
    /// Returns the sign of a side and its end, of the high side and of the low one.
    fn ends(&self) -> [(f64, f64); 2] {
        [(1.0, self.high), (-1.0, self.low)]
    }
}

impl StageQp {
    /// Calls `put` with row, column and value of each entry of P's upper triangle.
    fn hessian(&self, mut put: impl FnMut(usize, usize, f64)) {
        for (k, terms) in self.stages.iter().enumerate() {
            let first = VARIABLES * k;
            let mut weight = terms.weight;
            let [by_yaw, by_inputs @ ..] = &terms.speed_row;
            for (m, by) in by_inputs.iter().enumerate() {
                let own = STATES + m;
                weight[own][own] += terms.change_weight[m];
                for (entry, other) in weight[own][STATES..].iter_mut().zip(by_inputs) {
                    *entry += terms.speed_weight * by * other;
                }
            }
            if let Some(next) = self.stages.get(k + 1) {
                weight[2][2] += next.speed_weight * next.speed_row[0] * next.speed_row[0];
                for m in 0..MOTORS {
                    weight[STATES + m][STATES + m] += next.change_weight[m];
                }
            }
            for (row, entries) in weight.iter().enumerate() {
                for (column, entry) in entries.iter().enumerate().skip(row) {
                    put(first + row, first + column, *entry);
                }
            }
            if let Some(before) = first.checked_sub(VARIABLES) {
                for (m, by) in by_inputs.iter().enumerate() {
                    let own = first + STATES + m;
                    put(before + STATES + m, own, -terms.change_weight[m]);
                    put(before + 2, own, terms.speed_weight * by_yaw * by);
                }
            }
        }
    }

    /// Calls `put` with row, column and value of each entry of A.
    fn constraints(&self, mut put: impl FnMut(usize, usize, f64)) {
        for (k, terms) in self.stages.iter().enumerate() {
            let (first, first_row) = (VARIABLES * k, STATES * k);
            for i in 0..STATES {
                put(first_row + i, first + i, 1.0);
                for m in 0..MOTORS {
                    put(first_row + i, first + STATES + m, -terms.by_input[m][i]);
                }
                let Some(before) = first.checked_sub(VARIABLES) else {
                    continue;
                };
                let unit = if i == 2 { 1.0 } else { 0.0 };
                put(first_row + i, before + 2, -unit - terms.by_yaw[i]);
                if i < 2 {
                    put(first_row + i, before + i, -1.0);
                }
            }
        }
        let equalities = STATES * self.stages.len();
        for (row, own) in self.rows().iter().enumerate() {
            let k = self.stage_of(row);
            let extra = self.extra_rows(k).contains(&row);
            for (side, (sign, end)) in own.ends().into_iter().enumerate() {
                let factor = if end.is_finite() { sign } else { 0.0 };
                let place = equalities + 2 * row + side;
                for (i, by) in own.by.iter().enumerate() {
                    if extra || *by != 0.0 {
                        put(place, VARIABLES * k + i, factor * by);
                    }
                }
                for (m, by) in own.by_before.iter().enumerate() {
                    if *by != 0.0 {
                        put(place, VARIABLES * (k - 1) + STATES + m, factor * by);
                    }
                }
            }
        }
    }

    /// Returns the QP in compressed columns with a point of it.
    pub fn solved(&self, point: &Point) -> SolvedQp {
        let data = Sparse::new(self).data;
        let rollout = &point.rollout;
        let states = rollout.states.iter().zip(&rollout.inputs);
        let primal =
            states.flat_map(|([x, y, yaw], [traction, steer])| [x, y, yaw, traction, steer]);
        let costates = self.costates(point).into_iter().flatten();
        let sides = point
            .multipliers
            .iter()
            .flat_map(|y| [y.max(0.0), (-y).max(0.0)]);
        SolvedQp {
            data,
            primal: primal.copied().collect(),
            dual: costates.map(|costate| -costate).chain(sides).collect(),
        }
    }
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
