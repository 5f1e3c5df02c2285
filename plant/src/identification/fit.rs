//! The fit that both stages share: what is fitted, how it is judged, and what is reported.

use super::least_squares::{jacobian_columns, minimise};
use super::problem::{PER_POSE, Problem, Pull, pose_count};
use super::segments::{Segment, SegmentErrors, Segmentation, segments};
use super::statistics::{Cluster, confidence_factor, covariance, weak_direction};
use crate::bounds::RangeError;
use crate::log::DriveLog;
use crate::odometry::KinematicModel;
use crate::statistics::median;
use crate::vehicle::Vehicle;
use nalgebra::{DMatrix, DVector};

/// How parameters are identified.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct IdentificationSettings {
    /// How logs are cut into segments.
    pub segmentation: Segmentation,
    /// Standard deviation of the Gaussian that smooths roll and pitch, s; 0 for none.
    pub attitude_smoothing_s: f64,
}

/// A fitted parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedParameter {
    /// Key in the vehicle's YAML.
    pub name: &'static str,
    /// Value, in the key's unit.
    pub value: f64,
    /// Standard deviation; none where the data do not determine it.
    pub std: Option<f64>,
    /// Half width of the 95 % confidence interval; none as above.
    pub half_width: Option<f64>,
}

/// Errors on segments that were left out of the fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrossValidation {
    /// Of the stage's model, fitted without them.
    pub fitted: SegmentErrors,
    /// Of the model without the stage's parameters: ideal differential drive on level ground, ICRHK
    /// on a slope.
    pub baseline: SegmentErrors,
}

/// Something a user should know before trusting the result.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum Warning {
    /// A combination of parameters has hardly an effect in these logs.
    #[error(
        "the logs cannot tell apart {} (strength {strength:.1e} of the best known combination): drive more varied",
        names.join(", ")
    )]
    NotToldApart {
        /// Keys of the parameters.
        names: Vec<&'static str>,
        /// How little, from 0 to 1.
        strength: f64,
    },
    /// A slide gain came out negative and was set to 0.
    #[error("{name} would be {value}, against the model's slide downhill; set to 0")]
    NegativeSlide {
        /// Key of the parameter.
        name: &'static str,
        /// What the fit gave.
        value: f64,
    },
    /// The solver stopped early.
    #[error("the search for the parameters did not settle")]
    NotSettled,
}

/// What a stage did and how far to trust it.
#[derive(Debug, Clone, PartialEq)]
pub struct StageReport {
    /// The fitted parameters.
    pub estimates: Vec<FittedParameter>,
    /// Segments used.
    pub segments: usize,
    /// Poses compared.
    pub poses: usize,
    /// Mean fitness J/N of (13) with estimated start poses, squares of m and rad added.
    pub fitness: f64,
    /// Share of poses with less than half their weight: far off.
    pub outlier_share: f64,
    /// Judgement on segments left out.
    pub cross_validation: CrossValidation,
    /// What to know before trusting it.
    pub warnings: Vec<Warning>,
}

/// Why identification failed.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum IdentificationError {
    /// The logs hold too little motion with poses.
    #[error(
        "{found} segments with motion and poses, at least {needed} are needed: log longer, or cut shorter segments"
    )]
    TooFewSegments {
        /// Segments found.
        found: usize,
        /// Segments needed.
        needed: usize,
    },
    /// The fitted parameters are outside what a vehicle may have.
    #[error("the fit is not a vehicle: {reason}{}", warnings.iter().map(|w| format!("; {w}")).collect::<String>())]
    NotAVehicle {
        /// Key, value and range.
        reason: RangeError,
        /// What may have led there.
        warnings: Vec<Warning>,
    },
}

pub(super) fn smoothed(logs: &[DriveLog], settings: &IdentificationSettings) -> Vec<DriveLog> {
    logs.iter()
        .map(|log| log.with_smooth_attitude(settings.attitude_smoothing_s))
        .collect()
}

pub(super) fn cut<'a>(logs: &'a [DriveLog], settings: &IdentificationSettings) -> Vec<Segment<'a>> {
    logs.iter()
        .flat_map(|log| segments(log, &settings.segmentation))
        .collect()
}

/// Pull of correction factors and ICRs back to the start, m for each unit.
pub(super) const PULL_ICRS_M: f64 = 0.1;
/// The same of slide gains, m for each s/rad.
pub(super) const PULL_SLIDE_M: f64 = 0.002;

/// Which parameters are fitted with which model.
pub(super) struct FitStage<'a> {
    pub(super) names: &'a [&'static str],
    pub(super) model: KinematicModel,
    pub(super) baseline: KinematicModel,
    pub(super) vehicle_with: &'a (dyn Fn(&[f64]) -> Vehicle + Sync),
    /// Pull back to the start for each unit of each parameter, m.
    pub(super) pull_m: &'a [f64],
}

/// Every fifth segment is left out in turn for cross-validation.
const FOLDS: usize = 5;
/// Below this share of the best known combination's effect, parameters are not distinguished.
const STRENGTH_MIN: f64 = 0.03;

