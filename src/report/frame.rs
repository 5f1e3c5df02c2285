//! The rectangle of a plot: scales, ticks, axes and lines in it.

use maud::{Markup, html};
use std::fmt::Write;

/// Rectangle of a plot in its drawing, px, and the values at its edges.
#[derive(Debug, Clone, Copy)]
pub(super) struct PlotFrame {
    pub(super) left: f64,
    pub(super) top: f64,
    pub(super) width: f64,
    pub(super) height: f64,
    /// Values at the left and right edge.
    pub(super) x: [f64; 2],
    /// Values at the bottom and top edge.
    pub(super) y: [f64; 2],
}

/// A value on an axis with its text.
pub(super) struct Tick {
    pub(super) value: f64,
    pub(super) text: String,
}

impl PlotFrame {
    pub(super) fn right(&self) -> f64 {
        self.left + self.width
    }

    pub(super) fn bottom(&self) -> f64 {
        self.top + self.height
    }

    /// Returns the place of a point, px.
    pub(super) fn place(&self, point: [f64; 2]) -> [f64; 2] {
        let share = |value: f64, [low, high]: [f64; 2]| (value - low) / (high - low);
        [
            self.left + self.width * share(point[0], self.x),
            self.bottom() - self.height * share(point[1], self.y),
        ]
    }

    pub(super) fn contains(&self, [x, y]: [f64; 2]) -> bool {
        (self.x[0]..=self.x[1]).contains(&x) && (self.y[0]..=self.y[1]).contains(&y)
    }

    /// Draws grid lines, texts and title of the axis below, the texts only where `labelled`.
    pub(super) fn axis_below(&self, ticks: &[Tick], title: &str, labelled: bool) -> Markup {
        let y = self.bottom();
        html! {
            @for tick in ticks {
                @let x = px(self.place([tick.value, 0.0])[0]);
                line.grid x1=(x) x2=(x) y1=(px(self.top)) y2=(px(y)) {}
                @if labelled {
                    text x=(x) y=(px(y + 16.0)) text-anchor="middle" { (tick.text) }
                }
            }
            @if labelled {
                text.title x=(px(self.left + 0.5 * self.width)) y=(px(y + 35.0)) text-anchor="middle" {
                    (title)
                }
            }
        }
    }

    /// Draws grid lines, texts and title of the axis on the left.
    pub(super) fn axis_left(&self, ticks: &[Tick], title: &str) -> Markup {
        let (x, y) = (px(self.left - 58.0), px(self.top + 0.5 * self.height));
        html! {
            @for tick in ticks {
                @let y = self.place([0.0, tick.value])[1];
                line.grid x1=(px(self.left)) x2=(px(self.right())) y1=(px(y)) y2=(px(y)) {}
                text x=(px(self.left - 7.0)) y=(px(y + 4.0)) text-anchor="end" { (tick.text) }
            }
            text.title x=(x) y=(y) text-anchor="middle" transform={ "rotate(-90 " (x) " " (y) ")" } {
                (title)
            }
        }
    }

    pub(super) fn border(&self) -> Markup {
        html! { rect.border x=(px(self.left)) y=(px(self.top)) width=(px(self.width)) height=(px(self.height)) {} }
    }

    /// Draws content clipped to the frame; `id` is unique in the page.
    pub(super) fn clipped(&self, id: &str, content: &Markup) -> Markup {
        html! {
            clipPath id=(id) {
                rect x=(px(self.left)) y=(px(self.top)) width=(px(self.width)) height=(px(self.height)) {}
            }
            g clip-path={ "url(#" (id) ")" } { (content) }
        }
    }

    /// Returns SVG path data through the points, broken where one is not finite.
    pub(super) fn line(&self, points: impl IntoIterator<Item = [f64; 2]>) -> String {
        let mut data = String::new();
        let mut pen_down = false;
        for point in points {
            let [x, y] = self.place(point);
            if x.is_finite() && y.is_finite() {
                // Clamp points far outside, whose coordinates would be long.
                let y = y.clamp(self.top - 1e4, self.bottom() + 1e4);
                let letter = if pen_down { 'L' } else { 'M' };
                // Writing to a string does not fail.
                let _ = write!(data, "{letter}{},{}", px(x), px(y));
            }
            pen_down = x.is_finite() && y.is_finite();
        }
        data
    }
}

/// Returns a coordinate rounded to a tenth of a pixel.
pub(super) fn px(value: f64) -> f64 {
    (value * 10.0).round() / 10.0
}

/// Returns the smallest 1, 2 or 5 times a power of ten of which at most `count` fit in `span`.
pub(super) fn nice_step(span: f64, count: f64) -> f64 {
    let least = span / count;
    let power = 10.0_f64.powf(least.log10().floor());
    let factor = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|factor| factor * power >= least * (1.0 - 1e-9))
        .unwrap_or(10.0);
    factor * power
}

/// Returns the multiples of `step` in a range; none for an empty or infinite range.
pub(super) fn multiples([low, high]: [f64; 2], step: f64) -> Vec<f64> {
    let slack = 1e-9;
    let (first, last) = ((low / step - slack).ceil(), (high / step + slack).floor());
    if !(0.0..1e4).contains(&(last - first)) {
        return Vec::new();
    }
    let count = (last - first) as usize + 1;
    (0..count).map(|i| (first + i as f64) * step).collect()
}

/// Returns about `count` ticks at round values of a range.
pub(super) fn ticks(range: [f64; 2], count: f64) -> Vec<Tick> {
    let step = nice_step(range[1] - range[0], count);
    multiples(range, step)
        .into_iter()
        .map(|value| Tick {
            value,
            text: rounded(value, step),
        })
        .collect()
}

/// Returns a multiple of `step` with the decimals it needs.
pub(super) fn rounded(value: f64, step: f64) -> String {
    let decimals = (-(step.log10() + 1e-9).floor()).max(0.0) as usize;
    let value = if value.abs() < 0.5 * step { 0.0 } else { value };
    format!("{value:.decimals$}").replace('-', "\u{2212}")
}

/// Returns the range of the finite `values` with a margin; a range around 0 if there are none.
pub(super) fn range(values: impl IntoIterator<Item = f64>, margin: f64) -> [f64; 2] {
    let (low, high) = values
        .into_iter()
        .filter(|value| value.is_finite())
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
    if low > high {
        return [-1.0, 1.0];
    }
    let pad = (margin * (high - low)).max(1e-6 * low.abs().max(high.abs()).max(1.0));
    [low - pad, high + pad]
}
