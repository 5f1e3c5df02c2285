//! A drawing of the paths of odometry and of the log.

use crate::report::drawing::{Drawing, DrawnLine, svg};
use crate::report::page::{COLOURS, PRINTED_COLOURS};
use sidehill_plant::odometry::Comparison;

const SIZE_PX: [f64; 2] = [720.0, 720.0];
/// Colour of the log's path.
const LOG: &str = PRINTED_COLOURS[6];

/// Returns the models with their colours in plots and tables.
pub(super) fn coloured<'a>(models: &[&'a str]) -> Vec<(&'a str, &'static str)> {
    models.iter().copied().zip(COLOURS).collect()
}

/// Returns an SVG of the log's path and each model's, seen from above, both axes to the same scale.
pub(super) fn paths(models: &[&str], comparisons: &[Vec<Comparison>]) -> String {
    let line = |name: &str, colour, points| DrawnLine {
        name: name.to_owned(),
        colour,
        dashed: false,
        points,
    };
    let measured = comparisons.first().map_or(&[][..], Vec::as_slice).iter();
    let log = measured.map(|comparison| [comparison.measured.x_m, comparison.measured.y_m]);
    let mut lines = vec![line("log", LOG, log.collect())];
    for ((name, colour), comparisons) in models.iter().zip(PRINTED_COLOURS).zip(comparisons) {
        let estimated = comparisons
            .iter()
            .map(|comparison| [comparison.estimated.x_m, comparison.estimated.y_m]);
        lines.push(line(name, colour, estimated.collect()));
    }
    svg(&[Drawing::of_plan("x (m)", "y (m)", lines)], 1, SIZE_PX)
}
