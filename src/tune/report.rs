//! The outcome of tuning as text, as a page, and for `simulate --conditions`.

use super::objective::{TrialComparison, TrialFigures};
use super::outcome::TuningOutcome;
use super::subject::SubjectKind;
use crate::report::figures::{significant, two_digits};
use crate::report::page::{COLOURS, ReportPage, legend_of, section, table as html_table};
use crate::report::plot::{Line, Plot};
use anyhow::Result;
use maud::html;
use serde_yaml::{Mapping, Value};
use std::fmt::Write;

/// Returns the settings as conditions, with their evidence as a comment.
///
/// # Errors
/// None that can happen; those of the YAML writer.
pub fn yaml(outcome: &TuningOutcome) -> Result<String> {
    let mut keys = Mapping::new();
    keys.insert(
        "name".into(),
        Value::from(format!("{}_tuned", outcome.name)),
    );
    for setting in &outcome.settings {
        let key = format!("controller.{}", setting.key);
        crate::config::put(&mut keys, &key, &Value::from(setting.after));
    }
    let evidence: String = table(outcome)
        .lines()
        .map(|line| format!("# {line}\n"))
        .collect();
    Ok(format!(
        "# Settings of {} found by `sidehill tune`: a file for `simulate --conditions` and for `conditions` of\n\
         # campaigns; or copy `controller` into a scenario, and its content into `settings` of a run.\n#\n\
         {evidence}\n{}",
        outcome.controller,
        serde_yaml::to_string(&keys)?
    ))
}

/// Returns the outcome in a sentence.
fn finding(outcome: &TuningOutcome) -> String {
    let held_out = &outcome.held_out;
    let change = |cost: f64| {
        let percent = 100.0 * (cost.exp() - 1.0);
        format!(
            "{:.1} % {}",
            percent.abs(),
            if percent <= 0.0 { "less" } else { "more" }
        )
    };
    let (low, high) = (
        held_out.cost - 1.96 * held_out.cost_standard_error,
        held_out.cost + 1.96 * held_out.cost_standard_error,
    );
    format!(
        "{}: in {} runs that the search has not seen, the mean cost is {} than with the present settings \
         (95 % interval: {} to {}), and the error is smaller in {:.0} % of them.",
        if outcome.improved {
            "Better"
        } else {
            "Not shown to be better"
        },
        held_out.before.runs,
        change(held_out.cost),
        change(low),
        change(high),
        100.0 * held_out.better,
    )
}

/// What to do with it, in a sentence.
fn advice(outcome: &TuningOutcome) -> String {
    match (outcome.improved, outcome.subject) {
        (false, _) => "Keep the present settings.",
        (true, SubjectKind::Campaign) => {
            "Take the settings found if the campaign has the courses, slopes and errors to come, and look at the steer \
             total variation: if it has grown, search again with a larger --calmness."
        }
        (true, SubjectKind::Recording) => {
            "Take the settings found for this vehicle and its sensors, and judge them by another recording."
        }
    }
    .to_owned()
}

/// What the cost is, in a sentence.
fn objective(outcome: &TuningOutcome) -> String {
    if outcome.subject == SubjectKind::Recording {
        return "Cost of a run, 2 s of the recording from which the poses are \
                withheld: ln(error / error before), with the RMS distance between the withheld poses and the estimates."
            .to_owned();
    }
    format!(
        "Cost of a run: ln(cross-track RMS / RMS before) + {} ln(steer total variation / before), at most \
         ln 10 either way; + ln 10 where it is no longer completed, - ln 10 where it now is.",
        outcome.calmness
    )
}

/// Returns the result as a text table.
pub fn table(outcome: &TuningOutcome) -> String {
    let mut text = format!(
        "{}: {}\n{}\n",
        outcome.name,
        outcome.controller,
        finding(outcome)
    );
    // Writing to a string does not fail.
    let _ = writeln!(text, "{}\n", objective(outcome));
    let _ = writeln!(
        text,
        "{:<28} {:>9} {:>9} {:>9} {:>12} {:>9}",
        "", "completed", "median cm", "p95 cm", "steer m/s", "cost"
    );
    for (name, figures, cost) in rows(outcome) {
        let _ = writeln!(
            text,
            "{name:<28} {:>9} {:>9.2} {:>9.2} {:>12} {cost:>9}",
            format!("{}/{}", figures.completed, figures.runs),
            100.0 * figures.median_m,
            100.0 * figures.p95_m,
            steer(outcome, figures),
        );
    }
    let _ = writeln!(text, "\n{:<42} {:>12} {:>12}", "setting", "before", "after");
    for setting in &outcome.settings {
        let _ = writeln!(
            text,
            "{:<42} {:>12} {:>12}",
            setting.key, setting.before, setting.after
        );
    }
    let _ = writeln!(text, "\n{} choices tried", outcome.tried.len());
    text
}

/// Returns the steer's total variation, which a recorded drive has whatever is tried.
fn steer(outcome: &TuningOutcome, figures: TrialFigures) -> String {
    match outcome.subject {
        SubjectKind::Campaign => format!("{:.2}", figures.steer_total_variation_m_s),
        SubjectKind::Recording => "-".to_owned(),
    }
}

