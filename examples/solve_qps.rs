//! Solves the QPs of a recording in their order, as the controller would: the part of Sidehill in
//! `benches/peers`.
//!
//!     cargo run --release --example solve_qps -- QPS.npz RESULT.npz
//!
//! QPS.npz is what `sidehill simulate --record-qps` writes. RESULT.npz gets for each way of solving
//! (`active_set`, `interior_point`) the points `..._x`, a row each, and the times
//! `..._us`, and `reference_x`, the interior-point method's at a tolerance of 1e-9.

use anyhow::{Context, Result, ensure};
use ndarray::{Array1, Array2};
use ndarray_npy::NpzWriter;
use sidehill::qp_recording;
use sidehill_controller::mpc::{QpMode, QpSettings, QpSolver, StageQp};
use std::fs::File;
use std::time::Instant;

/// The reference's tolerance.
const EXACT: f64 = 1e-9;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let (qps, result) = arguments
        .next()
        .zip(arguments.next())
        .context("usage: solve_qps QPS.npz RESULT.npz")?;
    let qps = qp_recording::read(qps.as_ref())?;
    ensure!(!qps.is_empty(), "there is no QP in the recording");
    let settings = QpSettings::default();
    let mode = |mode| QpSettings { mode, ..settings };
    let exact = QpSettings {
        mode: QpMode::InteriorPoint,
        tolerance: EXACT,
        max_iterations: 100,
        ..settings
    };
    let mut npz = NpzWriter::new(File::create(result)?);
    for (name, settings) in [
        ("active_set", mode(QpMode::ActiveSet)),
        ("interior_point", mode(QpMode::InteriorPoint)),
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
fn solve_all(qps: &[StageQp], settings: QpSettings) -> Result<(Array2<f64>, Array1<f64>)> {
    let mut solver = QpSolver::new(qps[0].clone(), settings)?;
    let mut points = Array2::from_elem((qps.len(), solver.solved().primal.len()), f64::NAN);
    let mut times_us = Array1::zeros(qps.len());
    for (i, data) in qps.iter().enumerate() {
        solver.qp_mut().clone_from(data);
        let begin = Instant::now();
        let solved = solver.solve(None);
        times_us[i] = 1e6 * begin.elapsed().as_secs_f64();
        if solved.is_ok() {
            points
                .row_mut(i)
                .assign(&Array1::from(solver.solved().primal));
        }
    }
    Ok((points, times_us))
}
