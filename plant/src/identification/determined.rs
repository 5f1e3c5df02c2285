//! Which parameters the logs determine; those that they do not keep their start values.

use super::fit::{CrossValidation, FitStage, FittedParameter, IdentificationError, StageReport};
use super::segments::{Segment, SegmentErrors};
use crate::vehicle::Vehicle;

/// What a stage found, in the order of its parameters.
pub(super) struct DeterminedParameters {
    pub(super) parameters: Vec<f64>,
    pub(super) report: StageReport,
    /// Parameters that were held at their start values, as they were estimated before.
    pub(super) undetermined: Vec<FittedParameter>,
}

/// Half width of an interval up to which each parameter counts as determined.
pub(super) type Allowed<'a> = &'a dyn Fn(&[f64]) -> Vec<f64>;

/// Allowed half width of c_l and c_r.
const SCALE: f64 = 0.1;
/// Allowed half width of the ICRs, in half their distance.
const ICR_SHARE: f64 = 0.3;
/// Allowed half width of a slide gain, in its value; with more, its interval holds 0 or nearly so.
const SLIDE_SHARE: f64 = 0.75;
/// Half width below which a slide gain counts as known whatever its value, s/rad: on 15 deg, at 0.5 rad/s and 1 m/s
/// of margin it is 1.3 cm/s of slide.
const SLIDE_S_PER_RAD: f64 = 0.1;

/// Of c_l, c_r, the ICRs of both treads to the right, and their ICR forward.
pub(super) fn allowed_level(parameters: &[f64]) -> Vec<f64> {
    let [_, _, left_m, right_m, _] = *parameters else {
        return vec![0.0; parameters.len()];
    };
    let icr_m = ICR_SHARE * 0.5 * (right_m - left_m).abs();
    vec![SCALE, SCALE, icr_m, icr_m, icr_m]
}

/// Of slide gains.
pub(super) fn allowed_slide(gains: &[f64]) -> Vec<f64> {
    let allowed = |gain: &f64| (SLIDE_SHARE * gain.abs()).max(SLIDE_S_PER_RAD);
    gains.iter().map(allowed).collect()
}

impl FitStage<'_> {
    /// Fits all parameters.
    pub(super) fn run_all(
        &self,
        segments: &[Segment],
        start: &[f64],
    ) -> Result<DeterminedParameters, IdentificationError> {
        let (parameters, report) = self.run(segments, start)?;
        Ok(DeterminedParameters {
            parameters,
            report,
            undetermined: Vec::new(),
        })
    }

    /// Fits as [`FitStage::run`]. While there are parameters with wider intervals than allowed, the one that is
    /// widest goes back to its start value and the others are fitted again: a combination that is known well,
    /// such as the ratio of a factor and an ICR, stays known.
    pub(super) fn run_determined(
        &self,
        segments: &[Segment],
        start: &[f64],
        allowed: Allowed,
    ) -> Result<DeterminedParameters, IdentificationError> {
        let mut free: Vec<usize> = (0..start.len()).collect();
        let mut undetermined: Vec<FittedParameter> = Vec::new();
        let mut warnings = None;
        loop {
            let with = |values: &[f64]| {
                let mut all = start.to_vec();
                for (index, value) in free.iter().zip(values) {
                    all[*index] = *value;
                }
                all
            };
            let vehicle_with = |values: &[f64]| -> Vehicle { (self.vehicle_with)(&with(values)) };
            let names: Vec<&'static str> = free.iter().map(|i| self.names[*i]).collect();
            let pull_m: Vec<f64> = free.iter().map(|i| self.pull_m[*i]).collect();
            let start_free: Vec<f64> = free.iter().map(|i| start[*i]).collect();
            let stage = FitStage {
                names: &names,
                model: self.model,
                baseline: self.baseline,
                vehicle_with: &vehicle_with,
                pull_m: &pull_m,
            };
            let (values, mut report) = stage.run(segments, &start_free)?;
            let parameters = with(&values);
            let warned = warnings.get_or_insert_with(|| report.warnings.clone());
            report.warnings.clone_from(warned);
            let allowed = allowed(&parameters);
            let width = |estimate: &FittedParameter, index: usize| {
                estimate.half_width.unwrap_or(f64::INFINITY) / allowed[index]
            };
            let widest = (0..free.len())
                .map(|i| (i, width(&report.estimates[i], free[i])))
                .max_by(|(_, a), (_, b)| a.total_cmp(b))
                .filter(|(_, width)| *width > 1.0);
            let Some((widest, _)) = widest else {
                return Ok(DeterminedParameters {
                    parameters,
                    report,
                    undetermined,
                });
            };
            undetermined.push(report.estimates[widest]);
            free.remove(widest);
            if free.is_empty() {
                let vehicle = (self.vehicle_with)(start);
                report.estimates.clear();
                report.cross_validation = CrossValidation {
                    fitted: SegmentErrors::of(segments, &vehicle, self.model),
                    baseline: SegmentErrors::of(segments, &vehicle, self.baseline),
                };
                return Ok(DeterminedParameters {
                    parameters: start.to_vec(),
                    report,
                    undetermined,
                });
            }
        }
    }
}
