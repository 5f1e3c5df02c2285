//! Identification of a vehicle on wheels with friction: what `contact-mpc` starts from.
//!
//! The parameters of the [balance of wheel friction](crate::contact) and both factors of the encoders are
//! fitted to level logs and slope logs together, by the least squares of the other stages: segments are
//! dead-reckoned by the balance, and their start poses are estimated. The search starts from what is known
//! of the vehicle, geometry at least, and is drawn back there by a prior that weighs as much as one
//! residual of 1 cm. So what the logs determine is theirs, and what they do not stays at its guess, with
//! the guess's interval.

use super::fit::{Fit, FitStage, IdentificationError, IdentificationSettings, cut, smoothed};
use super::segments::{Segment, SegmentErrors};
use super::statistics::{Cluster, confidence_factor, covariance, parameters_without};
use crate::contact::{ContactPrediction, ContactVehicle, Parameter, ParameterVector};
use crate::log::DriveLog;
use crate::odometry::KinematicModel;
use crate::speeds::EncoderScale;
use crate::vehicle::{RangeError, Vehicle};
use nalgebra::{DMatrix, DVector};

/// Folds, each held out once, of runs of consecutive segments.
const FOLDS: usize = 10;
const RUN: usize = 3;
/// Residual at which the prior's pull counts as one standard deviation, m.
const PRIOR_RESIDUAL_M: f64 = 0.01;
/// Factor on the prior's pull in a first search.
const FIRST_PULL: f64 = 30.0;
/// Standard deviation of the factors of the encoders.
const SCALE_SIGMA: f64 = 0.05;
/// Correlation above which two parameters are not distinguished.
const CORRELATION_MAX: f64 = 0.95;
/// Share of its guess's standard deviation below which a parameter counts as determined.
const DETERMINED: f64 = 0.5;

/// A parameter of a contact vehicle with what the logs say of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ContactParameterEstimate {
    /// Its key in the vehicle's section `contact`.
    pub name: &'static str,
    /// Its value, in its own unit.
    pub value: f64,
    /// Ends of its 95 % interval.
    pub interval: (f64, f64),
    /// Whether the logs determine it more than the guess that the search started from does.
    pub determined: bool,
}

/// What identification of a contact vehicle did and how far to trust it.
#[derive(Debug, Clone, PartialEq)]
pub struct ContactReport {
    /// The parameters.
    pub estimates: Vec<ContactParameterEstimate>,
    /// Pairs that the logs cannot distinguish, with their correlation.
    pub not_told_apart: Vec<(&'static str, &'static str, f64)>,
    /// Segments used.
    pub segments: usize,
    /// Errors of the guess that the search started from.
    pub guess: SegmentErrors,
    /// Errors on held-out segments.
    pub held_out: SegmentErrors,
    /// Folds of held-out segments.
    pub folds: usize,
    /// Folds whose poses the fit predicts nearer than the guess does.
    pub folds_nearer: usize,
    /// Whether the search settled.
    pub settled: bool,
}

impl ContactReport {
    /// Returns whether the fit predicts held-out segments better than the guess that it started from, beyond chance: in
    /// so many folds that a coin would show it in one of twenty trials.
    pub fn is_nearer(&self) -> bool {
        let position_m = |errors: &SegmentErrors| errors.lateral_m.hypot(errors.longitudinal_m);
        self.settled
            && position_m(&self.held_out) < position_m(&self.guess)
            && 10 * self.folds_nearer >= 8 * self.folds
    }
}

