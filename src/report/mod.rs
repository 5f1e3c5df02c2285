//! The files of `simulate --out`: a CSV of each run, and an HTML page about all of them.
//!
//! Every report of the program is a single file that works without a network.

mod chart;
pub(crate) mod figures;
pub(crate) mod map;
pub(crate) mod page;
mod panels;
pub(crate) mod plot;
mod scene;
mod summary;
mod table;

pub use scene::Scene;
pub use table::write_csv;

use crate::record::{Row, Run};
use chart::Panel;
use figures::significant;
use map::PageMap;
use maud::{Markup, PreEscaped, html};
use page::{COLOURS, ReportPage, swatch};
use panels::{attitude_panels, command_panels, cross_track_panel, icr_panels, margin_panels};
use plot::{Line, Plot};
use scene::Style;
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
        summary: html! {
            (summary::summary(runs, &styles, scene.perfect_sensors))
            p.hint { "Drag across a plot to zoom all, double click for everything. A click on the map shows its moment in the plots." }
        },
        legend: toggles(&styles),
        body: sections(scene, runs, &styles),
        map: Some(PageMap::of(scene, runs, &styles)),
    };
    page.html()
}

fn sections(scene: &Scene, runs: &[Run], styles: &[Style]) -> Markup {
    let figure = |title: &str, caption: &str, group: &str, plots: Vec<Plot>| {
        page::section(title, caption, &html! {}, group, &plots)
    };
    let over_time = |panels: &[Panel], height_px: f64| -> Vec<Plot> {
        let plots = panels.iter();
        plots
            .map(|panel| panel.plot(height_px, runs, styles))
            .collect()
    };
    let differences = |panels: &[Panel], height_px: f64| -> Vec<Plot> {
        let plots = panels.iter();
        plots
            .filter_map(|panel| panel.difference(height_px, runs))
            .collect()
    };
    let delta = match styles {
        [one, other] => format!(" \u{394} is {} minus {}.", other.name, one.name),
        _ => String::new(),
    };
    let errors = [cross_track_panel()];
    let commands = command_panels(scene.limits);
    // On a logarithmic axis what is below 0.1 mm would take most of the room.
    let distances = |row: &Row| (100.0 * row.cross_track_m.abs()).clamp(0.01, f64::INFINITY);
    let sizes = in_order("distance (cm)", &distances, runs, styles);
    let times = in_order("QP solver (\u{b5}s)", &|row| row.solve_us, runs, styles);
    html! {
        (figure(
            "Cross-track error",
            &format!(
                "How far the vehicle was from the path, to its left above zero and to its right below; a flat line at \
                 zero is perfect.{delta}",
            ),
            "time",
            [over_time(&errors, 230.0), differences(&errors, 230.0)].concat(),
        ))
        @if !sizes.is_empty() { (figure(
            "Cross-track error by size",
            "The distances from the path of each controller in their order, on a logarithmic axis: a line further below \
             is better, and its right end is the largest.",
            "share",
            sizes,
        )) }
        (figure(
            "Commands",
            &format!(
                "What each controller asked of the motors: traction drives forward above zero, steer \
                 turns to the left above zero; nothing may pass the dashed limits, and a jagged line is \
                 a nervous controller.{delta}"
            ),
            "time",
            [over_time(&commands, 220.0), differences(&commands, 220.0)].concat(),
        ))
        @if let Some(guard) = scene.guard.filter(|_| runs.iter().any(|run| run.rows.iter().any(|row| row.slope.is_some()))) {
            (figure(
                "Margins along the path",
                "What the ground left: a tip-over margin of 1 stands level and one of 0 tips over; the use of \
                 friction is what slope and turn ask for over what the ground gives. The vehicle drives slower \
                 and stops before the dashed limits.",
                "path",
                margin_panels(guard).iter().map(|panel| panel.along_path(200.0, runs, styles)).collect(),
            ))
        }
        (figure(
            "Attitude",
            "How the slope tilted the vehicle: roll is positive with the right side down, pitch with \
             the nose up; on an even slope one turns into the other as the vehicle turns.",
            "time",
            over_time(&attitude_panels(), 200.0),
        ))
        (figure(
            "Tread ICRs",
            "The points about which the left and right treads turn on the ground, in metres to the \
             right of the body's origin and ahead of it: the slope moves them, the rectangle of the \
             wheels (dashed) limits them, they jump where the turn changes its side, and there are \
             none to show while the vehicle goes straight or stands.",
            "time",
            over_time(&icr_panels(scene), 200.0),
        ))
        @for (run, learned) in runs.iter().filter_map(|run| Some((run, learned_at_end(run)?))) {
            (learned_table(&run.summary.controller, &learned))
        }
        @if times.is_empty() {
            section.panel { h2 { "Solve time" } p { "No run solved a QP." } }
        } @else {
            (figure(
                "Solve time",
                &format!(
                    "The cycles of each controller in the order of their solve times, on a logarithmic axis: a line \
                     further below is faster; a command is due every {:.0} ms.",
                    1e3 * scene.period_s,
                ),
                "share",
                times,
            ))
        }
    }
}

/// Returns the plot of a quantity in ascending order, of the runs that have it; none where no run has.
fn in_order(
    y_title: &str,
    value: &dyn Fn(&Row) -> f64,
    runs: &[Run],
    styles: &[Style],
) -> Vec<Plot> {
    let runs = runs.iter().zip(styles).enumerate();
    let lines = runs.map(|(index, (run, style))| {
        let values = run.rows.iter().map(value);
        Line::ascending(&style.name, style.colour, Some(index), values, None)
    });
    let lines: Vec<Line> = lines.filter(|line| !line.x.is_empty()).collect();
    if lines.is_empty() {
        return Vec::new();
    }
    vec![Plot {
        x_title: "share of the cycles (%)".to_owned(),
        logarithmic: true,
        ..Plot::over_time(y_title, 230.0, lines)
    }]
}

fn learned_at_end(run: &Run) -> Option<ContactEstimate> {
    run.rows.iter().rev().find_map(|row| row.contact)
}

/// Returns a table of the contact vehicle's learned parameters at the end of a run.
fn learned_table(controller: &str, learned: &ContactEstimate) -> Markup {
    let row = |parameter: Parameter| {
        let (value, (low, high)) = learned.interval(parameter);
        let from = if learned.observed(parameter) {
            "drive"
        } else {
            "configuration"
        };
        vec![
            parameter.key().to_owned(),
            significant(value),
            format!("{} to {}", significant(low), significant(high)),
            from.to_owned(),
        ]
    };
    let rows: Vec<Vec<String>> = Parameter::ALL.into_iter().map(row).collect();
    html! {
        section.panel {
            h2 { "Learned by " (controller) }
            (page::table(&format!("learned-by-{controller}"), &["parameter", "value", "95 % interval", "from"], &rows))
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

/// The legend of all plots and of the map, which stays in sight. Its boxes hide and show runs.
fn toggles(styles: &[Style]) -> Markup {
    html! {
        @if !styles.is_empty() {
            div.toggles role="group" aria-label="Shown in all plots" {
                @for (run, style) in styles.iter().enumerate() {
                    label {
                        (PreEscaped(format!("<input type=\"checkbox\" data-run=\"{run}\" checked=\"checked\"/> ")))
                        (swatch(style.colour)) (style.name)
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
