//! The QPs of a run in a portable file: NumPy's npz.
//!
//! ```text
//! minimise 1/2 x' P x + q' x   subject to   A x + s = b,  s = 0 (the first rows), s >= 0 (the rest)
//! ```
//!
//! All QPs of a run share a sparsity pattern. The file contains it once, in compressed columns
//! (`P_indptr`, `P_indices`, `A_indptr`, `A_indices`; P is the upper triangle), with `equalities`, the
//! number of rows with s = 0. Of each QP, a row an array, it holds `P_data`, `q`, `A_data`, `b`, the
//! solution `x` with the multipliers `y`, `time_s`, `iterations` and `solve_us`. For Sidehill's own
//! solver it holds the same QPs stage by stage: `stages` and `rows`, with `input_rows`, the number of a
//! stage's rows that limit inputs.

use crate::closed_loop::Observer;
use anyhow::{Context, Result, ensure};
use ndarray::{Array0, Array1, Array2, ArrayView, ArrayView2, Ix1, arr0};
use ndarray_npy::{NpzReader, NpzWriter};
use sidehill_controller::closed_loop::Cycle;
use sidehill_controller::controller::Controller;
use sidehill_controller::mpc::{QpData, QpSolver, SolveReport, SolvedQp, StageQp};
use std::fs::File;
use std::io::Cursor;
use std::path::Path;

/// The QPs of a run, each with its solution.
#[derive(Debug, Clone, Default)]
pub struct QpRecording {
    /// The first QP in compressed columns, whose pattern all share.
    first: Option<QpData>,
    qps: Vec<StageQp>,
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

impl Observer for QpRecording {
    fn begin(&mut self, _: &Controller) -> Result<()> {
        Ok(())
    }

    fn cycle(&mut self, cycle: &Cycle, controller: &Controller) -> Result<()> {
        if let (Some(mpc), Some(report)) = (controller.mpc(), &cycle.decision.solve) {
            self.push(cycle.state.time_s, mpc.qp_solver(), report);
        }
        Ok(())
    }
}

impl QpRecording {
    /// Adds the QP of the cycle at `time_s` with its solution.
    pub fn push(&mut self, time_s: f64, solver: &QpSolver, report: &SolveReport) {
        let SolvedQp { data, primal, dual } = solver.solved();
        self.p.extend_from_slice(&data.p.nzval);
        self.q.extend_from_slice(&data.q);
        self.a.extend_from_slice(&data.a.nzval);
        self.b.extend_from_slice(&data.b);
        self.first.get_or_insert(data);
        self.qps.push(solver.qp().clone());
        self.x.extend(primal);
        self.y.extend(dual);
        self.times_s.push(time_s);
        self.iterations.push(i64::from(report.iterations));
        self.solve_us.push(1e6 * report.solve_time_s);
    }

    /// Returns the QPs.
    pub fn qps(&self) -> &[StageQp] {
        &self.qps
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
        let numbers: Vec<_> = self.qps.iter().map(StageQp::to_numbers).collect();
        for (i, name) in ["stages", "rows"].into_iter().enumerate() {
            let values: Vec<f64> = numbers
                .iter()
                .flat_map(|own| own[i].iter().copied())
                .collect();
            let width = values.len() / count;
            npz.add_array(name, &Array2::from_shape_vec((count, width), values)?)?;
        }
        let input_rows = self.qps.first().map_or(0, StageQp::input_rows);
        npz.add_array("input_rows", &arr0(input_rows as i64))?;
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
pub fn read(path: &Path) -> Result<Vec<StageQp>> {
    read_arrays(path).with_context(|| format!("{}: not a recording of QPs", path.display()))
}

fn read_arrays(path: &Path) -> Result<Vec<StageQp>> {
    let mut npz = NpzReader::new(File::open(path)?)?;
    let stored: Array0<i64> = npz
        .by_name("input_rows")
        .context("input_rows: missing; an older version wrote the file, record it anew")?;
    let input_rows = usize::try_from(stored.into_scalar()).context("input_rows")?;
    let mut numbers =
        |name: &str| -> Result<Array2<f64>> { npz.by_name(name).with_context(|| name.to_owned()) };
    let (stages, rows) = (numbers("stages")?, numbers("rows")?);
    ensure!(
        stages.nrows() == rows.nrows(),
        "stages and rows are of {} and {} QPs",
        stages.nrows(),
        rows.nrows()
    );
    let qps = stages
        .rows()
        .into_iter()
        .zip(rows.rows())
        .map(|(terms, rows)| {
            StageQp::from_numbers(&terms.to_vec(), &rows.to_vec(), input_rows)
                .context("stages and rows are no numbers of the same stages")
        });
    qps.collect()
}
