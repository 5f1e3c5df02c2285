//! The page of an identification: its results, how far to trust them, and the logs.

use super::found::{Found, Stage};
use super::report::{contact_table, extension_table};
use crate::report::page::{COLOURS, Page, legend_of, table};
use crate::report::plot::{Line, Plot};
use maud::{Markup, html};
use sidehill_plant::log::{DriveLog, LogRow};

/// Returns the page.
pub(super) fn html(
    vehicle: &str,
    found: &Found,
    conclusions: &[String],
    logs: &[(&str, &DriveLog)],
) -> String {
    let page = Page {
        title: "Identification",
        subtitle: &format!("Vehicle {vehicle}"),
        conclusions,
        body: html! {
            @if let Some(level) = &found.level { (parameters("level", "differential drive", level)) }
            @if let Some(slope) = &found.slope { (parameters("slope", "ICRHK", slope)) }
            @if let Some(extension) = &found.extension {
                h2 { "Terms beyond ICRIK" }
                pre { (extension_table(extension)) }
            }
            @if let Some(contact) = &found.contact {
                h2 { "Contact vehicle" }
                pre { (contact_table(contact)) }
            }
            @for (index, (stage, log)) in logs.iter().enumerate() { (log_section(index + 1, stage, log)) }
        },
        style: "",
    };
    page.html()
}

fn parameters(stage: &str, baseline: &str, results: &Stage) -> Markup {
    let report = &results.report;
    let rows: Vec<Vec<String>> = report
        .estimates
        .iter()
        .map(|estimate| {
            let interval = estimate.half_width.map_or_else(
                || "not determined".to_owned(),
                |width| format!("{width:.4}"),
            );
            vec![
                estimate.name.to_owned(),
                format!("{:.4}", estimate.value),
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
        row.extend(values.map(|value| format!("{value:.3}")));
        row
    })
    .collect();
    html! {
        h2 { "Parameters from " (stage) " ground" }
        p { (report.segments) " segments, " (report.poses) " poses" }
        (table(&format!("{stage}-parameters"), &["parameter", "value", "95 % interval, +-"], &rows))
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
        let points: Vec<[f64; 2]> = log
            .rows()
            .iter()
            .map(|row| [row.time_s, value(row)])
            .collect();
        Line::through(name, colour, None, &points)
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
    html! {
        h2 { "Log " (number) ", " (stage) " ground" }
        figure {
            figcaption { "What the treads did and how the vehicle stood; " (log.pose_count()) " rows have a pose." }
            (legend_of(&[("left, roll", COLOURS[0]), ("right, pitch", COLOURS[1])]))
            @for plot in &plots { (plot.markup(&format!("log{number}"))) }
        }
    }
}
