//! What the scatter of segments says about fitted parameters.

use nalgebra::{DMatrix, DVector, SymmetricEigen};

/// Weighted Jacobian and residuals of one segment.
#[derive(Debug, Clone)]
pub(super) struct Cluster {
    /// Rows as residuals, columns as parameters.
    pub(super) jacobian: DMatrix<f64>,
    pub(super) residuals: DVector<f64>,
}

/// Returns the parameters that follow from all clusters but `left_out`, by one Gauss-Newton step from the
/// fit to all, whose normal matrix is `normal`; the fit's own where the others do not determine them.
pub fn parameters_without<'a>(
    parameters: &[f64],
    normal: &DMatrix<f64>,
    left_out: impl Iterator<Item = &'a Cluster>,
) -> Vec<f64> {
    // The sum of all gradients is 0 at the minimum, so the rest's is that of those left out, negative.
    let (mut rest, mut gradient) = (normal.clone(), DVector::zeros(parameters.len()));
    for cluster in left_out {
        rest -= cluster.jacobian.tr_mul(&cluster.jacobian);
        gradient -= cluster.jacobian.tr_mul(&cluster.residuals);
    }
    let step = rest.cholesky().map(|c| c.solve(&gradient));
    let steps = (0..parameters.len()).map(|i| step.as_ref().map_or(0.0, |step| step[i]));
    parameters
        .iter()
        .zip(steps)
        .map(|(value, step)| value - step)
        .collect()
}

/// Returns the covariance of the parameters, if the Jacobian determines them.
///
/// With B = (sum J'J)^-1 and a segment's gradient g = J'r it is `B (sum g g') B K/(K - p)`, for K
/// segments and p parameters: the covariance for errors that are independent between segments and
/// arbitrarily correlated within one (K.-Y. Liang, S. Zeger, "Longitudinal data analysis using
/// generalized linear models", Biometrika 1986).
pub(super) fn covariance(clusters: &[Cluster]) -> Option<DMatrix<f64>> {
    let parameters = clusters.first()?.jacobian.ncols();
    let mut normal = DMatrix::zeros(parameters, parameters);
    let mut scatter = DMatrix::zeros(parameters, parameters);
    for cluster in clusters {
        normal += cluster.jacobian.tr_mul(&cluster.jacobian);
        let gradient = cluster.jacobian.tr_mul(&cluster.residuals);
        scatter += &gradient * gradient.transpose();
    }
    let bread = normal.try_inverse()?;
    let free = clusters.len().checked_sub(parameters).filter(|k| *k > 0)?;
    Some(&bread * scatter * &bread * (clusters.len() as f64 / free as f64))
}

/// A combination of parameters that the data hardly change with.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WeakDirection {
    /// Change of the residuals along it as a share of that along the best known direction.
    pub(super) strength: f64,
    /// Positions of the parameters that take part.
    pub(super) parameters: Vec<usize>,
}

/// Returns the weakest direction when it is weaker than `strength_min`, from the eigenvalues of J'J
/// with columns scaled to length one.
pub(super) fn weak_direction(clusters: &[Cluster], strength_min: f64) -> Option<WeakDirection> {
    let parameters = clusters.first()?.jacobian.ncols();
    let mut normal = DMatrix::zeros(parameters, parameters);
    for cluster in clusters {
        normal += cluster.jacobian.tr_mul(&cluster.jacobian);
    }
    let lengths = normal.diagonal().map(|square: f64| square.sqrt());
    if let Some(unseen) = lengths.iter().position(|length| *length == 0.0) {
        return Some(WeakDirection {
            strength: 0.0,
            parameters: vec![unseen],
        });
    }
    let scaled = DMatrix::from_fn(parameters, parameters, |i, j| {
        normal[(i, j)] / (lengths[i] * lengths[j])
    });
    let eigen = SymmetricEigen::new(scaled);
    let strongest = eigen.eigenvalues.max();
    let (weakest, value) = eigen.eigenvalues.argmin();
    let strength = (value.max(0.0) / strongest).sqrt();
    (strength < strength_min).then(|| WeakDirection {
        strength,
        parameters: (0..parameters)
            .filter(|i| eigen.eigenvectors[(*i, weakest)].abs() > 0.3)
            .collect(),
    })
}

/// Returns the factor from a standard deviation to half the width of the 95 % confidence interval,
/// with `free` degrees of freedom: Student's quantile in the Cornish-Fisher expansion, within 2 % for
/// 4 degrees and more.
pub(super) fn confidence_factor(free: usize) -> f64 {
    let inverse = 1.0 / free.max(1) as f64;
    1.960 + inverse * (2.372 + inverse * 2.823)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn students_quantile_is_met() {
        for (free, quantile) in [(4, 2.776), (10, 2.228), (30, 2.042), (1000, 1.962)] {
            assert!((confidence_factor(free) / quantile - 1.0).abs() < 0.02);
        }
    }

    #[test]
    fn the_mean_of_independent_values_has_its_textbook_variance() {
        let values = [1.0, 2.0, 4.0, 8.0, 10.0];
        let mean = 5.0;
        let clusters: Vec<Cluster> = values
            .iter()
            .map(|value| Cluster {
                jacobian: DMatrix::from_element(1, 1, 1.0),
                residuals: DVector::from_element(1, mean - value),
            })
            .collect();
        let sum: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
        let variance = covariance(&clusters).unwrap()[(0, 0)];
        assert!((variance - sum / 4.0 / 5.0).abs() < 1e-12);
    }

    #[test]
    fn columns_that_move_together_are_named() {
        let cluster = |a: f64, b: f64| Cluster {
            jacobian: DMatrix::from_row_slice(2, 3, &[a, a, 0.0, b, b + 1e-4, 1.0]),
            residuals: DVector::zeros(2),
        };
        let clusters = [cluster(1.0, 2.0), cluster(3.0, 1.0)];
        let weak = weak_direction(&clusters, 0.03).unwrap();
        assert_eq!(weak.parameters, vec![0, 1]);
        assert!(weak_direction(&clusters, 1e-9).is_none());
    }
}
