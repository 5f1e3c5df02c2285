//! Learned gains as they are stored.

use super::learned::Prior;
use nalgebra::{SMatrix, SVector};
use serde::{Deserialize, Serialize};

/// Parameters of the filter's model with their covariance, in the order of the model.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LearnedGains {
    /// Values.
    pub mean: Vec<f64>,
    /// Covariance, column by column.
    pub covariance: Vec<f64>,
    /// Standard deviations before anything was learned.
    pub prior_sigma: Vec<f64>,
}

/// Share of the prior's variance that comes back over a break: the ground may have changed.
const FORGOTTEN: f64 = 0.02;
/// Standard deviations of the prior beyond which a value is rejected.
const SIGMAS_MAX: f64 = 6.0;

impl LearnedGains {
    /// Returns by how much the standard deviations have shrunk, on average, 0 to 1.
    pub fn confidence(&self) -> f64 {
        let n = self.prior_sigma.len();
        let gone = self
            .prior_sigma
            .iter()
            .enumerate()
            .filter_map(|(i, prior)| {
                let sigma = self.covariance.get(i * (n + 1))?.sqrt();
                (*prior > 0.0).then(|| (1.0 - sigma / prior).clamp(0.0, 1.0))
            });
        let gone: Vec<f64> = gone.collect();
        gone.iter().sum::<f64>() / gone.len().max(1) as f64
    }

    /// Returns room for the gains of any model.
    pub(crate) fn room() -> Self {
        /// More than any model has.
        const PARAMETERS_MAX: usize = 32;
        Self {
            mean: Vec::with_capacity(PARAMETERS_MAX),
            covariance: Vec::with_capacity(PARAMETERS_MAX * PARAMETERS_MAX),
            prior_sigma: Vec::with_capacity(PARAMETERS_MAX),
        }
    }

    pub(super) fn fill<const N: usize>(&mut self, kept: &InitialParameters<N>, prior: &Prior<N>) {
        let put = |into: &mut Vec<f64>, values: &[f64]| {
            into.clear();
            into.extend_from_slice(values);
        };
        put(&mut self.mean, kept.mean.as_slice());
        put(&mut self.covariance, kept.covariance.as_slice());
        put(&mut self.prior_sigma, prior.sigma.as_slice());
    }

    /// Returns the gains if their numbers are plausible, else which are not.
    pub(super) fn kept<const N: usize>(
        &self,
        prior: &Prior<N>,
    ) -> Result<InitialParameters<N>, &'static str> {
        if self.mean.len() != N || self.covariance.len() != N * N {
            return Err("gains have another number than the model");
        }
        let finite = |values: &[f64]| values.iter().all(|value| value.is_finite());
        if !finite(&self.mean) || !finite(&self.covariance) {
            return Err("gains are not finite");
        }
        let mean: SVector<f64, N> = SVector::from_column_slice(&self.mean);
        let given: SMatrix<f64, N, N> = SMatrix::from_column_slice(&self.covariance);
        let covariance = 0.5 * (given + given.transpose());
        for i in 0..N {
            let (sigma, off) = (prior.sigma[i], f64::abs(mean[i] - prior.mean[i]));
            let variance: f64 = covariance[(i, i)];
            if variance < 0.0 || variance > 4.0 * sigma * sigma || off > SIGMAS_MAX * sigma {
                return Err("gains are out of their range");
            }
        }
        Ok(InitialParameters { mean, covariance })
    }
}

/// Parameters and covariance to begin with in place of the prior's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct InitialParameters<const N: usize> {
    pub(super) mean: SVector<f64, N>,
    pub(super) covariance: SMatrix<f64, N, N>,
}

impl<const N: usize> InitialParameters<N> {
    /// Returns what is kept over a break.
    pub(super) fn over_a_break(self, prior: &Prior<N>) -> Self {
        Self {
            covariance: self.covariance + FORGOTTEN * prior.covariance(),
            ..self
        }
    }
}
