//! The page of an identification: its results, how far to trust them, and the logs.

use super::found::{Found, StageResult};
use super::report::{contact_table, extension_table};
use crate::report::figures::{decimals, fixed, two_digits};
use crate::report::page::{COLOURS, ReportPage, legend_of, section, table};
use crate::report::plot::{Line, Plot};
use maud::{Markup, html};
use sidehill_plant::log::{DriveLog, LogRow};

/// Returns the page.
pub(super) fn html(
    vehicle: &str,
    found: &Found,
    verdict: &str,
    logs: &[(&str, &DriveLog)],
) -> String {
    let conclusions: Vec<String> = verdict.lines().map(for_page).collect();
    let page = ReportPage {
        title: "Identification",
        subtitle: &format!("Vehicle {vehicle}"),
        conclusions: &conclusions,
        summary: html! {
            @if let Some(level) = &found.level { (parameters("level", "differential drive", level)) }
            @if let Some(slope) = &found.slope { (parameters("slope", "ICRHK", slope)) }
            @if let Some(extension) = &found.extension {
                h2 { "Terms beyond ICRIK" }
                pre tabindex="0" { (for_page(&extension_table(extension))) }
            }
            @if let Some(contact) = &found.contact {
                h2 { "Contact vehicle" }
                pre tabindex="0" { (for_page(&contact_table(contact))) }
            }
        },
        legend: html! {},
        body: html! {
            @for (index, (stage, log)) in logs.iter().enumerate() { (log_section(index + 1, stage, log)) }
        },
        map: None,
    };
    page.html()
}

/// Returns what the program prints as a page says it.
fn for_page(text: &str) -> String {
    text.replace("+-", "\u{b1}")
        .replace("  - ", "\u{2022} ")
        .replace("verdict:", "Verdict:")
}

fn parameters(stage: &str, baseline: &str, results: &StageResult) -> Markup {
    let report = &results.report;
    let rows: Vec<Vec<String>> = report
        .estimates
        .iter()
        .map(|estimate| {
            // The interval tells how many decimals mean something.
            let (shown, interval) = match estimate.half_width {
                Some(width) => (decimals(width), two_digits(width)),
                None => (decimals(estimate.value), "not determined".to_owned()),
            };
            vec![
                estimate.name.to_owned(),
                fixed(estimate.value, shown),
                interval,
            ]
        })
        .collect();
    let validation = &report.cross_validation;
    let errors: Vec<Vec<String>> = [
        ("fitted", &validation.fitted),
        (baseline, &validation.baseline),
    ]
    .into_iter()
    .map(|(name, errors)| {
        let mut row = vec![name.to_owned()];
        let values = [errors.lateral_m, errors.longitudinal_m, errors.yaw_rad];
        row.extend(values.map(two_digits));
        row
    })
    .collect();
    html! {
        h2 { "Parameters from " (stage) " ground" }
        p { (report.segments) " segments, " (report.poses) " poses" }
        (table(&format!("{stage}-parameters"), &["parameter", "value", "95 % interval, \u{b1}"], &rows))
        h2 { "Errors on segments that were left out" }
        (table(&format!("{stage}-errors"), &["RMS", "lateral (m)", "longitudinal (m)", "yaw (rad)"], &errors))
        @for undetermined in &results.undetermined {
            p { (undetermined.estimate.name) " is not determined by these logs: it stays at " (undetermined.kept) " of the --vehicle file" }
        }
        @for warning in &report.warnings { p { "Warning: " (warning) } }
    }
}

fn log_section(number: usize, stage: &str, log: &DriveLog) -> Markup {
    let line = |name: &str, colour: &str, value: &dyn Fn(&LogRow) -> f64| {
        let rows = log.rows().iter();
        Line::with_gaps(name, colour, rows.map(|row| [row.time_s, value(row)]))
    };
    let plots = [
        Plot::over_time(
            "tread speed (m/s)",
            160.0,
            vec![
                line("left", COLOURS[0], &|row| row.speeds.left_m_s),
                line("right", COLOURS[1], &|row| row.speeds.right_m_s),
            ],
        ),
        Plot::over_time(
            "attitude (\u{b0})",
            160.0,
            vec![
                line("roll", COLOURS[0], &|row| {
                    row.attitude.roll_rad.to_degrees()
                }),
                line("pitch", COLOURS[1], &|row| {
                    row.attitude.pitch_rad.to_degrees()
                }),
            ],
        ),
    ];
    section(
        &format!("Log {number}, {stage} ground"),
        &format!(
            "What the treads did and how the vehicle stood; {} rows have a pose.",
            log.pose_count()
        ),
        &legend_of(&[("left, roll", COLOURS[0]), ("right, pitch", COLOURS[1])]),
        &format!("log{number}"),
        &plots,
    )
}

