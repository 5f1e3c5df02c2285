//! The QP of a control cycle with its solution.

use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use sidehill_controller::mpc::{CscMatrix, Mpc, SolvedQp};

/// The quadratic programme that an MPC solved in a control cycle, with its solution.
///
/// minimise 1/2 x' P x + q' x subject to l <= A x <= u. The multipliers y have P x + q + A' y = 0, those of inequalities are
/// not negative. x has, stage by stage, the deviations from the plan before: of (x, y, yaw) at the stage's end, and of
/// traction and steer.
#[pyclass(frozen, module = "sidehill")]
pub struct Qp {
    solved: SolvedQp,
    /// Values of A and B of the stages, row by row.
    linearised: [Vec<f64>; 2],
    stages: usize,
}

impl Qp {
    /// Returns the QP that `mpc` solved last.
    pub fn of(mpc: &Mpc) -> Self {
        let mut linearised = [Vec::new(), Vec::new()];
        for step in mpc.linearised_stages() {
            let (yaw, traction, steer) = (step.by_yaw, step.by_traction, step.by_steer);
            let [a, b] = &mut linearised;
            a.extend([1.0, 0.0, yaw.x, 0.0, 1.0, yaw.y, 0.0, 0.0, 1.0 + yaw.z]);
            b.extend((0..3).flat_map(|i| [traction[i], steer[i]]));
        }
        Self {
            solved: mpc.qp_solver().solved(),
            stages: mpc.linearised_stages().len(),
            linearised,
        }
    }
}

/// Returns a matrix as an array; of a symmetric one the upper triangle is given.
fn dense<'py>(
    py: Python<'py>,
    matrix: &CscMatrix<f64>,
    symmetric: bool,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let mut values = vec![0.0; matrix.m * matrix.n];
    for column in 0..matrix.n {
        for entry in matrix.colptr[column]..matrix.colptr[column + 1] {
            let (row, value) = (matrix.rowval[entry], matrix.nzval[entry]);
            values[row * matrix.n + column] = value;
            if symmetric {
                values[column * matrix.n + row] = value;
            }
        }
    }
    PyArray1::from_vec(py, values).reshape([matrix.m, matrix.n])
}

#[pymethods]
#[allow(non_snake_case)]
impl Qp {
    /// P, symmetric: array of shape (n, n).
    #[getter]
    fn P<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        dense(py, &self.solved.data.p, true)
    }

    /// q: array of shape (n,).
    #[getter]
    fn q<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solved.data.q)
    }

    /// A: array of shape (m, n): the dynamics of all stages, then the limits of each stage, from above and from below in turn.
    #[getter]
    fn A<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        dense(py, &self.solved.data.a, false)
    }

    /// l: array of shape (m,), -inf where only u bounds.
    #[getter]
    fn l<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        let mut low = vec![f64::NEG_INFINITY; self.solved.data.b.len()];
        let equalities = self.solved.data.equalities;
        low[..equalities].copy_from_slice(&self.solved.data.b[..equalities]);
        PyArray1::from_vec(py, low)
    }

    /// u: array of shape (m,).
    #[getter]
    fn u<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solved.data.b)
    }

    /// The solution: array of shape (n,).
    #[getter]
    fn x<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solved.primal)
    }

    /// Multipliers of the rows of A at the solution: array of shape (m,).
    #[getter]
    fn y<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.solved.dual)
    }

    /// A of each stage, d(x, y, yaw)+ / d(x, y, yaw): array of shape (N, 3, 3).
    #[getter]
    fn stages_A<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        PyArray1::from_slice(py, &self.linearised[0]).reshape([self.stages, 3, 3])
    }

    /// B of each stage, d(x, y, yaw)+ / d(traction, steer): array of shape (N, 3, 2).
    #[getter]
    fn stages_B<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        PyArray1::from_slice(py, &self.linearised[1]).reshape([self.stages, 3, 2])
    }

    /// c of each stage, where its step about the plan ends less the plan's next state: array of shape (N, 3). It is zero, as
    /// the plan's states are those where the steps end.
    #[getter]
    fn stages_c<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        Ok(PyArray2::zeros(py, [self.stages, 3], false))
    }

    fn __repr__(&self) -> String {
        format!(
            "<sidehill.Qp of {} variables and {} rows>",
            self.solved.data.q.len(),
            self.solved.data.b.len()
        )
    }
}
