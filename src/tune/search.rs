//! The search: Powell's COBYLA, which needs no derivatives and keeps bounds.

use super::options::Options;
use anyhow::Result;
use cobyla::{Func, RhoBeg, StopTols, minimize};
use std::cell::RefCell;

/// First change of a setting, as a logarithm: a factor of 1.5.
const FIRST_STEP: f64 = 0.405;
/// Change below which the search ends: 2 %.
const LAST_STEP: f64 = 0.02;

/// Searches for factors on the settings, starting from 1, that minimise `cost`, which gets the number of the trial,
/// from 1, and the factors. The search is deterministic. A cost of `None` ends it.
///
/// # Errors
/// The first error of `cost`.
pub fn search(
    settings: usize,
    options: &Options,
    cost: impl FnMut(u32, &[f64]) -> Result<Option<f64>>,
) -> Result<()> {
    struct State<C> {
        cost: C,
        number: u32,
        ended: Result<bool>,
    }
    let state = RefCell::new(State {
        cost,
        number: 0,
        ended: Ok(false),
    });
    let logarithm = options.factor.ln();
    // COBYLA cannot be stopped from within: after the end, all remaining trials get the same cost.
    let objective = |logarithms: &[f64], _: &mut ()| {
        let mut state = state.borrow_mut();
        if !matches!(state.ended, Ok(false)) {
            return f64::MAX;
        }
        state.number += 1;
        let factors: Vec<f64> = logarithms
            .iter()
            .map(|value| value.clamp(-logarithm, logarithm).exp())
            .collect();
        let number = state.number;
        match (state.cost)(number, &factors) {
            Ok(Some(cost)) => cost,
            Ok(None) => {
                state.ended = Ok(true);
                f64::MAX
            }
            Err(error) => {
                state.ended = Err(error);
                f64::MAX
            }
        }
    };
    let constraints: [&dyn Func<()>; 0] = [];
    // Its result is ignored: the best trial is already known.
    let _ = minimize(
        objective,
        &vec![0.0; settings],
        &vec![(-logarithm, logarithm); settings],
        &constraints,
        (),
        options.tries as usize,
        RhoBeg::All(FIRST_STEP.min(logarithm)),
        Some(StopTols {
            xtol_abs: vec![LAST_STEP; settings],
            ..StopTols::default()
        }),
    );
    state.into_inner().ended.map(drop)
}