/// Returns the vehicle with its section `contact` fitted to the logs: level logs and slope logs together. The
/// search starts at the vehicle's own contact vehicle, or at the guess for its base. Where the fit does not predict
/// better than that start ([`ContactReport::is_nearer`]), the vehicle keeps the start.
///
/// # Errors
/// Says so when there are too few segments, or names a key that is out of range.
pub fn identify_contact(
    logs: &[DriveLog],
    vehicle: &Vehicle,
    settings: &IdentificationSettings,
) -> Result<(Vehicle, ContactReport), IdentificationError> {
    let range = |reason: RangeError| IdentificationError::NotAVehicle {
        reason,
        warnings: Vec::new(),
    };
    let logs = smoothed(logs, settings);
    let segments = cut(&logs, settings);
    let search = ContactSearch::new(vehicle).map_err(range)?;
    let needed = search.names.len() + FOLDS;
    if segments.len() < needed {
        return Err(IdentificationError::TooFewSegments {
            found: segments.len(),
            needed,
        });
    }
    let start = search.start.clone();
    let vehicle_with = |parameters: &[f64]| search.vehicle_with(parameters);
    let stage = |pull_m| FitStage {
        names: &search.names,
        model: KinematicModel::Contact,
        baseline: KinematicModel::Icrhk,
        vehicle_with: &vehicle_with,
        pull_m,
    };
    // What hardly shows in the logs must not diverge before the rest is about right.
    let strong_m: Vec<f64> = search.pull_m.iter().map(|pull| FIRST_PULL * pull).collect();
    let first = stage(&strong_m).fit(&segments, &start);
    let fit = stage(&search.pull_m).fit_from(&segments, &start, &first.parameters);
    let report = search.report(&segments, &fit);
    let parameters = if report.is_nearer() {
        &fit.parameters
    } else {
        &start
    };
    let fitted = search.vehicle_with(parameters).validated();
    Ok((fitted.map_err(range)?, report))
}

/// The parameters that are searched, c_l and c_r first, and where from.
struct ContactSearch<'a> {
    vehicle: &'a Vehicle,
    contact: ContactVehicle,
    ranges: ContactPrediction,
    free: Vec<Parameter>,
    names: Vec<&'static str>,
    start: Vec<f64>,
    sigma: Vec<f64>,
    pull_m: Vec<f64>,
}

impl<'a> ContactSearch<'a> {
    fn new(vehicle: &'a Vehicle) -> Result<Self, RangeError> {
        let contact = vehicle.contact_vehicle();
        let ranges = ContactPrediction::new(&contact)?;
        let free: Vec<Parameter> = Parameter::ALL
            .into_iter()
            .filter(|p| contact.has_inner_axles() || !p.is_of_inner_axles())
            .filter(|p| p.is_identified())
            .collect();
        let scale = vehicle.on_wheels().encoder_scale;
        let known = ranges.parameters();
        let start = [scale.left, scale.right]
            .into_iter()
            .chain(free.iter().map(|p| known[p.index()]));
        let names = ["correction_left", "correction_right"]
            .into_iter()
            .chain(free.iter().map(|p| p.key()));
        let (half_width_m, half_length_m) = (contact.half_width_m, contact.half_length_m());
        let sigma: Vec<f64> = [SCALE_SIGMA; 2]
            .into_iter()
            .chain(
                free.iter()
                    .map(|p| p.guess_sigma(half_width_m, half_length_m)),
            )
            .collect();
        Ok(Self {
            vehicle,
            names: names.collect(),
            start: start.collect(),
            pull_m: sigma.iter().map(|sigma| PRIOR_RESIDUAL_M / sigma).collect(),
            sigma,
            ranges,
            free,
            contact,
        })
    }

    fn vehicle_with(&self, parameters: &[f64]) -> Vehicle {
        let mut vehicle = self.vehicle.clone();
        let [left, right, rest @ ..] = parameters else {
            return vehicle;
        };
        let mut entries: ParameterVector = *self.ranges.parameters();
        for (parameter, entry) in self.free.iter().zip(rest) {
            entries[parameter.index()] = *entry;
        }
        vehicle.contact_encoder_scale = Some(EncoderScale {
            left: *left,
            right: *right,
        });
        let entries = self.ranges.within_ranges(&entries);
        vehicle.contact = Some(self.contact.with_parameters(&entries));
        vehicle
    }

    /// Returns the segments' clusters and one more for each parameter: the prior, which weighs as the pull
    /// does and scatters by its own standard deviation.
    fn clusters_with_prior(&self, clusters: &[Cluster]) -> Vec<Cluster> {
        let size = self.start.len();
        let prior = self.pull_m.iter().enumerate().map(|(i, strength)| Cluster {
            jacobian: DMatrix::from_fn(1, size, |_, j| if i == j { *strength } else { 0.0 }),
            residuals: DVector::from_element(1, strength * self.sigma[i]),
        });
        clusters.iter().cloned().chain(prior).collect()
    }

