//! The files of `simulate --out`: a CSV of each run, and an HTML page about all of them.
//!
//! Every report of the program is a single file that works without a network.

mod chart;
mod contours;
pub mod drawing;
mod frame;
mod ground;
mod histogram;
mod map;
pub(crate) mod page;
mod panels;
pub(crate) mod plot;
mod relief;
mod scene;
mod summary;
mod table;
mod tuning;

pub use scene::Scene;
pub use table::write_csv;
pub(crate) use tuning::{Scatter, progress_plot, scatter_chart};

use crate::record::Run;
use chart::Panel;
use maud::{Markup, PreEscaped, html};
use page::{COLOURS, ReportPage};
use panels::{attitude_panels, command_panels, cross_track_panels, icr_panels, margin_panels};
use scene::{Style, swatch};
use sidehill_controller::config::ControllerKind;
use sidehill_controller::estimator::ContactEstimate;
use sidehill_plant::contact::Parameter;

/// Returns the page: summary, map, errors, commands, attitude, ICRs and solve times of all runs.
///
/// Long runs are thinned so that no extreme is lost; a value that is not finite leaves a gap.
pub fn html(scene: &Scene, runs: &[Run]) -> String {
    let styles = styles(runs);
    let page = ReportPage {
        title: &scene.title,
        subtitle: &scene.subtitle,
        conclusions: &[],
        body: html! {
            (summary::summary(runs, &styles))
            (toggles(&styles))
            (sections(scene, runs, &styles))
        },
        style: &switches(runs.len()),
    };
    page.html()
}

fn sections(scene: &Scene, runs: &[Run], styles: &[Style]) -> Markup {
    let chart = |panels: &[Panel], height_px: f64| {
        let plots = panels.iter();
        let mut plots = plots.map(|panel| panel.plot(height_px, runs, styles));
        html! { @for plot in plots.by_ref() { (plot.markup("time")) } }
    };
    let along_path = |panels: &[Panel], height_px: f64| {
        let plots = panels.iter();
        let mut plots = plots.map(|panel| panel.along_path(height_px, runs, styles));
        html! { @for plot in plots.by_ref() { (plot.markup("path")) } }
    };
    let figure = |title: &str, caption: &str, drawing: &Markup, path: bool| {
        html! {
            h2 { (title) }
            figure {
                figcaption { (caption) }
                (legend(styles, path))
                (drawing)
            }
        }
    };
    let errors = cross_track_panels(runs);
    html! {
        (figure(
            "Map",
            "Seen from above: the wide grey band is the path to follow, the coloured lines are where \
             each controller drove, a dot is where it ended, and brown lines join places of the same \
             height.",
            &map::map(scene, runs, styles), true,
        ))
        (figure(
            "Cross-track error",
            &format!(
                "How far the vehicle was from the path, to its left above zero and to its right \
                 below{}; a flat line at zero is perfect.",
                if errors.len() > 1 { ", the same again with the axis magnified" } else { "" },
            ),
            &chart(&errors, 210.0), false,
        ))
        (figure(
            "Commands",
            "What each controller asked of the motors: traction drives forward above zero, steer \
             turns to the left above zero; nothing may pass the dashed limits, and a jagged line is \
             a nervous controller.",
            &chart(&command_panels(scene.limits), 160.0), false,
        ))
        @if let Some(guard) = scene.guard.filter(|_| runs.iter().any(|run| run.rows.iter().any(|row| row.slope.is_some()))) {
            (figure(
                "Margins along the path",
                "What the ground left: a tip-over margin of 1 stands level and one of 0 tips over; the use of \
                 friction is what slope and turn ask for over what the ground gives. The vehicle drives slower \
                 and stops before the dashed limits.",
                &along_path(&margin_panels(guard), 140.0), false,
            ))
        }
        (figure(
            "Attitude",
            "How the slope tilted the vehicle: roll is positive with the right side down, pitch with \
             the nose up; on an even slope one turns into the other as the vehicle turns.",
            &chart(&attitude_panels(), 140.0), false,
        ))
        (figure(
            "Tread ICRs",
            "The points about which the left and right treads turn on the ground, in metres to the \
             right of the body's origin and ahead of it: the slope moves them, the rectangle of the \
             wheels (dashed) limits them, they jump where the turn changes its side, and there are \
             none to show while the vehicle goes straight or stands.",
            &chart(&icr_panels(scene), 130.0), false,
        ))
        @for (run, learned) in runs.iter().filter_map(|run| Some((run, learned_at_end(run)?))) {
            (learned_table(&run.summary.controller, &learned))
        }
        (figure(
            "Solve time",
            &format!(
                "How often the QP solver took how long, on a logarithmic axis: half of the cycles are \
                 left of p50, 99 of 100 left of p99; a command is due every {:.0} ms ({:.0} \u{b5}s).",
                1e3 * scene.period_s, 1e6 * scene.period_s,
            ),
            &histogram::solve_times(runs, styles), false,
        ))
    }
}

