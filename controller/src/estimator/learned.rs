//! What the filter needs from a model whose parameters it learns.

use super::process_noise::ProcessNoise;
use super::{ContactEstimate, EstimatorSettings};
use nalgebra::{SMatrix, SVector, Vector3};
use sidehill_plant::contact::BodyState;
use sidehill_plant::frames::{Attitude, BodyVelocity};
use sidehill_plant::slip_gains::SlipGains;
use sidehill_plant::speeds::{EncoderScale, TreadSpeeds};

/// Parameters before anything is known, independent of each other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Prior<const N: usize> {
    pub(super) mean: SVector<f64, N>,
    /// Standard deviations.
    pub(super) sigma: SVector<f64, N>,
}

impl<const N: usize> Prior<N> {
    pub(super) fn covariance(&self) -> SMatrix<f64, N, N> {
        SMatrix::from_diagonal(&self.sigma.component_mul(&self.sigma))
    }
}

/// How parameters change by themselves over an interval: each keeps a share of its distance from its prior
/// and gains variance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Drift<const N: usize> {
    pub(super) keep: SVector<f64, N>,
    pub(super) variance: SVector<f64, N>,
}

/// A body velocity (right, forward, yaw rate) and its derivatives by the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ModelVelocity<const N: usize> {
    pub(super) value: Vector3<f64>,
    pub(super) by_parameters: SMatrix<f64, 3, N>,
}

/// How the body moves at an instant, and the derivatives by the parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moving<const N: usize> {
    pub(super) state: BodyState,
    pub(super) by_parameters: BodyState<N>,
}

impl<const N: usize> From<(BodyVelocity, SMatrix<f64, 3, N>)> for ModelVelocity<N> {
    fn from((velocity, by_parameters): (BodyVelocity, SMatrix<f64, 3, N>)) -> Self {
        Self {
            value: velocity.vector(),
            by_parameters,
        }
    }
}

impl<const N: usize> From<(BodyVelocity, SMatrix<f64, 3, N>)> for Moving<N> {
    fn from(velocity: (BodyVelocity, SMatrix<f64, 3, N>)) -> Self {
        ModelVelocity::from(velocity).into()
    }
}

impl<const N: usize> From<ModelVelocity<N>> for Moving<N> {
    /// Returns a steady motion.
    fn from(velocity: ModelVelocity<N>) -> Self {
        Self {
            state: BodyState::steady(velocity.value),
            by_parameters: BodyState::steady(velocity.by_parameters),
        }
    }
}

/// How a vehicle moves over a time: once it has settled, in the mean, and at the end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Moved<const N: usize> {
    pub(super) settled: ModelVelocity<N>,
    pub(super) mean: ModelVelocity<N>,
    pub(super) end: Moving<N>,
}

/// A model of the body velocity with N parameters that are observable from poses.
pub(super) trait LearnedModel<const N: usize>: Clone {
    /// Returns the prior of the parameters, before the first pose.
    fn prior(&self) -> Prior<N>;

    /// Returns the velocity of steady motion and its derivative by the parameters. The same arguments give the same
    /// numbers, to 1e-9, whatever came before: late readings are replayed.
    fn velocity(
        &mut self,
        attitude: Attitude,
        treads: TreadSpeeds,
        parameters: &SVector<f64, N>,
    ) -> (BodyVelocity, SMatrix<f64, 3, N>);

    /// Forgets what came before, so that the same arguments give the same numbers to the last digit.
    fn forget_found(&mut self) {}

    /// Returns the motion over `time_s` of a vehicle that moved as `before` and may follow with inertia.
    fn moved(
        &mut self,
        attitude: Attitude,
        treads: TreadSpeeds,
        parameters: &SVector<f64, N>,
        _before: &Moving<N>,
        _time_s: f64,
    ) -> Moved<N> {
        let settled = ModelVelocity::from(self.velocity(attitude, treads, parameters));
        Moved {
            settled,
            mean: settled,
            end: settled.into(),
        }
    }

    /// Returns the factors of the encoders.
    fn encoder_scale(&self) -> EncoderScale;

    /// Returns the growth of the uncertainty of dead reckoning besides that of the parameters.
    fn process_noise(&self, settings: &EstimatorSettings) -> ProcessNoise;

    /// Returns how the parameters change by themselves while the treads move for `time_s`.
    fn drift(&self, treads: TreadSpeeds, time_s: f64) -> Drift<N>;

    /// Puts parameters within their ranges, and within those of a vehicle that stands at an attitude.
    fn bound(&self, parameters: &mut SVector<f64, N>, attitude: &Attitude);

    /// Returns the learned slip gains; zero where that is not what is learned.
    fn slip_gains(&self, parameters: &SVector<f64, N>) -> SlipGains;

    /// Returns the learned parameters of a contact vehicle, where these are learned.
    fn contact(
        &self,
        parameters: &SVector<f64, N>,
        covariance: &SMatrix<f64, N, N>,
    ) -> Option<ContactEstimate>;
}