    fn report(&self, segments: &[Segment], fit: &Fit) -> ContactReport {
        let clusters = fit.clusters(segments);
        let spread = covariance(&self.clusters_with_prior(&clusters));
        let factor = confidence_factor(segments.len() - self.names.len());
        let size = self.start.len();
        let std = |i: usize| {
            spread
                .as_ref()
                .map_or(f64::INFINITY, |c| c[(i, i)].sqrt())
                .min(self.sigma[i])
        };
        let found = self.vehicle_with(&fit.parameters);
        let entries = found
            .contact
            .as_ref()
            .map_or(*self.ranges.parameters(), ContactVehicle::parameters);
        let estimates = (0..size).map(|i| {
            let half = factor * std(i);
            let (entry, parameter) = match i.checked_sub(2) {
                Some(place) => (entries[self.free[place].index()], Some(self.free[place])),
                None => (fit.parameters[i], None),
            };
            let contact = &self.contact;
            let value = |entry: f64| {
                parameter.map_or(entry, |p| {
                    let (low, high) = p.range(contact.half_width_m, contact.half_length_m());
                    p.value(entry).clamp(low, high)
                })
            };
            ContactParameterEstimate {
                name: self.names[i],
                value: value(entry),
                interval: (value(entry - half), value(entry + half)),
                determined: std(i) < DETERMINED * self.sigma[i],
            }
        });
        let mut not_told_apart = Vec::new();
        if let Some(spread) = &spread {
            for i in 0..size {
                for j in 0..i {
                    let correlation = spread[(i, j)] / (spread[(i, i)] * spread[(j, j)]).sqrt();
                    if correlation.abs() > CORRELATION_MAX {
                        not_told_apart.push((self.names[j], self.names[i], correlation));
                    }
                }
            }
        }
        let guess = self.vehicle_with(&self.start);
        let (held_out, folds_nearer) = self.held_out(segments, fit, &clusters);
        ContactReport {
            estimates: estimates.collect(),
            not_told_apart,
            segments: segments.len(),
            guess: SegmentErrors::of(segments, &guess, KinematicModel::Contact),
            held_out,
            folds: FOLDS,
            folds_nearer,
            settled: fit.settled,
        }
    }

    /// Returns the errors on each fold with the parameters that follow, by one Gauss-Newton step, from the
    /// other folds alone, and in how many folds they are below the guess's.
    fn held_out(
        &self,
        segments: &[Segment],
        fit: &Fit,
        clusters: &[Cluster],
    ) -> (SegmentErrors, usize) {
        let guess = self.vehicle_with(&self.start);
        let position_m = |errors: &SegmentErrors| errors.lateral_m.hypot(errors.longitudinal_m);
        let mut nearer = 0;
        let size = self.start.len();
        let mut normal = DMatrix::from_fn(size, size, |i, j| {
            if i == j { self.pull_m[i].powi(2) } else { 0.0 }
        });
        for cluster in clusters {
            normal += cluster.jacobian.tr_mul(&cluster.jacobian);
        }
        let folds = (0..FOLDS).map(|fold| {
            let held_out: Vec<usize> = (0..segments.len())
                .filter(|segment| segment / RUN % FOLDS == fold)
                .collect();
            let left_out = held_out.iter().map(|index| &clusters[*index]);
            let parameters = parameters_without(&fit.parameters, &normal, left_out);
            let out: Vec<Segment> = held_out.iter().map(|index| segments[*index]).collect();
            let errors =
                |vehicle: &Vehicle| SegmentErrors::of(&out, vehicle, KinematicModel::Contact);
            let fitted = errors(&self.vehicle_with(&parameters));
            nearer += usize::from(position_m(&fitted) < position_m(&errors(&guess)));
            fitted
        });
        let pooled = SegmentErrors::pooled(folds);
        (pooled, nearer)
    }
}