#[cfg(test)]
mod tests {
    use super::super::logs::Logs;
    use super::super::verdict::SlopeVerdict;
    use super::*;
    use sidehill_plant::identification::{
        ContactParameterEstimate, ContactReport, CrossValidation, ExtensionReport, SegmentErrors,
        StageReport, Term, TermReport, Verdict as TermVerdict, Warning,
    };
    use sidehill_plant::vehicle::Vehicle;

    fn errors(lateral_m: f64) -> SegmentErrors {
        SegmentErrors {
            segments: 20,
            lateral_m,
            longitudinal_m: 0.01,
            yaw_rad: 0.01,
        }
    }

    fn stage(warnings: Vec<Warning>) -> StageResult {
        let report = StageReport {
            estimates: Vec::new(),
            segments: 20,
            poses: 400,
            fitness: 1e-3,
            outlier_share: 0.0,
            cross_validation: CrossValidation {
                fitted: errors(0.05),
                baseline: errors(0.5),
            },
            warnings,
        };
        StageResult::new(report, Vec::new(), &Vehicle::j8()).unwrap()
    }

    fn contact(settled: bool, folds_nearer: usize) -> ContactReport {
        ContactReport {
            estimates: vec![ContactParameterEstimate {
                name: "slip_scale_m_s",
                value: 0.146,
                interval: (0.14, 0.15),
                determined: true,
            }],
            not_told_apart: Vec::new(),
            segments: 20,
            guess: errors(0.06),
            held_out: errors(0.05),
            folds: 10,
            folds_nearer,
            settled,
        }
    }

    fn verdict(found: &Found) -> String {
        let logs = Logs {
            level: Vec::new(),
            slope: Vec::new(),
            across: Vec::new(),
        };
        let mut verdict = SlopeVerdict::of(found, &Vehicle::j8(), &logs);
        if let Some(contact) = &found.contact {
            verdict.judge_contact(contact);
        }
        verdict.to_string()
    }

    #[test]
    fn the_page_has_every_stage() {
        let found = Found {
            level: Some(stage(Vec::new())),
            slope: Some(stage(vec![Warning::NotSettled])),
            extension: Some(ExtensionReport {
                segments: 40,
                icrhk: errors(0.3),
                icrik: Some(errors(0.2)),
                extended: errors(0.1),
                terms: vec![TermReport {
                    term: Term::OutwardSlip,
                    improvement: 0.1,
                    improvement_half_width: 0.05,
                    verdict: TermVerdict::NotSupported,
                }],
            }),
            extension_not_used: None,
            contact: Some(contact(true, 9)),
        };
        let page = html("j8", &found, "", &[]);
        for part in [
            "Parameters from level ground",
            "Parameters from slope ground",
            "did not settle",
            "Terms beyond ICRIK",
            "outward_slip_s",
            "Contact vehicle",
            "slip_scale_m_s",
        ] {
            assert!(page.contains(part), "{part}: {page}");
        }
    }

    #[test]
    fn a_search_that_did_not_settle_is_no_good_fit() {
        let settled = Found {
            level: Some(stage(Vec::new())),
            slope: Some(stage(Vec::new())),
            ..Found::default()
        };
        assert!(verdict(&settled).contains("good enough to drive at up to"));
        let unsettled = Found {
            level: Some(stage(vec![Warning::NotSettled])),
            ..settled
        };
        let text = verdict(&unsettled);
        assert!(
            text.contains("not good enough to drive") && text.contains("did not settle"),
            "{text}"
        );
    }

    #[test]
    fn a_contact_vehicle_that_predicts_no_better_is_not_called_better() {
        for (report, nearer) in [
            (contact(true, 9), true),
            (contact(true, 6), false),
            (contact(false, 10), false),
        ] {
            assert_eq!(report.is_nearer(), nearer);
            let text = contact_table(&report);
            assert_eq!(text.contains("not predicted better"), !nearer, "{text}");
            let found = Found {
                level: Some(stage(Vec::new())),
                contact: Some(report),
                ..Found::default()
            };
            assert_eq!(verdict(&found).contains("geometry alone"), !nearer);
        }
    }
}
