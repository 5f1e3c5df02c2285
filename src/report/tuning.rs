//! Plots of a search: pairs of errors, and costs over the trials.

use super::frame::{PlotFrame, Tick, px, range};
use super::page::COLOURS;
use super::plot::{Line, Plot};
use super::scene::DRAWING_WIDTH_PX;
use maud::{Markup, html};

/// Points of one kind.
pub(crate) struct Scatter<'a> {
    /// What they are.
    pub(crate) name: &'a str,
    /// Their colour.
    pub(crate) colour: &'a str,
    /// Positive coordinates.
    pub(crate) points: &'a [[f64; 2]],
}

/// Draws points over two logarithmic axes of one range with their diagonal; `name` is unique in the page.
pub(crate) fn scatter_chart(name: &str, below: &str, left: &str, kinds: &[Scatter]) -> Markup {
    let all = kinds.iter().flat_map(|kind| kind.points).flatten();
    let both = range(
        all.filter(|value| **value > 0.0).map(|value| value.log10()),
        0.05,
    );
    let marks: Vec<Tick> = logarithmic_ticks(both);
    let frame = PlotFrame {
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

/// Returns the plot of the costs in order, with the lowest so far.
pub(crate) fn progress_plot(costs: &[f64]) -> Plot {
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
