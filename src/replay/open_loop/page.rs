//! The report of an open-loop replay.

use super::feed::Fed;
use crate::report::page::{COLOURS, Page, legend_of, section, table};
use crate::report::plot::{Line, Plot};
use maud::html;

/// Names and colours of the compared quantities.
const NAMES: [(&str, &str); 2] = [("measured", COLOURS[6]), ("commanded", COLOURS[0])];

/// Returns the page: figures, and motor speeds, error and solve times over the time of the log.
pub(super) fn html(
    subtitle: &str,
    conclusions: &[String],
    figures: &[(&str, String)],
    cycles: &[Fed],
) -> String {
    let line = |(name, colour): (&str, &str), value: &dyn Fn(&Fed) -> f64| {
        let points: Vec<[f64; 2]> = cycles
            .iter()
            .flat_map(|cycle| {
                // Nothing is known between two drives.
                let gap = cycle.first.then_some([cycle.step.time_s - 1e-3, f64::NAN]);
                gap.into_iter().chain([[cycle.step.time_s, value(cycle)]])
            })
            .collect();
        Line::through(name, colour, None, &points)
    };
    let both = |title: &str, values: [&dyn Fn(&Fed) -> f64; 2]| {
        let lines = NAMES.into_iter().zip(values);
        Plot::over_time(
            title,
            190.0,
            lines.map(|(name, value)| line(name, value)).collect(),
        )
    };
    let one = |title: &str, value: &dyn Fn(&Fed) -> f64| {
        Plot::over_time(title, 150.0, vec![line((title, COLOURS[0]), value)])
    };
    let motors = [
        both(
            "traction \u{3c4} (m/s)",
            [&|fed| fed.measured.traction_m_s, &|fed| {
                fed.step.command.traction_m_s
            }],
        ),
        both(
            "steer \u{3c3} (m/s)",
            [&|fed| fed.measured.steer_m_s, &|fed| {
                fed.step.command.steer_m_s
            }],
        ),
    ];
    let error = one("cross-track (cm)", &|fed| 100.0 * fed.step.cross_track_m);
    let solves = one("solve time (\u{b5}s)", &|fed| fed.step.solve_us);
    let rows: Vec<Vec<String>> = figures
        .iter()
        .map(|(name, value)| vec![(*name).to_owned(), value.clone()])
        .collect();
    let page = Page {
        title: "Open-loop replay",
        subtitle,
        conclusions,
        body: html! {
            (table("figures", &["figure", "value"], &rows))
            (section("Motor speeds",
                "What the controller would have commanded in each cycle, and what the treads were measured to do: traction \
                 drives forward above zero, steer turns to the left above zero. A command comes before the motion by the \
                 delay and lag of the drives.",
                &legend_of(&NAMES), &motors))
            (section("Cross-track error of the recorded drive",
                "How far the estimated position was from the driven path as it was smoothed and thinned out, to its left \
                 above zero: noise of the poses, and curves that the path rounds off.",
                &html! {}, &[error]))
            (section("Solve time", "Time within the QP solver, on this machine.", &html! {}, &[solves]))
        },
        style: "",
    };
    page.html()
}
