//! Quantities of runs over time.

use super::plot::{Line, Plot};
use super::scene::Style;
use crate::record::{Row, Run};

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

impl Panel<'_> {
    /// Returns the plot of all runs.
    pub(super) fn plot(&self, height_px: f64, runs: &[Run], styles: &[Style]) -> Plot {
        let line = |(run, (record, style)): (usize, (&Run, &Style))| {
            let points: Vec<[f64; 2]> = record
                .rows
                .iter()
                .map(|row| [row.time_s, (self.value)(row)])
                .collect();
            Line::through(&style.name, style.colour, Some(run), &points)
        };
        Plot {
            limits: self.limits.clone(),
            magnified_to: self.magnified_to,
            ..Plot::over_time(
                self.title,
                height_px,
                runs.iter().zip(styles).enumerate().map(line).collect(),
            )
        }
    }
}
