//! Quantities of runs over time or along the path.

use super::page::COLOURS;
use super::plot::{Line, Plot};
use super::scene::Style;
use crate::record::{Row, Run};

/// A quantity of all runs.
pub(super) struct Panel<'a> {
    /// Title of its axis, with unit.
    pub(super) title: &'a str,
    /// Limits, each with its label.
    pub(super) limits: Vec<(f64, String)>,
    /// The quantity at a cycle.
    pub(super) value: &'a dyn Fn(&Row) -> f64,
}

impl Panel<'_> {
    /// Returns the plot of all runs over time.
    pub(super) fn plot(&self, height_px: f64, runs: &[Run], styles: &[Style]) -> Plot {
        self.over("time (s)", |row| row.time_s, height_px, runs, styles)
    }

    /// Returns the plot of all runs over the way along the path.
    pub(super) fn along_path(&self, height_px: f64, runs: &[Run], styles: &[Style]) -> Plot {
        let place = |row: &Row| row.slope.map_or(f64::NAN, |slope| slope.arc_length_m);
        self.over("way along the path (m)", place, height_px, runs, styles)
    }

    /// Returns the plot of the second of two runs minus the first, where both have a cycle; none of other numbers of
    /// runs.
    pub(super) fn difference(&self, height_px: f64, runs: &[Run]) -> Option<Plot> {
        let [one, other] = runs else {
            return None;
        };
        let pairs = one.rows.iter().zip(&other.rows);
        let points = pairs.filter(|(a, b)| (a.time_s - b.time_s).abs() < 1e-6);
        let points: Vec<[f64; 2]> = points
            .map(|(a, b)| [a.time_s, (self.value)(b) - (self.value)(a)])
            .collect();
        Some(Plot {
            limits: vec![(0.0, "alike".to_owned())],
            ..Plot::over_time(
                format!("\u{394} {}", self.title),
                height_px,
                vec![Line::through("\u{394}", COLOURS[6], None, &points)],
            )
        })
    }

    fn over(
        &self,
        x_title: &str,
        place: impl Fn(&Row) -> f64,
        height_px: f64,
        runs: &[Run],
        styles: &[Style],
    ) -> Plot {
        let line = |(run, (record, style)): (usize, (&Run, &Style))| {
            let rows = record.rows.iter();
            let points: Vec<[f64; 2]> = rows.map(|row| [place(row), (self.value)(row)]).collect();
            Line::through(&style.name, style.colour, Some(run), &points)
        };
        Plot {
            x_title: x_title.to_owned(),
            limits: self.limits.clone(),
            ..Plot::over_time(
                self.title,
                height_px,
                runs.iter().zip(styles).enumerate().map(line).collect(),
            )
        }
    }
}
