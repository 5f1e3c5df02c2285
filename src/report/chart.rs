//! Quantities over time, one above the other.

use super::frame::{Frame, px, range, ticks};
use super::scene::{DRAWING_WIDTH_PX, Style};
use crate::record::{Row, Run};
use maud::{Markup, html};

/// A quantity of all runs over time.
pub(super) struct Panel<'a> {
    /// Title of its axis, with unit.
    pub(super) title: &'a str,
    /// Values that are not to be passed, each with what it is called.
    pub(super) limits: Vec<(f64, String)>,
    /// Largest absolute value shown, where the runs do not decide on it.
    pub(super) magnified_to: Option<f64>,
    /// The quantity at a cycle.
    pub(super) value: &'a dyn Fn(&Row) -> f64,
}

const LEFT_PX: f64 = 80.0;
const RIGHT_PX: f64 = 110.0;
const GAP_PX: f64 = 16.0;
const BELOW_PX: f64 = 44.0;
/// Stretches of time of which a long run keeps the extremes.
const COLUMNS: usize = 700;

/// What panels are drawn over.
struct Axis {
    title: &'static str,
    value: fn(&Row) -> f64,
}

/// Draws the panels over one axis of time; `name` is unique in the page.
pub(super) fn time_chart(
    name: &str,
    panels: &[Panel],
    height_px: f64,
    runs: &[Run],
    styles: &[Style],
) -> Markup {
    let axis = Axis {
        title: "time (s)",
        value: |row| row.time_s,
    };
    chart(&axis, name, panels, height_px, runs, styles)
}

/// Draws the panels over the way along the path; `name` is unique in the page.
pub(super) fn path_chart(
    name: &str,
    panels: &[Panel],
    height_px: f64,
    runs: &[Run],
    styles: &[Style],
) -> Markup {
    let axis = Axis {
        title: "way along the path (m)",
        value: |row| row.slope.map_or(f64::NAN, |slope| slope.arc_length_m),
    };
    chart(&axis, name, panels, height_px, runs, styles)
}

fn chart(
    axis: &Axis,
    name: &str,
    panels: &[Panel],
    height_px: f64,
    runs: &[Run],
    styles: &[Style],
) -> Markup {
    let places = || runs.iter().flat_map(|run| &run.rows).map(axis.value);
    let time_s = range(places(), 0.0);
    let below = panels.len().saturating_sub(1);
    let total_px = 8.0 + panels.len() as f64 * (height_px + GAP_PX) - GAP_PX + BELOW_PX;
    html! {
        svg viewBox={ "0 0 " (DRAWING_WIDTH_PX) " " (total_px) } role="img" aria-label=(name) {
            @for (index, panel) in panels.iter().enumerate() {
                @let lines: Vec<_> = runs.iter().map(|run| thinned(run, axis.value, panel.value)).collect();
                @let frame = Frame {
                    left: LEFT_PX,
                    top: 8.0 + index as f64 * (height_px + GAP_PX),
                    width: DRAWING_WIDTH_PX - LEFT_PX - RIGHT_PX,
                    height: height_px,
                    x: time_s,
                    y: panel.range(&lines),
                };
                (frame.axis_below(&ticks(time_s, 10.0), axis.title, index == below))
                (frame.axis_left(&ticks(frame.y, height_px / 28.0), panel.title))
                @for (value, text) in &panel.limits {
                    (limit(&frame, *value, text))
                }
                (frame.clipped(&format!("{name}-{index}"), &html! {
                    // The first run is drawn last: it lies on top.
                    @for (run, line) in lines.iter().enumerate().rev() {
                        path.curve.{ "run" (run) } d=(frame.line(line.iter().copied()))
                            stroke=(styles[run].colour) {}
                    }
                }))
                (frame.border())
            }
        }
    }
}

impl Panel<'_> {
    fn range(&self, lines: &[Vec<[f64; 2]>]) -> [f64; 2] {
        if let Some(most) = self.magnified_to {
            return [-most, most];
        }
        let values = lines.iter().flatten().map(|point| point[1]);
        range(values.chain(self.limits.iter().map(|limit| limit.0)), 0.08)
    }
}

fn limit(frame: &Frame, value: f64, text: &str) -> Markup {
    let y = frame.place([0.0, value])[1];
    html! {
        line.limit x1=(px(frame.left)) x2=(px(frame.right())) y1=(px(y)) y2=(px(y)) {}
        text.note x=(px(frame.right() + 6.0)) y=(px(y + 4.0)) { (text) }
    }
}

/// Returns a quantity over its axis, of long runs only the extremes of each of equal stretches.
///
/// A stretch without any finite value breaks the line.
fn thinned(run: &Run, place: fn(&Row) -> f64, value: impl Fn(&Row) -> f64) -> Vec<[f64; 2]> {
    let point = |row: &Row| [place(row), value(row)];
    if run.rows.len() <= 2 * COLUMNS {
        return run.rows.iter().map(point).collect();
    }
    let stretches = run.rows.chunks(run.rows.len().div_ceil(COLUMNS));
    stretches.flat_map(|rows| extremes(rows, point)).collect()
}

fn extremes(rows: &[Row], point: impl Fn(&Row) -> [f64; 2]) -> Vec<[f64; 2]> {
    let finite = || rows.iter().map(&point).filter(|p| p[1].is_finite());
    let least = finite().min_by(|a, b| a[1].total_cmp(&b[1]));
    let most = finite().max_by(|a, b| a[1].total_cmp(&b[1]));
    let (Some(least), Some(most)) = (least, most) else {
        return vec![[point(&rows[0])[0], f64::NAN]];
    };
    if least[0] <= most[0] {
        vec![least, most]
    } else {
        vec![most, least]
    }
}
