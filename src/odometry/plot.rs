//! A drawing of the paths of odometry and of the log.

use anyhow::{Result, anyhow};
use plotters::prelude::*;
use sidehill_plant::odometry::Comparison;

const SIZE: (u32, u32) = (720, 720);
/// Share of the paths' extent left free around them.
const MARGIN: f64 = 0.05;
const COLOURS: [RGBColor; 3] = [
    RGBColor(200, 80, 40),
    RGBColor(30, 110, 190),
    RGBColor(140, 140, 140),
];

/// Returns an SVG of the log's path and each model's, seen from above, both axes to the same scale.
///
/// # Errors
/// An error of the drawing library.
pub(super) fn paths(models: &[(&str, &[Comparison])]) -> Result<String> {
    let measured = models
        .first()
        .map_or(&[][..], |(_, comparisons)| comparisons);
    let log: Vec<_> = measured
        .iter()
        .map(|comparison| (comparison.measured.x_m, comparison.measured.y_m))
        .collect();
    let mut lines = vec![("log", log, BLACK)];
    for ((name, comparisons), colour) in models.iter().zip(COLOURS) {
        let estimated = comparisons
            .iter()
            .map(|comparison| (comparison.estimated.x_m, comparison.estimated.y_m));
        lines.push((name, estimated.collect(), colour));
    }
    let points = || lines.iter().flat_map(|(_, points, _)| points);
    let (x, y) = (
        extent(points().map(|point| point.0)),
        extent(points().map(|point| point.1)),
    );
    let half = (0.5 + MARGIN) * (x.1 - x.0).max(y.1 - y.0).max(0.1);
    let around = |(low, high): (f64, f64)| {
        let middle = 0.5 * (low + high);
        middle - half..middle + half
    };
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        area.fill(&WHITE).map_err(failed)?;
        let mut chart = ChartBuilder::on(&area)
            .margin(12)
            .set_all_label_area_size(44)
            .build_cartesian_2d(around(x), around(y))
            .map_err(failed)?;
        chart
            .configure_mesh()
            .x_desc("x, m")
            .y_desc("y, m")
            .draw()
            .map_err(failed)?;
        for (name, points, colour) in lines {
            chart
                .draw_series(LineSeries::new(points, colour.stroke_width(2)))
                .map_err(failed)?
                .label(name)
                .legend(move |(x, y)| PathElement::new([(x, y), (x + 20, y)], colour));
        }
        chart
            .configure_series_labels()
            .background_style(WHITE.mix(0.8))
            .border_style(BLACK)
            .draw()
            .map_err(failed)?;
        area.present().map_err(failed)?;
    }
    Ok(svg)
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
        (low.min(value), high.max(value))
    })
}

fn failed(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("cannot be drawn: {error}")
}
