//! The figures of all runs, and a sentence about the best.

use super::figures::{fixed, significant, two_digits};
use super::page::swatch;
use super::scene::Style;
use crate::record::{Run, Summary};
use maud::{Markup, PreEscaped, html};

/// Returns a sentence about the best run and the table of all.
pub(super) fn summary(runs: &[Run], styles: &[Style], perfect_sensors: bool) -> Markup {
    html! {
        p.finding {
            (finding(runs, styles))
            @if perfect_sensors {
                " Perfect sensors: no vehicle has them, and errors are larger with real ones."
            }
        }
        div.scroll role="region" aria-label="figures" tabindex="0" {
            table id="figures" {
                thead {
                    tr {
                        th.name rowspan="2" { "controller" }
                        th colspan="3" { "cross-track error (cm)" }
                        th rowspan="2" title="sum of all changes of the steer command" { "steer total" (PreEscaped("<br/>")) "variation (m/s)" }
                        th colspan="2" { "speed (m/s)" }
                        th rowspan="2" { "time (s)" }
                        th.name rowspan="2" { "reached the end" }
                        th colspan="2" { "QP solve time (\u{b5}s)" }
                        th rowspan="2" title="cycles that drove on the previous plan" { "fallbacks" }
                    }
                    tr {
                        th { "RMS" }
                        th title="95 % of the time it is smaller" { "p95" }
                        th { "max" }
                        th title="distance travelled over the time of the run" { "mean" }
                        th title="largest speed of a tread" { "tread max" }
                        th { "p50" }
                        th { "p99" }
                    }
                }
                tbody {
                    @for (run, style) in runs.iter().zip(styles) {
                        (line(&run.summary, style))
                    }
                }
            }
        }
    }
}

fn line(summary: &Summary, style: &Style) -> Markup {
    let has_qp = summary.solve_us.max > 0.0;
    let end = match (&summary.ended_by, summary.completed) {
        (_, true) => "yes".to_owned(),
        (Some(reason), false) => format!("no: {reason}"),
        (None, false) => "no".to_owned(),
    };
    let microseconds = |time_us: f64| {
        if has_qp {
            fixed(time_us, 0)
        } else {
            "no QP".to_owned()
        }
    };
    html! {
        tr {
            th.name scope="row" { (swatch(style.colour)) (style.name) }
            td { (significant(100.0 * summary.cross_track_rms_m)) }
            td { (significant(100.0 * summary.cross_track_p95_m)) }
            td { (significant(100.0 * summary.cross_track_max_m)) }
            td { (significant(summary.steer_total_variation_m_s)) }
            td { (significant(summary.mean_speed_m_s)) }
            td { (significant(summary.tread_speed_max_m_s)) }
            td { (fixed(summary.time_s, 1)) }
            td.text { (end) }
            td { (microseconds(summary.solve_us.p50)) }
            td { (microseconds(summary.solve_us.p99)) }
            td { (summary.fallbacks) }
        }
    }
}

fn finding(runs: &[Run], styles: &[Style]) -> String {
    if runs.is_empty() {
        return "There is no run to show.".to_owned();
    }
    let completed = runs.iter().filter(|run| run.summary.completed).count();
    let ends = if completed == runs.len() {
        match completed {
            1 => "The run reached the end of the path.".to_owned(),
            2 => "Both runs reached the end of the path.".to_owned(),
            _ => format!("All {completed} runs reached the end of the path."),
        }
    } else {
        format!(
            "{completed} of {} runs reached the end of the path.",
            runs.len()
        )
    };
    let mut ranked: Vec<_> = runs
        .iter()
        .zip(styles)
        .filter(|(run, _)| run.summary.completed)
        .map(|(run, style)| (run.summary.cross_track_rms_m, style))
        .filter(|(rms_m, _)| rms_m.is_finite())
        .collect();
    ranked.sort_by(|a, b| a.0.total_cmp(&b.0));
    let Some(((best_m, best), others)) = ranked.split_first() else {
        return ends;
    };
    let mut text = format!(
        "{ends} {} kept to the path within {} cm RMS",
        best.name,
        significant(100.0 * best_m)
    );
    for (index, (rms_m, style)) in others.iter().enumerate() {
        text += if index == 0 { "; " } else { ", " };
        text += &format!(
            "{} was {} times as far off",
            style.name,
            two_digits(rms_m / best_m)
        );
    }
    text + "."
}