impl FitStage<'_> {
    pub(super) fn run(
        &self,
        segments: &[Segment],
        start: &[f64],
    ) -> Result<(Vec<f64>, StageReport), IdentificationError> {
        let needed = self.names.len() + FOLDS;
        if segments.len() < needed {
            return Err(IdentificationError::TooFewSegments {
                found: segments.len(),
                needed,
            });
        }
        let fit = self.fit(segments, start);
        let clusters = fit.clusters(segments);
        let mut warnings = Vec::new();
        if !fit.settled {
            warnings.push(Warning::NotSettled);
        }
        if let Some(weak) = weak_direction(&clusters, STRENGTH_MIN) {
            warnings.push(Warning::NotToldApart {
                names: weak.parameters.iter().map(|i| self.names[*i]).collect(),
                strength: weak.strength,
            });
        }
        let covariance = covariance(&clusters);
        let factor = confidence_factor(segments.len() - self.names.len());
        let estimates = self.names.iter().zip(&fit.parameters).enumerate();
        let estimates = estimates.map(|(index, (name, value))| {
            let std = covariance.as_ref().map(|c| c[(index, index)].sqrt());
            FittedParameter {
                name,
                value: *value,
                std,
                half_width: std.map(|std| factor * std),
            }
        });
        let poses = fit.residuals.len();
        let squares: f64 = fit.residuals.iter().flatten().map(|r| r * r).sum();
        let outliers = fit.weights.iter().filter(|weight| **weight < 0.5).count();
        let report = StageReport {
            estimates: estimates.collect(),
            segments: segments.len(),
            poses,
            fitness: squares / poses as f64,
            outlier_share: outliers as f64 / poses as f64,
            cross_validation: self.cross_validate(segments, start),
            warnings,
        };
        Ok((fit.parameters, report))
    }

    /// Fits with Cauchy's loss: weights 1 / (1 + (|r| / 3 median|r|)^2) of the residuals before, until
    /// the parameters stay.
    pub(super) fn fit(&self, segments: &[Segment], start: &[f64]) -> Fit {
        self.fit_from(segments, start, start)
    }

    /// The same with a search that begins elsewhere than where the parameters are pulled to.
    pub(super) fn fit_from(&self, segments: &[Segment], start: &[f64], begin: &[f64]) -> Fit {
        let mut problem = Problem::new(
            segments,
            self.model,
            self.vehicle_with,
            Pull {
                start,
                strengths_m: self.pull_m,
            },
        );
        let mut parameters = begin.to_vec();
        let mut settled = false;
        for _ in 0..ROUNDS {
            let (found, ended) = minimise(&problem, &parameters);
            let moved = found
                .iter()
                .zip(&parameters)
                .map(|(new, old)| (new - old).abs() / old.abs().max(0.1))
                .fold(0.0, f64::max);
            parameters = found;
            settled = ended && moved < 1e-4;
            if settled {
                break;
            }
            let sizes: Vec<f64> = problem
                .unweighted(&parameters)
                .iter()
                .map(|r| r.iter().map(|r| r * r).sum::<f64>().sqrt())
                .collect();
            let scale = 3.0 * median(sizes.clone()).unwrap_or(0.0).max(1e-9);
            problem.weights = sizes
                .iter()
                .map(|size| 1.0 / (1.0 + (size / scale).powi(2)))
                .collect();
        }
        Fit {
            jacobian: jacobian_columns(&problem, &parameters),
            residuals: problem.unweighted(&parameters),
            weights: problem.weights,
            parameters,
            settled,
        }
    }

    fn cross_validate(&self, segments: &[Segment], start: &[f64]) -> CrossValidation {
        let fold = |fold: usize| {
            let (out, used): (Vec<_>, Vec<_>) =
                (0..segments.len()).partition(|index| index % FOLDS == fold);
            let pick = |indices: Vec<usize>| -> Vec<Segment> {
                indices.into_iter().map(|index| segments[index]).collect()
            };
            let (used, out) = (pick(used), pick(out));
            let vehicle = (self.vehicle_with)(&self.fit(&used, start).parameters);
            CrossValidation {
                fitted: SegmentErrors::of(&out, &vehicle, self.model),
                baseline: SegmentErrors::of(&out, &vehicle, self.baseline),
            }
        };
        let folds: Vec<CrossValidation> = (0..FOLDS).map(fold).collect();
        CrossValidation {
            fitted: SegmentErrors::pooled(folds.iter().map(|f| f.fitted)),
            baseline: SegmentErrors::pooled(folds.iter().map(|f| f.baseline)),
        }
    }
}

/// Reweightings at most; a few are enough where outliers are few.
const ROUNDS: usize = 20;

pub(super) struct Fit {
    pub(super) parameters: Vec<f64>,
    /// Weighted residuals' derivatives, a column for each parameter.
    jacobian: Vec<Vec<f64>>,
    residuals: Vec<[f64; PER_POSE]>,
    weights: Vec<f64>,
    pub(super) settled: bool,
}

impl Fit {
    pub(super) fn clusters(&self, segments: &[Segment]) -> Vec<Cluster> {
        let mut first = 0;
        segments
            .iter()
            .map(|segment| {
                let poses = first..first + pose_count(segment);
                first = poses.end;
                let rows = PER_POSE * poses.start;
                let residuals = poses.clone().flat_map(|pose| {
                    let weight = self.weights[pose].sqrt();
                    self.residuals[pose].map(|residual| weight * residual)
                });
                Cluster {
                    jacobian: DMatrix::from_fn(
                        PER_POSE * poses.len(),
                        self.parameters.len(),
                        |row, column| self.jacobian[column][rows + row],
                    ),
                    residuals: DVector::from_iterator(PER_POSE * poses.len(), residuals),
                }
            })
            .collect()
    }
}
