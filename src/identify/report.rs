//! Results of identification as text and JSON.

use super::found::Undetermined;
use serde_json::{Map, Value, json};
use sidehill_plant::bounds::RangeError;
use sidehill_plant::identification::{
    ContactReport, ExtensionReport, FittedParameter, SegmentErrors, StageReport, Verdict,
};
use std::fmt::Write;

fn value(estimate: &FittedParameter) -> String {
    let interval = estimate.half_width.map_or_else(
        || "(any value)".to_owned(),
        |half_width| format!("+- {half_width:.4} (95 %)"),
    );
    format!("{:>9.4} {interval}", estimate.value)
}

/// Returns the result of a stage as text.
pub(super) fn stage_table(
    stage: &str,
    baseline: &str,
    report: &StageReport,
    undetermined: &[Undetermined],
) -> String {
    let mut out = String::new();
    let _ = writeln!(
        out,
        "{stage}: {} segments, {} poses, J/N {:.3e}, {:.1} % of the poses far off",
        report.segments,
        report.poses,
        report.fitness,
        100.0 * report.outlier_share
    );
    for estimate in &report.estimates {
        let _ = writeln!(out, "  {:20} {}", estimate.name, value(estimate));
    }
    for Undetermined { estimate, kept } in undetermined {
        let _ = writeln!(
            out,
            "  {:20} {}: not determined by these logs, stays at {kept} of the --vehicle file",
            estimate.name,
            value(estimate)
        );
    }
    let held_out = |name: &str, errors: &SegmentErrors| {
        format!(
            "  held-out segments, {name}: lateral {:.3} m, longitudinal {:.3} m, yaw {:.3} rad RMS\n",
            errors.lateral_m, errors.longitudinal_m, errors.yaw_rad
        )
    };
    out += &held_out("fitted", &report.cross_validation.fitted);
    out += &held_out(baseline, &report.cross_validation.baseline);
    for warning in &report.warnings {
        let _ = writeln!(out, "  warning: {warning}");
    }
    out
}

/// Returns the terms beyond ICRIK that the logs support, as text.
pub(super) fn extension_table(report: &ExtensionReport) -> String {
    let mut out = format!("extension: {} segments\n", report.segments);
    for term in &report.terms {
        let verdict = match term.verdict {
            Verdict::Supported { value, half_width } => {
                let interval =
                    half_width.map_or_else(String::new, |width| format!(" +- {width:.4} (95 %)"));
                format!("{value:>9.4}{interval}, supported")
            }
            Verdict::NotToldApart { instead } => {
                format!(
                    "indistinguishable from {}, which explains more",
                    instead.key()
                )
            }
            Verdict::Negative { value } => format!("not supported: it would be {value:.4}"),
            Verdict::OutOfRange { reason } => format!("not used: {reason}"),
            Verdict::NotSupported => "not supported".to_owned(),
        };
        let _ = writeln!(
            out,
            "  {:20} {verdict}; held-out misfit {:+.1} +- {:.1} %",
            term.term.key(),
            -100.0 * term.improvement,
            100.0 * term.improvement_half_width,
        );
    }
    let mut held_out = |name: &str, errors: &SegmentErrors| {
        let _ = writeln!(
            out,
            "  held-out segments, {name}: position {:.3} m, yaw {:.3} rad RMS",
            errors.lateral_m.hypot(errors.longitudinal_m),
            errors.yaw_rad
        );
    };
    held_out("ICRHK", &report.icrhk);
    if let Some(icrik) = &report.icrik {
        held_out("ICRIK", icrik);
    }
    held_out("extended", &report.extended);
    out
}

/// Returns the terms beyond ICRIK as JSON; `not_used` is why the vehicle was left without them.
pub(super) fn extension_json(report: &ExtensionReport, not_used: Option<&RangeError>) -> Value {
    let terms: Map<_, _> = report
        .terms
        .iter()
        .map(|term| {
            let mut found = match term.verdict {
                Verdict::Supported { value, half_width } => {
                    json!({ "verdict": "supported", "value": value, "half_width_95": half_width })
                }
                Verdict::NotToldApart { instead } => {
                    json!({ "verdict": "not_told_apart", "instead": instead.key() })
                }
                Verdict::Negative { value } => json!({ "verdict": "negative", "value": value }),
                Verdict::OutOfRange { reason } => {
                    json!({ "verdict": "out_of_range", "reason": reason.to_string() })
                }
                Verdict::NotSupported => json!({ "verdict": "not_supported" }),
            };
            found["improvement"] = json!(term.improvement);
            found["improvement_half_width_95"] = json!(term.improvement_half_width);
            (term.term.key().to_owned(), found)
        })
        .collect();
    json!({
        "terms": terms,
        "segments": report.segments,
        "held_out": {
            "icrhk": errors_json(&report.icrhk),
            "icrik": report.icrik.as_ref().map(errors_json),
            "extended": errors_json(&report.extended),
        },
        "not_used": not_used.map(ToString::to_string),
    })
}

