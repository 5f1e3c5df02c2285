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
use anyhow::{Context, Result, ensure};
use ndarray::{Array0, Array1, Array2, ArrayView, ArrayView2, Ix1, arr0};
use ndarray_npy::{NpzReader, NpzWriter};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::controller::Controller;
use sidehill_controller::mpc::{CscMatrix, Point, QpData, SolveReport, StageTerms};
use std::fs::File;
use std::io::Cursor;
use std::path::Path;

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
    /// No QP was recorded.
    pub fn npz(&self) -> Result<Vec<u8>> {
        let first = self.first.as_ref().context("the run solved no QP")?;
        let whole =
            |indices: &[usize]| -> Array1<i64> { indices.iter().map(|&i| i as i64).collect() };
        let mut npz = NpzWriter::new(Cursor::new(Vec::new()));
        for (name, indices) in [
            ("P_indptr", &first.p.colptr),
            ("P_indices", &first.p.rowval),
            ("A_indptr", &first.a.colptr),
            ("A_indices", &first.a.rowval),
        ] {
            npz.add_array(name, &whole(indices))?;
        }
        npz.add_array("iterations", &Array1::from(self.iterations.clone()))?;
        npz.add_array("equalities", &arr0(first.equalities as i64))?;
        let count = self.times_s.len();
        for (name, values) in [
            ("P_data", &self.p),
            ("q", &self.q),
            ("A_data", &self.a),
            ("b", &self.b),
            ("x", &self.x),
            ("y", &self.y),
        ] {
            let rows = ArrayView2::from_shape((count, values.len() / count), values)?;
            npz.add_array(name, &rows)?;
        }
        if !self.stages.is_empty() {
            let terms = self.stages.iter().flat_map(StageTerms::to_array).collect();
            let size = first.stages.len() * StageTerms::COUNT;
            npz.add_array("stages", &Array2::from_shape_vec((count, size), terms)?)?;
        }
        for (name, values) in [("time_s", &self.times_s), ("solve_us", &self.solve_us)] {
            npz.add_array(name, &ArrayView::<_, Ix1>::from(values))?;
        }
        Ok(npz.finish()?.into_inner())
    }
}

/// Returns the QPs of a file.
///
/// # Errors
/// Names the file that cannot be read or has inconsistent arrays.
pub fn read(path: &Path) -> Result<Vec<QpData>> {
    read_arrays(path).with_context(|| format!("{}: not a recording of QPs", path.display()))
}

fn read_arrays(path: &Path) -> Result<Vec<QpData>> {
    let mut npz = NpzReader::new(File::open(path)?)?;
    let mut indices = |name: &str| -> Result<Vec<usize>> {
        let stored: Array1<i64> = npz.by_name(name).with_context(|| name.to_owned())?;
        let whole = stored
            .iter()
            .map(|&i| usize::try_from(i))
            .collect::<Result<_, _>>();
        whole.with_context(|| name.to_owned())
    };
    let (p_starts, p_rows) = (indices("P_indptr")?, indices("P_indices")?);
    let (a_starts, a_rows) = (indices("A_indptr")?, indices("A_indices")?);
    let stored: Array0<i64> = npz.by_name("equalities")?;
    let equalities = usize::try_from(stored.into_scalar()).context("equalities")?;
    let mut rows =
        |name: &str| -> Result<Array2<f64>> { npz.by_name(name).with_context(|| name.to_owned()) };
    let (p, q, a, b) = (rows("P_data")?, rows("q")?, rows("A_data")?, rows("b")?);
    // Not of QPs with other limits than bounds and changes.
    let stages = rows("stages").unwrap_or_else(|_| Array2::zeros((q.nrows(), 0)));
    let (variables, constraints) = (q.ncols(), b.ncols());
    ensure!(
        [p.nrows(), a.nrows(), b.nrows(), stages.nrows()] == [q.nrows(); 4]
            && equalities <= constraints,
        "the arrays differ in length"
    );
    ensure!(
        stages.ncols().is_multiple_of(StageTerms::COUNT),
        "stages: {} numbers a QP are no multiple of {}: an older version wrote the file, record it anew",
        stages.ncols(),
        StageTerms::COUNT
    );
    let columns = |rows: usize, starts: &[usize], indices: &[usize], values: &Array2<f64>| {
        let ends = starts.first() == Some(&0) && starts.last() == Some(&indices.len());
        ends && starts.len() == variables + 1
            && starts.is_sorted()
            && indices.iter().all(|&row| row < rows)
            && values.ncols() == indices.len()
    };
    ensure!(
        columns(variables, &p_starts, &p_rows, &p),
        "P is no matrix of the size of q"
    );
    ensure!(
        columns(constraints, &a_starts, &a_rows, &a),
        "A is no matrix of the size of b and q"
    );
    let matrix = |rows, starts: &Vec<usize>, indices: &Vec<usize>, values: Vec<f64>| {
        CscMatrix::new(rows, variables, starts.clone(), indices.clone(), values)
    };
    let qps = (0..q.nrows()).map(|i| QpData {
        p: matrix(variables, &p_starts, &p_rows, p.row(i).to_vec()),
        q: q.row(i).to_vec(),
        a: matrix(constraints, &a_starts, &a_rows, a.row(i).to_vec()),
        b: b.row(i).to_vec(),
        equalities,
        stages: stages
            .row(i)
            .to_vec()
            .chunks(StageTerms::COUNT)
            .map(StageTerms::from_numbers)
            .collect(),
    });
    Ok(qps.collect())
}
