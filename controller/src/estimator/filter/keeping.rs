//! What the filter keeps of what it learned: over a break, and in a file.

use super::super::gains::{InitialParameters, LearnedGains};
use super::super::learned::LearnedModel;
use super::Filter;
use nalgebra::SMatrix;
use sidehill_plant::frames::Attitude;

impl<M: LearnedModel<N>, const N: usize> Filter<M, N> {
    /// Resets the filter, except for what was learned where that is kept: the next attitude and pose are
    /// accepted as the first ones were.
    pub(in crate::estimator) fn restart(&mut self) {
        let (keeps, kept) = (self.keeps, self.kept());
        let mut model = self.model.clone();
        model.forget_found();
        *self = Self {
            keeps,
            kept: kept.filter(|_| keeps),
            ..Self::new(self.settings, model)
        };
    }

    pub(in crate::estimator) fn keep_learned(&mut self, keep: bool) {
        self.keeps = keep;
    }

    pub(in crate::estimator) fn learned_into(&self, gains: &mut LearnedGains) -> bool {
        let kept = self.kept();
        if let Some(kept) = &kept {
            gains.fill(kept, &self.model.prior());
        }
        kept.is_some()
    }

    pub(in crate::estimator) fn recall(
        &mut self,
        learned: &LearnedGains,
    ) -> Result<(), &'static str> {
        let mut kept = learned.kept(&self.model.prior())?;
        self.model.bound(&mut kept.mean, &Attitude::LEVEL);
        self.kept = Some(kept);
        Ok(())
    }

    /// Returns the covariance of the parameters after the newest reading.
    pub(in crate::estimator) fn parameter_covariance(&self) -> Option<&SMatrix<f64, N, N>> {
        self.events
            .back()
            .map(|event| &event.belief.parameter_covariance)
    }

    /// Returns what is known of the parameters to begin with after a break.
    pub(super) fn kept(&self) -> Option<InitialParameters<N>> {
        let learned = self.events.back().map(|event| {
            let belief = &event.belief;
            let kept = InitialParameters {
                mean: belief.parameters,
                covariance: belief.parameter_covariance,
            };
            kept.over_a_break(&self.model.prior())
        });
        learned.or(self.kept)
    }
}
