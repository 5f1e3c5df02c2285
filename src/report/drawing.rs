//! A drawing of lines that stands alone: an SVG file that needs no page, style sheet or script.

use super::frame::{PlotFrame, px, range, ticks};
use maud::{Markup, PreEscaped, html};

/// Space around the axes of a panel: left, top, right, below, px.
const AROUND_PX: [f64; 4] = [78.0, 32.0, 14.0, 44.0];
/// About one tick for each of these, px.
const TICK_PX: f64 = 60.0;
const LEGEND_ROW_PX: f64 = 18.0;
const STYLE: &str = "text{font:12.5px sans-serif;fill:#1a1a1a}.title{font-size:13.5px}.grid{stroke:#e6e6e6}\
    .border{fill:none;stroke:#888}.legend{fill:#fff;fill-opacity:.8}\
    .curve{fill:none;stroke-width:1.8;stroke-linejoin:round}";

/// Lines on two axes.
#[derive(Debug, Clone, PartialEq)]
pub struct Drawing {
    /// Title above the axes.
    pub title: String,
    /// Title of the horizontal axis, with unit.
    pub x_title: String,
    /// Title of the vertical axis, with unit.
    pub y_title: String,
    /// Values at the left and right edge.
    pub x: [f64; 2],
    /// Values at the bottom and top edge.
    pub y: [f64; 2],
    /// The lines; the first lies at the bottom.
    pub lines: Vec<DrawnLine>,
}

/// A line of a drawing.
#[derive(Debug, Clone, PartialEq)]
pub struct DrawnLine {
    /// Its name in the legend.
    pub name: String,
    /// Its colour, as CSS has it.
    pub colour: &'static str,
    /// Whether it is dashed.
    pub dashed: bool,
    /// Its points. One that is not finite leaves a gap.
    pub points: Vec<[f64; 2]>,
}

impl Drawing {
    /// Returns a drawing that shows all of its lines, with equal scales on both axes where it is square.
    pub(crate) fn of_plan(x_title: &str, y_title: &str, lines: Vec<DrawnLine>) -> Self {
        let extent = |axis: usize| {
            let points = lines.iter().flat_map(|line| &line.points);
            range(points.map(|point| point[axis]), 0.05)
        };
        let (x, y) = (extent(0), extent(1));
        let half = 0.5 * (x[1] - x[0]).max(y[1] - y[0]).max(0.1);
        let around = |[low, high]: [f64; 2]| {
            let middle = 0.5 * (low + high);
            [middle - half, middle + half]
        };
        Self {
            title: String::new(),
            x_title: x_title.to_owned(),
            y_title: y_title.to_owned(),
            x: around(x),
            y: around(y),
            lines,
        }
    }

    /// Draws the panel into a rectangle of `width` and `height` px whose corner is at `left`, `top`.
    fn panel(&self, number: usize, [left, top]: [f64; 2], [width, height]: [f64; 2]) -> Markup {
        let [before, above, behind, below] = AROUND_PX;
        let frame = PlotFrame {
            left: left + before,
            top: top + above,
            width: width - before - behind,
            height: height - above - below,
            x: self.x,
            y: self.y,
        };
        let legend_px = 34.0
            + 7.2
                * self
                    .lines
                    .iter()
                    .map(|l| l.name.chars().count())
                    .max()
                    .unwrap_or(0) as f64;
        html! {
            text x=(px(frame.left)) y=(px(top + 21.0)) class="title" { (self.title) }
            (frame.axis_below(&ticks(frame.x, frame.width / TICK_PX), &self.x_title, true))
            (frame.axis_left(&ticks(frame.y, frame.height / TICK_PX), &self.y_title))
            (frame.clipped(&format!("panel-{number}"), &html! {
                @for line in &self.lines {
                    path.curve d=(frame.line(line.points.iter().copied())) stroke=(line.colour)
                        stroke-dasharray=[line.dashed.then_some("6 4")] {}
                }
            }))
            rect.legend x=(px(frame.left + 6.0)) y=(px(frame.top + 6.0)) width=(px(legend_px))
                height=(px(LEGEND_ROW_PX * self.lines.len() as f64 + 6.0)) {}
            @for (row, line) in self.lines.iter().enumerate() {
                @let y = frame.top + 18.0 + LEGEND_ROW_PX * row as f64;
                path.curve d={ "M" (px(frame.left + 12.0)) "," (px(y)) "h18" } stroke=(line.colour)
                    stroke-dasharray=[line.dashed.then_some("6 4")] {}
                text x=(px(frame.left + 36.0)) y=(px(y + 4.0)) { (line.name) }
            }
            (frame.border())
        }
    }
}

/// Returns drawings as an SVG file of `width` and `height` px, `columns` beside each other.
pub fn svg(drawings: &[Drawing], columns: usize, [width, height]: [f64; 2]) -> String {
    let rows = drawings.len().div_ceil(columns.max(1));
    let size = [width / columns as f64, height / rows.max(1) as f64];
    let corner = |number: usize| {
        let (row, column) = (number / columns, number % columns);
        [size[0] * column as f64, size[1] * row as f64]
    };
    let markup = html! {
        svg xmlns="http://www.w3.org/2000/svg" width=(width) height=(height) viewBox={ "0 0 " (width) " " (height) } {
            style { (PreEscaped(STYLE)) }
            rect width=(width) height=(height) fill="#fff" {}
            @for (number, drawing) in drawings.iter().enumerate() {
                (drawing.panel(number, corner(number), size))
            }
        }
    };
    markup.into_string() + "\n"
}
