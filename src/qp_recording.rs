//! The QPs of a run in a portable file: NumPy's npz.
//!
//! ```text
//! minimise 1/2 x' P x + q' x   subject to   A x + s = b,  s = 0 (the first rows), s >= 0 (the rest)
//! ```
//!
//! All QPs of a run share a sparsity pattern. The file contains it once, in compressed columns
//! (`P_indptr`, `P_indices`, `A_indptr`, `A_indices`; P is the upper triangle), with `equalities`, the
//! number of rows with s = 0. Of each QP, a row an array, it holds `P_data`, `q`, `A_data`, `b`, the
//! solution `x` with the multipliers `y`, `time_s`, `iterations`, `solve_us`, and, where only bounds and
//! changes of the inputs limit it, the terms of its `stages`.

use crate::closed_loop::Observer;
use crate::npz::Npz;
use anyhow::{Context, Result};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::controller::Controller;
use sidehill_controller::mpc::{Point, QpData, SolveReport, StageTerms};

/// The QPs of a run, each with its solution.
#[derive(Debug, Clone, Default)]
pub struct QpRecording {
    /// The first QP, whose pattern all share.
    first: Option<QpData>,
    p: Vec<f64>,
    q: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    /// Of all QPs, one after the other.
    stages: Vec<StageTerms>,
    x: Vec<f64>,
    y: Vec<f64>,
    times_s: Vec<f64>,
    iterations: Vec<i64>,
    solve_us: Vec<f64>,
}

impl Observer for QpRecording {
    fn begin(&mut self, _: &Controller) -> Result<()> {
        Ok(())
    }

    fn cycle(&mut self, cycle: &Cycle, controller: &Controller) -> Result<()> {
        if let (Some(mpc), Some(report)) = (controller.mpc(), &cycle.decision.solve) {
            self.push(cycle.state.time_s, mpc.qp(), report);
        }
        Ok(())
    }
}

impl QpRecording {
    /// Adds the QP of the cycle at `time_s` with its solution.
    pub fn push(&mut self, time_s: f64, (data, point): (&QpData, &Point), report: &SolveReport) {
        self.first.get_or_insert_with(|| data.clone());
        self.p.extend_from_slice(&data.p.nzval);
        self.q.extend_from_slice(&data.q);
        self.a.extend_from_slice(&data.a.nzval);
        self.b.extend_from_slice(&data.b);
        self.stages.extend_from_slice(&data.stages);
        self.x.extend_from_slice(&point.primal);
        self.y.extend_from_slice(&point.dual);
        self.times_s.push(time_s);
        self.iterations.push(i64::from(report.iterations));
        self.solve_us.push(1e6 * report.solve_time_s);
    }

    /// Returns the QPs.
    pub fn qps(&self) -> Vec<QpData> {
        let Some(first) = &self.first else {
            return Vec::new();
        };
        fn values<T: Clone>(all: &[T], size: usize, i: usize) -> Vec<T> {
            all[i * size..(i + 1) * size].to_vec()
        }
        let qp = |i| {
            let mut qp = first.clone();
            qp.p.nzval = values(&self.p, qp.p.nzval.len(), i);
            qp.q = values(&self.q, qp.q.len(), i);
            qp.a.nzval = values(&self.a, qp.a.nzval.len(), i);
            qp.b = values(&self.b, qp.b.len(), i);
            qp.stages = values(&self.stages, qp.stages.len(), i);
            qp
        };
        (0..self.times_s.len()).map(qp).collect()
    }

    /// Returns the file's bytes.
    ///
    /// # Errors
    /// No QP was recorded, or there are more bytes than a file of this format may have.
    pub fn npz(&self) -> Result<Vec<u8>> {
        let first = self.first.as_ref().context("the run solved no QP")?;
        let mut npz = Npz::default();
        for (name, indices) in [
            ("P_indptr", &first.p.colptr),
            ("P_indices", &first.p.rowval),
            ("A_indptr", &first.a.colptr),
            ("A_indices", &first.a.rowval),
        ] {
            let indices: Vec<i64> = indices.iter().map(|&i| i as i64).collect();
            npz.integers(name, &[indices.len()], &indices)?;
        }
        let count = self.times_s.len();
        npz.integers("iterations", &[count], &self.iterations)?;
        npz.integers("equalities", &[], &[first.equalities as i64])?;
        for (name, values) in [
            ("P_data", &self.p),
            ("q", &self.q),
            ("A_data", &self.a),
            ("b", &self.b),
            ("x", &self.x),
            ("y", &self.y),
        ] {
            npz.floats(name, &[count, values.len() / count], values)?;
        }
        if !self.stages.is_empty() {
            let terms: Vec<f64> = self.stages.iter().flat_map(StageTerms::to_array).collect();
            npz.floats("stages", &[count, terms.len() / count], &terms)?;
        }
        for (name, values) in [("time_s", &self.times_s), ("solve_us", &self.solve_us)] {
            npz.floats(name, &[count], values)?;
        }
        npz.finish()
    }
}
