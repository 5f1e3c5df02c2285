//! Solves the QPs of a recording in their order, as the controller would: the part of Sidehill in
//! `benches/peers`.
//!
//!     cargo run --release --example solve_qps -- QPS.npz RESULT.npz
//!
//! QPS.npz is what `sidehill simulate --record-qps` writes. RESULT.npz gets for each way of solving
//! (`working_set`, `in_place`, `fresh_defaults`) the points `..._x`, a row each, and the times
//! `..._us`, and `reference_x`, the interior-point method's at a tolerance of 1e-9.

use anyhow::{Context, Result, ensure};
use ndarray::{Array0, Array1, Array2, ArrayView1};
use ndarray_npy::{NpzReader, NpzWriter};
use sidehill_controller::mpc::{CscMatrix, QpData, QpMode, QpSettings, QpSolver, StageTerms};
use std::fs::File;
use std::path::Path;
use std::time::Instant;

/// The reference's tolerance.
const EXACT: f64 = 1e-9;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (qps, result) = arguments
        .next()
        .zip(arguments.next())
        .context("usage: solve_qps QPS.npz RESULT.npz")?;
    let qps = read(qps.as_ref())?;
    ensure!(!qps.is_empty(), "there is no QP in the recording");
    let settings = QpSettings::default();
    let mode = |mode| QpSettings { mode, ..settings };
    let exact = QpSettings {
        mode: QpMode::InPlace,
        tolerance: EXACT,
        max_iterations: 100,
        ..settings
    };
    let mut npz = NpzWriter::new(File::create(result)?);
    for (name, settings) in [
        ("working_set", mode(QpMode::WorkingSet)),
        ("in_place", mode(QpMode::InPlace)),
        ("fresh_defaults", mode(QpMode::FreshDefaults)),
        ("reference", exact),
    ] {
        let (points, times_us) = solve_all(&qps, settings)?;
        npz.add_array(format!("{name}_x"), &points)?;
        if name != "reference" {
            npz.add_array(format!("{name}_us"), &times_us)?;
        }
    }
    npz.finish()?;
    Ok(())
}

/// Returns the points, NaN where a solve failed, and the times of the solves.
fn solve_all(qps: &[QpData], settings: QpSettings) -> Result<(Array2<f64>, Array1<f64>)> {
    let mut solver = QpSolver::new(qps[0].clone(), settings)?;
    let mut points = Array2::from_elem((qps.len(), qps[0].q.len()), f64::NAN);
    let mut times_us = Array1::zeros(qps.len());
    for (i, data) in qps.iter().enumerate() {
        solver.data_mut().clone_from(data);
        let begin = Instant::now();
        let solved = solver.solve(None);
        times_us[i] = 1e6 * begin.elapsed().as_secs_f64();
        if solved.is_ok() {
            points
                .row_mut(i)
                .assign(&ArrayView1::from(solver.point().primal.as_slice()));
        }
    }
    Ok((points, times_us))
}

/// Returns the QPs of a file.
///
/// # Errors
/// Names the file that cannot be read or has inconsistent arrays.
fn read(path: &Path) -> Result<Vec<QpData>> {
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
        "stages: {} numbers a QP are no multiple of {}: record the file anew",
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