fn rows(outcome: &TuningOutcome) -> Vec<(String, TrialFigures, String)> {
    let both = |name: &str, comparison: &TrialComparison| {
        let runs = format!("{} to {}", comparison.runs.start, comparison.runs.end - 1);
        let cost = format!("{:.3}", comparison.cost);
        [
            (
                format!("{name} {runs}, before"),
                comparison.before,
                String::new(),
            ),
            (format!("{name} {runs}, after"), comparison.after, cost),
        ]
    };
    let training = both("training", &outcome.training);
    training
        .into_iter()
        .chain(both("held out", &outcome.held_out))
        .collect()
}

/// Returns the page.
pub fn html(outcome: &TuningOutcome) -> String {
    let title = format!("Tuning of {} on {}", outcome.controller, outcome.name);
    let centimetres = |comparison: &TrialComparison| -> Vec<[f64; 2]> {
        let pairs = comparison.errors_m.iter();
        pairs
            .map(|pair| pair.map(|error_m| 100.0 * error_m))
            .collect()
    };
    let (training, held_out) = (
        centimetres(&outcome.training),
        centimetres(&outcome.held_out),
    );
    let runs: Vec<Vec<String>> = rows(outcome)
        .into_iter()
        .map(|(name, figures, cost)| {
            vec![
                name,
                format!("{} of {}", figures.completed, figures.runs),
                significant(100.0 * figures.median_m),
                significant(100.0 * figures.p95_m),
                match outcome.subject {
                    SubjectKind::Campaign => significant(figures.steer_total_variation_m_s),
                    SubjectKind::Recording => "-".to_owned(),
                },
                cost,
            ]
        })
        .collect();
    let settings: Vec<Vec<String>> = outcome
        .settings
        .iter()
        .map(|setting| {
            vec![
                setting.key.clone(),
                setting.before.to_string(),
                setting.after.to_string(),
                two_digits(setting.after / setting.before),
            ]
        })
        .collect();
    let summary = html! {
        (html_table("figures", &["runs", "completed", "median RMS (cm)", "p95 RMS (cm)", "steer total variation (m/s)", "mean cost"], &runs))
        h2 { "Settings" }
        (html_table("settings", &["key of controller", "before", "after", "factor"], &settings))
    };
    let body = html! {
        (section(
            "Error of each run",
            "Each dot is a run that is completed before and after, hollow in training and full where it was held out; below \
             the line its error has become smaller.",
            &legend_of(&[("training", COLOURS[4]), ("held out", COLOURS[0]), ("as before", COLOURS[6])]),
            "errors",
            &[scatter_plot(&training, &held_out)],
        ))
        (section(
            "Search",
            "Mean cost of the training runs for each choice tried, in their order, and the least so far. Drag to zoom.",
            &legend_of(&[("choice", COLOURS[5]), ("least so far", COLOURS[1])]),
            "time",
            &[progress_plot(&outcome.tried)],
        ))
    };
    ReportPage {
        title: &title,
        subtitle: &objective(outcome),
        conclusions: &[finding(outcome), advice(outcome)],
        summary,
        legend: html! {},
        body,
        map: None,
    }
    .html()
}

/// Returns the plot of errors after over those before, cm, with the line of those that are as before.
fn scatter_plot(training: &[[f64; 2]], held_out: &[[f64; 2]]) -> Plot {
    // A logarithmic axis has no zero.
    let positive = |points: &[[f64; 2]]| -> Vec<[f64; 2]> {
        let points = points.iter().copied();
        points
            .filter(|point| point.iter().all(|error| *error > 0.0))
            .collect()
    };
    let (training, held_out) = (positive(training), positive(held_out));
    let all = || training.iter().chain(&held_out).flatten().copied();
    let ends = [
        all().fold(f64::INFINITY, f64::min),
        all().fold(f64::NEG_INFINITY, f64::max),
    ];
    let ends: Vec<[f64; 2]> = ends
        .into_iter()
        .filter(|end| end.is_finite())
        .map(|end| [end; 2])
        .collect();
    Plot {
        x_title: "cross-track RMS before (cm)".to_owned(),
        logarithmic: true,
        x_logarithmic: true,
        ..Plot::over_time(
            "after (cm)",
            420.0,
            vec![
                Line::dots("training", COLOURS[4], &training),
                Line::dots("held out", COLOURS[0], &held_out),
                Line::through("as before", COLOURS[6], None, &ends),
            ],
        )
    }
}

/// Returns the plot of the costs in order, with the lowest so far.
fn progress_plot(costs: &[f64]) -> Plot {
    let mut least = f64::INFINITY;
    let (mut tried, mut best) = (Vec::new(), Vec::new());
    for (index, cost) in costs.iter().enumerate() {
        least = least.min(*cost);
        let number = index as f64 + 1.0;
        tried.push([number, *cost]);
        best.push([number, least]);
    }
    Plot {
        x_title: "choice".to_owned(),
        ..Plot::over_time(
            "mean cost",
            220.0,
            vec![
                Line::through("choice", COLOURS[5], None, &tried),
                Line::through("least so far", COLOURS[1], None, &best),
            ],
        )
    }
}