/// Returns the identified physical parameters as text.
pub(super) fn contact_table(report: &ContactReport) -> String {
    let mut out = format!("contact vehicle: {} segments\n", report.segments);
    for estimate in &report.estimates {
        let (low, high) = estimate.interval;
        let source = if estimate.determined {
            ""
        } else {
            ", hardly determined by these logs: the guess counts as well"
        };
        let _ = writeln!(
            out,
            "  {:26} {:>9.4}, {low:.4} to {high:.4} (95 %){source}",
            estimate.name, estimate.value
        );
    }
    for (one, other, correlation) in &report.not_told_apart {
        let _ = writeln!(
            out,
            "  warning: the logs cannot tell apart {one} and {other} (correlation {correlation:.2})"
        );
    }
    for (name, errors) in [
        ("all segments, geometry and encoders alone", &report.guess),
        ("held-out segments, fitted", &report.held_out),
    ] {
        let _ = writeln!(
            out,
            "  {name}: position {:.3} m, yaw {:.3} rad RMS",
            errors.lateral_m.hypot(errors.longitudinal_m),
            errors.yaw_rad
        );
    }
    if !report.settled {
        out += "  warning: the search for the parameters did not settle\n";
    }
    let _ = writeln!(out, "  {}", contact_finding(report));
    out
}

/// Returns what the held-out segments say of the identified physical parameters.
pub(super) fn contact_finding(report: &ContactReport) -> String {
    let figures = format!(
        "nearer to the poses in {} of {} folds",
        report.folds_nearer, report.folds
    );
    if report.is_nearer() {
        format!(
            "held-out segments are predicted better than by geometry alone ({figures}); whether contact-mpc drives \
             better with it, only a drive or a simulation tells"
        )
    } else {
        format!(
            "held-out segments are not predicted better than by geometry alone ({figures}): the fit is not written, and \
             section `contact` has the geometry alone"
        )
    }
}

/// Returns the identified physical parameters as JSON.
pub(super) fn contact_json(report: &ContactReport) -> Value {
    let estimates: Map<_, _> = report
        .estimates
        .iter()
        .map(|estimate| {
            let value = json!({
                "value": estimate.value,
                "interval_95": estimate.interval,
                "determined": estimate.determined,
            });
            (estimate.name.to_owned(), value)
        })
        .collect();
    let not_told_apart: Vec<_> = report
        .not_told_apart
        .iter()
        .map(|(one, other, correlation)| {
            json!({ "parameters": [one, other], "correlation": correlation })
        })
        .collect();
    json!({
        "estimates": estimates,
        "not_told_apart": not_told_apart,
        "segments": report.segments,
        "settled": report.settled,
        "nearer_than_geometry_alone": report.is_nearer(),
    })
}

/// Returns the full result of a stage as JSON.
pub(super) fn stage_json(report: &StageReport, undetermined: &[Undetermined]) -> Value {
    let undetermined: Map<_, _> = undetermined
        .iter()
        .map(|undetermined| {
            let mut value = estimate_json(&undetermined.estimate);
            value["kept"] = json!(undetermined.kept);
            (undetermined.estimate.name.to_owned(), value)
        })
        .collect();
    let mut fields = stage_fields(report);
    fields.insert("undetermined".to_owned(), Value::Object(undetermined));
    Value::Object(fields)
}

/// Returns what a stage found and how far to trust it, as the fields of JSON that are the same wherever it is
/// reported: `estimates` (by key: `value`, `std`, `half_width_95` in the key's unit), `segments`, `poses`,
/// `j_over_n` (13), `outlier_share`, `held_out` (RMS errors of segments left out, m and rad), `warnings`.
fn stage_fields(report: &StageReport) -> Map<String, Value> {
    let found = report.estimates.iter();
    let estimates = found.map(|found| (found.name.to_owned(), estimate_json(found)));
    let warnings = report.warnings.iter().map(ToString::to_string);
    let fields = [
        ("estimates", Value::Object(estimates.collect())),
        ("segments", json!(report.segments)),
        ("poses", json!(report.poses)),
        ("j_over_n", json!(report.fitness)),
        ("outlier_share", json!(report.outlier_share)),
        (
            "held_out",
            json!({
                "fitted": errors_json(&report.cross_validation.fitted),
                "baseline": errors_json(&report.cross_validation.baseline),
            }),
        ),
        ("warnings", warnings.collect()),
    ];
    let fields = fields.map(|(key, value)| (key.to_owned(), value));
    fields.into_iter().collect()
}

fn estimate_json(estimate: &FittedParameter) -> Value {
    json!({
        "value": estimate.value,
        "std": estimate.std,
        "half_width_95": estimate.half_width,
    })
}

fn errors_json(errors: &SegmentErrors) -> Value {
    json!({
        "segments": errors.segments,
        "lateral_m": errors.lateral_m,
        "longitudinal_m": errors.longitudinal_m,
        "yaw_rad": errors.yaw_rad,
    })
}
