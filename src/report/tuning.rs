//! Plots of a search: pairs of errors, and costs in the order of the tries.

use super::frame::{Frame, Tick, px, range, ticks};
use super::scene::DRAWING_WIDTH_PX;
use maud::{DOCTYPE, Markup, PreEscaped, html};

/// Points of one kind.
pub(crate) struct Scatter<'a> {
    /// What they are.
    pub(crate) name: &'a str,
    /// Their colour.
    pub(crate) colour: &'a str,
    /// Positive coordinates.
    pub(crate) points: &'a [[f64; 2]],
}

/// Returns a page in the style of the reports.
pub(crate) fn page(title: &str, body: &Markup) -> String {
    let page = html! {
        (DOCTYPE)
        html xmlns="http://www.w3.org/1999/xhtml" lang="en" {
            head {
                (PreEscaped("<meta charset=\"utf-8\"/>"))
                (PreEscaped("<meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>"))
                title { (title) }
                style { (PreEscaped(include_str!("style.css"))) }
            }
            body { (body) }
        }
    };
    page.into_string()
}

/// Draws points over two logarithmic axes of one range with their diagonal; `name` is unique in the page.
pub(crate) fn scatter_chart(name: &str, below: &str, left: &str, kinds: &[Scatter]) -> Markup {
    let all = kinds.iter().flat_map(|kind| kind.points).flatten();
    let both = range(
        all.filter(|value| **value > 0.0).map(|value| value.log10()),
        0.05,
    );
    let marks: Vec<Tick> = logarithmic_ticks(both);
    let frame = Frame {
        left: 80.0,
        top: 8.0,
        width: 460.0,
        height: 460.0,
        x: both,
        y: both,
    };
    html! {
        svg viewBox={ "0 0 " (DRAWING_WIDTH_PX) " 516" } role="img" aria-label=(name) {
            (frame.axis_below(&marks, below, true))
            (frame.axis_left(&marks, left))
            (frame.clipped(name, &html! {
                path.limit d=(frame.line([[both[0]; 2], [both[1]; 2]])) {}
                @for kind in kinds {
                    @for point in kind.points {
                        @let [x, y] = frame.place(point.map(f64::log10));
                        @if x.is_finite() && y.is_finite() {
                            circle cx=(px(x)) cy=(px(y)) r="3.2" fill=(kind.colour) fill-opacity="0.7" {}
                        }
                    }
                }
            }))
            (frame.border())
            @for (index, kind) in kinds.iter().enumerate() {
                @let y = frame.top + 14.0 + 20.0 * index as f64;
                circle cx=(px(frame.right() + 18.0)) cy=(px(y - 4.0)) r="4" fill=(kind.colour) {}
                text x=(px(frame.right() + 28.0)) y=(px(y)) { (kind.name) }
            }
        }
    }
}

/// Draws costs in their order, and the least so far; `name` is unique in the page.
pub(crate) fn progress_chart(name: &str, costs: &[f64]) -> Markup {
    let least: Vec<[f64; 2]> = costs
        .iter()
        .enumerate()
        .scan(f64::INFINITY, |least, (index, cost)| {
            *least = least.min(*cost);
            Some([index as f64 + 1.0, *least])
        })
        .collect();
    // The first choice is the present settings, at 0.
    let frame = Frame {
        left: 80.0,
        top: 8.0,
        width: DRAWING_WIDTH_PX - 110.0,
        height: 220.0,
        x: [0.0, costs.len().max(1) as f64 + 1.0],
        y: range(costs.iter().copied().filter(|cost| *cost < 0.5), 0.08),
    };
    html! {
        svg viewBox={ "0 0 " (DRAWING_WIDTH_PX) " 276" } role="img" aria-label=(name) {
            (frame.axis_below(&ticks(frame.x, 10.0), "choice", true))
            (frame.axis_left(&ticks(frame.y, 6.0), "mean cost"))
            (frame.clipped(name, &html! {
                @for (index, cost) in costs.iter().enumerate() {
                    @let [x, y] = frame.place([index as f64 + 1.0, *cost]);
                    @if y.is_finite() { circle cx=(px(x)) cy=(px(y)) r="3" fill="#0072b2" {} }
                }
                path.curve d=(frame.line(least)) stroke="#d55e00" {}
            }))
            (frame.border())
        }
    }
}

/// Ticks at 1, 2 and 5 times powers of ten, by their common logarithms.
fn logarithmic_ticks([low, high]: [f64; 2]) -> Vec<Tick> {
    let powers = low.floor() as i32..=high.ceil() as i32;
    powers
        .flat_map(|power| [1.0, 2.0, 5.0].map(|factor| factor * 10.0_f64.powi(power)))
        .map(|value| Tick {
            value: value.log10(),
            text: format!("{}", (value * 1e6).round() / 1e6),
        })
        .filter(|tick| tick.value >= low && tick.value <= high)
        .collect()
}
