//! Where the vehicle is now: an extended Kalman filter over dead reckoning and late poses.
//!
//! The state is (x, y, yaw) in the world and the parameters of the model that are learned: the gains of
//! a correction of ICRIK, or the physical parameters of a contact vehicle. Tread speeds and attitude
//! drive it by equation (12) with the velocity of the model; a pose corrects it *at the time it was
//! taken*: readings are kept in the order of their stamps for a while, and a late one is put in its
//! place and all after it replayed.
//!
//! A gyroscope gives the heading between poses in the model's place, less its bias, which is a state too, and
//! shows what the model says of the yaw rate at once.
//!
//! The parameters are constants that the filter does not know: what a pose says about them follows from
//! their covariance with it, which grows only where they are excited. At standstill, straight
//! ahead and without poses nothing is learned and nothing winds up.

mod belief;
mod contact;
mod contact_settings;
mod estimate;
mod filter;
mod gains;
mod gate;
mod gyro;
mod learned;
mod model_error;
mod pose_noise;
mod process_noise;
mod settings;
mod slip;

pub use contact_settings::ContactLearningSettings;
pub use estimate::{ContactEstimate, Estimate, Innovation, Refused};
pub(crate) use estimate::{bound_of_m, slide_share};
pub(crate) use filter::HISTORY_S;
pub use gains::LearnedGains;
pub use settings::{AdaptationSettings, EstimatorSettings};
pub(crate) use slip::SLIP_SMOOTHING_M_S;

use contact::LearnedContact;
use filter::Filter;
use nalgebra::{DMatrix, Matrix3};
use sidehill_plant::contact::{ContactPrediction, PARAMETERS};
use sidehill_plant::sample::Sample;
use sidehill_plant::vehicle::Vehicle;
use slip::{GAINS, SlipModel};

/// The filter with the model it learns.
#[derive(Clone)]
pub struct Estimator(EstimatorKind);

#[derive(Clone)]
enum EstimatorKind {
    Slip(Box<Filter<SlipModel, GAINS>>),
    Contact(Box<Filter<LearnedContact, PARAMETERS>>),
}

impl Estimator {
    /// Returns an estimator without any reading; `vehicle` gives its dead reckoning by ICRIK, whose
    /// correction it learns.
    pub fn new(settings: EstimatorSettings, vehicle: Vehicle) -> Self {
        let model = SlipModel::new(vehicle, settings.adaptation);
        Self(EstimatorKind::Slip(Box::new(Filter::new(settings, model))))
    }

    /// Returns an estimator without any reading, with dead reckoning by the balance of wheel friction,
    /// whose parameters it learns. Base and factors of the encoders are `vehicle`'s.
    pub fn with_contact(
        settings: EstimatorSettings,
        vehicle: &Vehicle,
        contact: ContactPrediction,
    ) -> Self {
        let model = LearnedContact::new(vehicle, contact, settings.contact);
        Self(EstimatorKind::Contact(Box::new(Filter::new(
            settings, model,
        ))))
    }

    /// Keeps what is learned over [`Estimator::restart`].
    pub fn keep_learned(&mut self, keep: bool) {
        match &mut self.0 {
            EstimatorKind::Slip(filter) => filter.keep_learned(keep),
            EstimatorKind::Contact(filter) => filter.keep_learned(keep),
        }
    }

    /// Puts what has been learned into room for it; returns whether anything has.
    pub fn learned_into(&self, gains: &mut LearnedGains) -> bool {
        match &self.0 {
            EstimatorKind::Slip(filter) => filter.learned_into(gains),
            EstimatorKind::Contact(filter) => filter.learned_into(gains),
        }
    }

    /// Returns the covariance of what is learned: for a contact vehicle of the entries of
    /// [`ContactEstimate::parameters`], else of the gains of [`Estimate::slip_gains`], row by row. None before the first
    /// reading.
    pub fn learned_covariance(&self) -> Option<DMatrix<f64>> {
        let (size, entries) = match &self.0 {
            EstimatorKind::Slip(filter) => (GAINS, filter.parameter_covariance()?.as_slice()),
            EstimatorKind::Contact(filter) => {
                (PARAMETERS, filter.parameter_covariance()?.as_slice())
            }
        };
        Some(DMatrix::from_column_slice(size, size, entries))
    }

    /// Begins with what was learned before.
    ///
    /// # Errors
    /// Which value is not plausible.
    pub fn recall(&mut self, learned: &LearnedGains) -> Result<(), &'static str> {
        match &mut self.0 {
            EstimatorKind::Slip(filter) => filter.recall(learned),
            EstimatorKind::Contact(filter) => filter.recall(learned),
        }
    }

    /// Forgets where the vehicle is, and what was learned unless it is kept: the next attitude and pose are
    /// accepted as the first ones were.
    pub fn restart(&mut self) {
        match &mut self.0 {
            EstimatorKind::Slip(filter) => filter.restart(),
            EstimatorKind::Contact(filter) => filter.restart(),
        }
    }

    /// Returns the innovation of the newest pose of the last update, accepted or not.
    pub fn innovation(&self) -> Option<Innovation> {
        match &self.0 {
            EstimatorKind::Slip(filter) => filter.innovation(),
            EstimatorKind::Contact(filter) => filter.innovation(),
        }
    }

    /// Returns the rate at which the covariance of (x, y, yaw) grows at the time of the last update, poses aside: m^2/s, m rad/s
    /// and rad^2/s. Poses take as much from it in the mean.
    pub(crate) fn growth(&self) -> &Matrix3<f64> {
        match &self.0 {
            EstimatorKind::Slip(filter) => filter.growth(),
            EstimatorKind::Contact(filter) => filter.growth(),
        }
    }

    /// Takes a cycle's readings and returns the state at the cycle's time, or `None` until a first
    /// attitude and a first pose have arrived. Readings that are not finite are left out and named.
    pub fn update(&mut self, sample: &Sample) -> (Option<Estimate>, Refused) {
        match &mut self.0 {
            EstimatorKind::Slip(filter) => filter.update(sample),
            EstimatorKind::Contact(filter) => filter.update(sample),
        }
    }
}

#[cfg(test)]
mod tests;
