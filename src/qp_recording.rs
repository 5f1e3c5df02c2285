//! The QPs of a run in a file that others can read: NumPy's npz.
//!
//! ```text
//! minimise 1/2 x' P x + q' x   subject to   A x + s = b,  s = 0 (the first rows), s >= 0 (the rest)
//! ```
//!
//! All QPs of a run have one sparsity pattern. The file holds it once, in compressed columns
//! (`P_indptr`, `P_indices`, `A_indptr`, `A_indices`; P is the upper triangle), with `equalities`, the
//! number of rows with s = 0. Of each QP, a row an array, it holds `P_data`, `q`, `A_data`, `b`, the
//! solution `x` with the multipliers `y`, and `time_s`, `iterations`, `solve_us`.

use anyhow::{Context, Result, ensure};
use ndarray::{ArrayView, ArrayView2, Ix1, arr0};
use ndarray_npy::NpzWriter;
use sidehill_controller::mpc::{CscMatrix, Point, QpData, SolveReport};
use std::fs::File;
use std::io::BufWriter;
use std::path::Path;

/// The QPs of a run, each as its cycle assembled it, and what the cycle made of it.
#[derive(Debug, Clone, Default)]
pub struct QpRecording {
    pattern: Option<Pattern>,
    p: Vec<f64>,
    q: Vec<f64>,
    a: Vec<f64>,
    b: Vec<f64>,
    x: Vec<f64>,
    y: Vec<f64>,
    times_s: Vec<f64>,
    iterations: Vec<i64>,
    solve_us: Vec<f64>,
}

/// What the QPs of a run have in common.
#[derive(Debug, Clone)]
struct Pattern {
    p: Indices,
    a: Indices,
    equalities: i64,
}

/// Where a matrix of compressed columns has its entries.
#[derive(Debug, Clone)]
struct Indices {
    starts: Vec<i64>,
    rows: Vec<i64>,
}

impl Indices {
    fn of(matrix: &CscMatrix<f64>) -> Self {
        let whole = |indices: &[usize]| indices.iter().map(|&i| i as i64).collect();
        Self {
            starts: whole(&matrix.colptr),
            rows: whole(&matrix.rowval),
        }
    }
}

impl QpRecording {
    /// Adds the QP of the cycle at `time_s` with the point that was found for it.
    pub fn push(&mut self, time_s: f64, (data, point): (&QpData, &Point), report: &SolveReport) {
        self.pattern.get_or_insert_with(|| Pattern {
            p: Indices::of(&data.p),
            a: Indices::of(&data.a),
            equalities: data.equalities as i64,
        });
        self.p.extend_from_slice(&data.p.nzval);
        self.q.extend_from_slice(&data.q);
        self.a.extend_from_slice(&data.a.nzval);
        self.b.extend_from_slice(&data.b);
        self.x.extend_from_slice(&point.primal);
        self.y.extend_from_slice(&point.dual);
        self.times_s.push(time_s);
        self.iterations.push(i64::from(report.iterations));
        self.solve_us.push(1e6 * report.solve_time_s);
    }

    /// Writes the file.
    ///
    /// # Errors
    /// No QP was recorded, or the file cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        let pattern = self.pattern.as_ref().context("the run solved no QP")?;
        let mut npz = NpzWriter::new(BufWriter::new(File::create(path)?));
        for (name, indices) in [
            ("P_indptr", &pattern.p.starts),
            ("P_indices", &pattern.p.rows),
            ("A_indptr", &pattern.a.starts),
            ("A_indices", &pattern.a.rows),
            ("iterations", &self.iterations),
        ] {
            npz.add_array(name, &ArrayView::<_, Ix1>::from(indices))?;
        }
        npz.add_array("equalities", &arr0(pattern.equalities))?;
        let count = self.times_s.len();
        for (name, values) in [
            ("P_data", &self.p),
            ("q", &self.q),
            ("A_data", &self.a),
            ("b", &self.b),
            ("x", &self.x),
            ("y", &self.y),
        ] {
            ensure!(values.len() % count == 0, "the QPs differ in size");
            let rows = ArrayView2::from_shape((count, values.len() / count), values)?;
            npz.add_array(name, &rows)?;
        }
        for (name, values) in [("time_s", &self.times_s), ("solve_us", &self.solve_us)] {
            npz.add_array(name, &ArrayView::<_, Ix1>::from(values))?;
        }
        npz.finish()?;
        Ok(())
    }
}
