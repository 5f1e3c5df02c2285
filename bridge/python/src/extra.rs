//! Extra terms of a controller as arrays.

use crate::errors::invalid;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use sidehill_controller::mpc::{EXTRA_SIZE, ExtraCost, ExtraRow, ExtraTerms};

/// Numbers of a row: its coefficients and ends.
const ROW: usize = EXTRA_SIZE + 2;

/// The arguments of `Controller.set_extra_terms`.
pub struct Arguments<'a, 'py> {
    pub weight: Option<&'a Bound<'py, PyAny>>,
    pub target: Option<&'a Bound<'py, PyAny>>,
    pub rows: Option<&'a Bound<'py, PyAny>>,
    pub low: Option<&'a Bound<'py, PyAny>>,
    pub high: Option<&'a Bound<'py, PyAny>>,
}

impl Arguments<'_, '_> {
    /// Returns the terms of so many stages; none without arguments.
    pub fn terms(&self, py: Python<'_>, stages: usize) -> PyResult<Option<ExtraTerms>> {
        let all = (self.weight, self.target, self.rows, self.low, self.high);
        if matches!(all, (None, None, None, None, None)) {
            return Ok(None);
        }
        let broadcast = py.import("sidehill._arrays")?.getattr("extra_terms")?;
        let (weight, target, rows): (
            PyReadonlyArray1<'_, f64>,
            PyReadonlyArray1<'_, f64>,
            PyReadonlyArray1<'_, f64>,
        ) = broadcast
            .call1((stages, all.0, all.1, all.2, all.3, all.4))?
            .extract()?;
        of_numbers(weight.as_slice()?, target.as_slice()?, rows.as_slice()?).map(Some)
    }
}

/// Returns terms of the numbers of all stages: W and r of the costs, coefficients and ends of the rows.
fn of_numbers(weight: &[f64], target: &[f64], rows: &[f64]) -> PyResult<ExtraTerms> {
    let weights = weight.as_chunks::<EXTRA_SIZE>().0;
    let weights = weights.as_chunks::<EXTRA_SIZE>().0;
    let targets = target.as_chunks::<EXTRA_SIZE>().0;
    let costs = weights.iter().zip(targets);
    let costs = costs.map(|(weight, target)| ExtraCost {
        weight: *weight,
        target: *target,
    });
    let rows = rows.as_chunks::<ROW>().0.iter();
    let rows = rows.map(|[by @ .., low, high]| ExtraRow {
        by: *by,
        low: *low,
        high: *high,
    });
    ExtraTerms::new(costs.collect(), rows.collect()).map_err(invalid)
}

/// [`of_numbers`]' numbers.
pub type Numbers = (Vec<f64>, Vec<f64>, Vec<f64>);

/// Returns the numbers of terms.
pub fn numbers(terms: &ExtraTerms) -> Numbers {
    let costs = terms.costs();
    let weight = costs
        .iter()
        .flat_map(|cost| cost.weight.as_flattened().to_vec());
    let target = costs.iter().flat_map(|cost| cost.target);
    let rows = (0..terms.stages()).flat_map(|stage| terms.rows(stage));
    let rows = rows.flat_map(|row| row.by.into_iter().chain([row.low, row.high]));
    (weight.collect(), target.collect(), rows.collect())
}

/// Returns the terms of [`numbers`].
///
/// # Errors
/// They are of no terms.
pub fn from_numbers((weight, target, rows): &Numbers) -> PyResult<ExtraTerms> {
    of_numbers(weight, target, rows)
}
