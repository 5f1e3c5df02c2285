//! Nonlinear least squares: the one file that knows the solver and its matrices.
//!
//! The `levenberg-marquardt` crate is a tested port of MINPACK and copes with rank-deficient
//! Jacobians.

use levenberg_marquardt::{LeastSquaresProblem, LevenbergMarquardt};
use nalgebra::{DMatrix, DVector, Dyn, Owned};

/// A function whose sum of squares is to be minimised.
pub(super) trait Residuals: Sync {
    /// Returns the residuals at `parameters`, always the same number of them.
    fn residuals(&self, parameters: &[f64]) -> Vec<f64>;
}

/// Step of the central differences, in units of the parameters, which are all of order 0.1 to 10.
const STEP: f64 = 1e-5;

/// Returns the columns of the residuals' Jacobian, by central differences, each in a thread of its own.
pub(super) fn jacobian_columns(problem: &impl Residuals, parameters: &[f64]) -> Vec<Vec<f64>> {
    let column = |index: usize| -> Vec<f64> {
        let at = |offset: f64| {
            let mut moved = parameters.to_vec();
            moved[index] += offset;
            problem.residuals(&moved)
        };
        let (up, down) = (at(STEP), at(-STEP));
        up.iter()
            .zip(&down)
            .map(|(up, down)| (up - down) / (2.0 * STEP))
            .collect()
    };
    std::thread::scope(|scope| {
        let start = |index| scope.spawn(move || column(index));
        let columns: Vec<_> = (0..parameters.len()).map(start).collect();
        let ended = columns.into_iter().map(|column| {
            let found = column.join();
            found.unwrap_or_else(|panic| std::panic::resume_unwind(panic))
        });
        ended.collect()
    })
}

/// Returns the parameters of the least sum of squares, searched from `start`, and whether the search
/// ended there.
pub(super) fn minimise(problem: &impl Residuals, start: &[f64]) -> (Vec<f64>, bool) {
    let adapter = Adapter {
        problem,
        parameters: DVector::from_column_slice(start),
    };
    let (adapter, report) = LevenbergMarquardt::new()
        .with_tol(1e-10)
        .with_patience(20)
        .minimize(adapter);
    (
        adapter.parameters.as_slice().to_vec(),
        report.termination.was_successful(),
    )
}

struct Adapter<'a, P> {
    problem: &'a P,
    parameters: DVector<f64>,
}

impl<P: Residuals> LeastSquaresProblem<f64, Dyn, Dyn> for Adapter<'_, P> {
    type ResidualStorage = Owned<f64, Dyn>;
    type JacobianStorage = Owned<f64, Dyn, Dyn>;
    type ParameterStorage = Owned<f64, Dyn>;

    fn set_params(&mut self, parameters: &DVector<f64>) {
        self.parameters.copy_from(parameters);
    }

    fn params(&self) -> DVector<f64> {
        self.parameters.clone()
    }

    fn residuals(&self) -> Option<DVector<f64>> {
        Some(DVector::from_vec(
            self.problem.residuals(self.parameters.as_slice()),
        ))
    }

    fn jacobian(&self) -> Option<DMatrix<f64>> {
        let columns = jacobian_columns(self.problem, self.parameters.as_slice());
        let rows = columns.first().map_or(0, Vec::len);
        Some(DMatrix::from_iterator(
            rows,
            columns.len(),
            columns.into_iter().flatten(),
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Decay;

    impl Residuals for Decay {
        fn residuals(&self, parameters: &[f64]) -> Vec<f64> {
            (0..20)
                .map(|i| {
                    let t = 0.2 * f64::from(i);
                    parameters[0] * (-parameters[1] * t).exp() - 3.0 * (-0.7 * t).exp()
                })
                .collect()
        }
    }

    #[test]
    fn a_decay_is_found() {
        let (found, ended) = minimise(&Decay, &[1.0, 0.1]);
        assert!(ended);
        assert!((found[0] - 3.0).abs() < 1e-6 && (found[1] - 0.7).abs() < 1e-6);
    }

    /// Only the sum of the parameters matters.
    struct Sum;

    impl Residuals for Sum {
        fn residuals(&self, parameters: &[f64]) -> Vec<f64> {
            vec![parameters[0] + parameters[1] - 2.0; 3]
        }
    }

    #[test]
    fn a_deficient_jacobian_still_lowers_the_residuals() {
        let (found, _) = minimise(&Sum, &[0.0, 0.0]);
        assert!((found[0] + found[1] - 2.0).abs() < 1e-6);
    }
}