fn learned_at_end(run: &Run) -> Option<ContactEstimate> {
    run.rows.iter().rev().find_map(|row| row.contact)
}

/// Returns a table of the contact vehicle's learned parameters at the end of a run.
fn learned_table(controller: &str, learned: &ContactEstimate) -> Markup {
    html! {
        h2 { "Learned by " (controller) }
        table {
            tr { th { "parameter" } th { "value" } th { "95 % interval" } th {} }
            @for parameter in Parameter::ALL {
                @let (value, (low, high)) = learned.interval(parameter);
                tr {
                    td { (parameter.key()) }
                    td { (format!("{value:.4}")) }
                    td { (format!("{low:.4} to {high:.4}")) }
                    td { @if !learned.observed(parameter) { "not excited by this drive: prior" } }
                }
            }
        }
    }
}

/// Returns a style for each run: the colour of its kind of controller if that is still free.
fn styles(runs: &[Run]) -> Vec<Style> {
    let several = |get: fn(&Run) -> &String| runs.windows(2).any(|w| get(&w[0]) != get(&w[1]));
    let plants_differ = several(|run| &run.summary.plant);
    let mut styles: Vec<Style> = Vec::new();
    for run in runs {
        let summary = &run.summary;
        let own = ControllerKind::ALL
            .iter()
            .position(|kind| kind.name() == summary.controller);
        let free = |index: &usize| !styles.iter().any(|style| style.colour == COLOURS[*index]);
        let others = ControllerKind::ALL.len()..COLOURS.len();
        let index = own
            .filter(free)
            .or_else(|| others.chain(0..COLOURS.len()).find(free))
            .unwrap_or(styles.len() % COLOURS.len());
        styles.push(Style {
            name: if plants_differ {
                format!("{} on {}", summary.controller, summary.plant)
            } else {
                summary.controller.clone()
            },
            colour: COLOURS[index],
        });
    }
    styles
}

fn legend(styles: &[Style], path: bool) -> Markup {
    html! {
        div.legend {
            @if path {
                span { span.swatch.path-swatch {} "path to follow" }
            }
            @for (run, style) in styles.iter().enumerate() {
                span.{ "run" (run) } { (swatch(style)) (style.name) }
            }
        }
    }
}

/// Checkboxes that hide and show runs by the style sheet alone.
fn toggles(styles: &[Style]) -> Markup {
    html! {
        @if styles.len() > 1 {
            div.toggles {
                span { "Show in all plots (drag across one to zoom all, double click for everything):" }
                @for (run, style) in styles.iter().enumerate() {
                    label {
                        (PreEscaped(format!("<input type=\"checkbox\" id=\"show{run}\" checked=\"checked\"/> ")))
                        (swatch(style)) (style.name)
                    }
                }
            }
        }
    }
}

fn switches(runs: usize) -> String {
    let switch =
        |run| format!("body:has(#show{run}:not(:checked)) .run{run} {{ display: none; }}\n");
    (0..runs).map(switch).collect()
}

#[cfg(test)]
mod tests;
