//! What a person should conclude from an identification.

use sidehill_plant::identification::{Estimate, StageReport};

/// Largest half width of the 95 % interval of a tread ICR, as a share of their distance.
const ICR_SHARE: f64 = 0.05;
/// Encoder factors of wheels whose radius is right.
const FACTORS: [f64; 2] = [0.95, 1.05];
/// Largest held-out lateral error, as a share of the baseline's.
const LATERAL_SHARE: f64 = 0.8;
/// Largest share of poses that are far off.
const OUTLIER_SHARE: f64 = 0.05;

/// Returns whether a stage's result can be relied on: a sentence if it can, else one for each doubt.
pub(super) fn of(stage: &str, baseline: &str, report: &StageReport) -> Vec<String> {
    let find = |name: &str| {
        report
            .estimates
            .iter()
            .find(|estimate| estimate.name == name)
    };
    let mut doubts = Vec::new();
    if let (Some(left), Some(right)) = (find("x_icr_left_m"), find("x_icr_right_m")) {
        let allowed_m = ICR_SHARE * (right.value - left.value);
        let known =
            |estimate: &Estimate| estimate.half_width.is_some_and(|width| width <= allowed_m);
        if !(known(left) && known(right)) {
            doubts.push(format!(
                "the tread ICRs are not known to 5 % of their distance ({allowed_m:.3} m): log more turning, both ways"
            ));
        }
    }
    for name in ["correction_left", "correction_right"] {
        if let Some(factor) = find(name).filter(|e| !(FACTORS[0]..=FACTORS[1]).contains(&e.value)) {
            doubts.push(format!(
                "{name} is {:.3}, not between {} and {}: check the wheel radius, or the wheels slip in turns \
                 (turn_loss_s_per_rad of the extension)",
                factor.value, FACTORS[0], FACTORS[1]
            ));
        }
    }
    if find("lambda_1_s_per_rad").is_some_and(|estimate| !is_determined(estimate)) {
        doubts.push(
            "the interval of lambda_1_s_per_rad holds 0: log more turning, on steeper ground"
                .to_owned(),
        );
    }
    let (fitted, other) = (
        report.cross_validation.fitted.lateral_m,
        report.cross_validation.baseline.lateral_m,
    );
    let explains = fitted <= LATERAL_SHARE * other;
    if !explains {
        doubts.push(format!(
            "on held-out segments its lateral error is {:.2} of that of {baseline}, more than {LATERAL_SHARE}: the \
             parameters explain little",
            fitted / other
        ));
    }
    let poses_agree = report.outlier_share < OUTLIER_SHARE;
    if !poses_agree {
        doubts.push(format!(
            "{:.1} % of the poses are far off, more than 5 %: look at their source",
            100.0 * report.outlier_share
        ));
    }
    if doubts.is_empty() {
        return vec![format!(
            "{stage}: accept. On held-out segments the lateral error is {:.2} of that of {baseline}.",
            fitted / other
        )];
    }
    doubts
        .into_iter()
        .map(|doubt| format!("{stage}: do not rely on it yet: {doubt}."))
        .collect()
}

/// Returns whether the data tell a slide gain from none at all.
pub(super) fn is_determined(estimate: &Estimate) -> bool {
    estimate
        .half_width
        .is_some_and(|half_width| half_width < estimate.value.abs())
}
